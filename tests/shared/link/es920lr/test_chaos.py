"""Minutes of everything that can go wrong at once; afterwards all works again, and no packet's fate was forgotten."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from shared.link.es920lr.core import Event, Failure, SendFailed, Sent
from shared.link.es920lr.driver import Es920lr
from shared.link.es920lr.parser import Heard
from shared.link.es920lr.settings import BootMode
from tests.shared.link.radio_rig import ROBOT, STATION, Rig, operating
from tools.simulator.devices.es920lr import EmulatedEs920lr
from tools.simulator.radio.loss import Bursts
from tools.simulator.radio.ports import EmulatedPort

CHAOS_S = 240.0
CALM_S = 20.0
_WITHOUT_ANSWER = {Failure.NO_REPLY, Failure.RESTARTED}


class NoisyPort(EmulatedPort):
    """Each byte may be changed or lost, in both directions."""

    rng = np.random.default_rng(0)
    share = 0.0

    def write(self, data: bytes) -> None:
        super().write(self._noisy(data))

    def read(self, timeout_s: float) -> bytes:
        return self._noisy(super().read(timeout_s))

    def _noisy(self, data: bytes) -> bytes:
        if not data or self.share == 0.0:
            return data
        hit = self.rng.random(len(data)) < self.share
        kept = [int(self.rng.integers(256)) if h else b for b, h in zip(data, hit, strict=True)]
        return bytes(b for b, h in zip(kept, hit, strict=True) if not h or self.rng.random() < 0.7)


class Side:
    def __init__(self, rig: Rig, module: EmulatedEs920lr, driver: Es920lr, port: NoisyPort) -> None:
        self.rig, self.module, self.driver, self.port = rig, module, driver, port
        self.handed_over: list[int] = []
        self.fates: Counter[int] = Counter()
        self.failures: Counter[Failure] = Counter()
        self.heard: list[bytes] = []

    def step(self, payload: bytes, wants_to_send: bool) -> None:
        if wants_to_send and (handle := self.driver.submit(payload)) is not None:
            self.handed_over.append(handle)
        for event in self.driver.poll(0.0):
            self.note(event)

    def note(self, event: Event) -> None:
        match event:
            case Sent():
                self.fates[event.handle] += 1
            case SendFailed():
                self.fates[event.handle] += 1
                self.failures[event.failure] += 1
            case Heard():
                self.heard.append(event.payload)
            case _:
                pass


def two_sides(rng: np.random.Generator) -> tuple[Rig, list[Side]]:
    rig = Rig(seed=int(rng.integers(1 << 30)), loss=lambda: Bursts(5.0, 0.5))
    sides = []
    for name, settings, x_m in (("robot", ROBOT, 0.0), ("station", STATION, 10.0)):
        flash = operating(settings) if rng.random() < 0.5 else replace(settings, boot_mode=BootMode.CONFIGURATION)
        module = rig.module(name, flash, (x_m, 0.0))
        port = NoisyPort(module, rig.timeline)
        port.rng = rng
        sides.append(Side(rig, module, Es920lr(port, settings, rig.clock, reset=module.reset), port))
    return rig, sides


def disturb(side: Side, rng: np.random.Generator) -> None:
    """One module, one moment."""
    chance = rng.random()
    if chance < 0.002:
        side.module.power_off()
    elif chance < 0.05:
        side.module.power_on()
    elif chance < 0.052:
        side.module.reset()
    elif chance < 0.056:
        side.port.share = float(rng.choice((0.0, 0.0, 0.002, 0.05)))
    elif chance < 0.058:
        side.module.mac.is_stuck = not side.module.mac.is_stuck
    elif chance < 0.059:
        side.port.write(rng.bytes(int(rng.integers(1, 80))))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_whatever_happens_every_packet_has_one_fate_and_the_link_comes_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig, sides = two_sides(rng)
    while rig.clock.now_s() < CHAOS_S:
        rig.clock.advance(float(rng.choice((0.002, 0.01, 0.05))))
        for side in sides:
            side.step(rng.bytes(int(rng.integers(1, 51))), rng.random() < 0.5)
            disturb(side, rng)
    for side in sides:
        side.port.share, side.module.mac.is_stuck = 0.0, False
        side.module.power_on()
    calm_from_s = rig.clock.now_s()
    while rig.clock.now_s() < calm_from_s + CALM_S:
        rig.clock.advance(0.01)
        for side in sides:
            side.step(b"", False)
    for side in sides:
        assert side.driver.operating
        assert side.fates == Counter(side.handed_over)
        assert len(side.handed_over) > 100
        assert side.failures.keys() & _WITHOUT_ANSWER  # it did go wrong
        assert side.driver.statistics.dropped_events == 0


@pytest.mark.parametrize("seed", [4, 5])
def test_after_the_chaos_packets_go_through_at_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig, sides = two_sides(rng)
    for _ in range(3_000):
        rig.clock.advance(0.01)
        for side in sides:
            side.step(bytes(50), True)
            disturb(side, rng)
    rig.channel.use_loss(lambda: Bursts(1e9, 1e-9))
    for side in sides:
        side.port.share, side.module.mac.is_stuck = 0.0, False
        side.module.power_on()
    for _ in range(2_000):
        rig.clock.advance(0.01)
        for side in sides:
            side.step(b"", False)
    for sender, receiver, text in ((0, 1, b"there"), (1, 0, b"back")):
        sides[sender].step(text, True)
        for _ in range(30):
            rig.clock.advance(0.01)
            for side in sides:
                side.step(b"", False)
        assert sides[receiver].heard[-1:] == [text]


def test_the_same_seed_gives_the_same_minute() -> None:
    def minute() -> list[object]:
        rng = np.random.default_rng(6)
        rig, sides = two_sides(rng)
        while rig.clock.now_s() < 30.0:
            rig.clock.advance(0.01)
            for side in sides:
                side.step(rng.bytes(20), True)
                disturb(side, rng)
        return [rig.channel.statistics, *((s.heard, s.fates, s.driver.statistics) for s in sides)]

    assert minute() == minute()
