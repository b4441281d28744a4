"""Robot and station with two emulated modules each, on a manual clock."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from shared.link.es920lr.driver import Es920lr
from shared.link.es920lr.settings import BootMode, Format, RadioSettings
from shared.link.radio_pair.config import PairConfig
from shared.link.radio_pair.link import RadioPair, robot_radios, station_radios
from shared.runtime.clock import ManualClock
from tools.simulator.devices.es920lr import EmulatedEs920lr
from tools.simulator.radio.channel import RadioChannel
from tools.simulator.radio.loss import Independent, LossModel
from tools.simulator.radio.ports import EmulatedPort
from tools.simulator.radio.timeline import Timeline

CHANNELS = (1, 5)
_STEP_S = 0.0005  # the programs look that often while bytes come; the air keeps its own exact times
_LONGEST_STEP_S = 0.02


def link_settings(bandwidth_hz: int = 500_000, spreading_factor: int = 7) -> RadioSettings:
    """What the link needs of a module (docs/radio.md)."""
    return RadioSettings(
        bandwidth_hz=bandwidth_hz,
        spreading_factor=spreading_factor,
        acknowledge=False,
        show_rssi=True,
        show_sender=True,
        format=Format.BINARY,
        boot_mode=BootMode.OPERATION,
    )


class PairRig:
    """`robot` and `station` are links without threads; `run` moves the time, event by event."""

    def __init__(
        self,
        seed: int,
        settings: RadioSettings | None = None,
        config: PairConfig | None = None,
        loss: Callable[[], LossModel] = Independent,
        radios: int = 2,
        keys: tuple[bytes, bytes] = (bytes(32), bytes(32)),
        clock: ManualClock | None = None,
    ) -> None:
        self.clock = clock or ManualClock()
        self.rng = np.random.default_rng(seed)
        self.timeline = Timeline(self.clock)
        self.channel = RadioChannel(self.timeline, np.random.default_rng(seed + 1), loss=loss)
        self.settings = settings or link_settings()
        self.config = config
        self._radios = radios
        self.robot_modules = [self._module(f"robot {i}", i, own=1, to=2) for i in range(radios)]
        self.station_modules = [self._module(f"station {i}", i, own=2, to=1) for i in range(radios)]
        self.robot = self.make_robot(keys[0])
        self.station = self.make_station(keys[1])
        self.at_each_event: Callable[[], None] = lambda: None

    def make_robot(self, key: bytes = bytes(32)) -> RadioPair:
        """Another program on the robot's modules."""
        self.robot = robot_radios(
            [self._opener(m) for m in self.robot_modules],
            self.settings,
            key,
            self.clock,
            self.config,
            self.rng.bytes,
            threads=False,
        )
        return self.robot

    def make_station(self, key: bytes = bytes(32)) -> RadioPair:
        """Another program on the station's modules."""
        self.station = station_radios(
            [self._opener(m) for m in self.station_modules],
            self.settings,
            key,
            self.clock,
            self.config,
            self.rng.bytes,
            threads=False,
        )
        return self.station

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass; True as soon as `until` says so."""
        end_s = self.clock.now_s() + seconds
        while self.clock.now_s() < end_s:
            self.timeline.run()
            self.robot.step()
            self.station.step()
            self.at_each_event()
            if until():
                return True
            now_s = self.clock.now_s()
            due_s = [self.timeline.next_s, self._next_byte_s(), self.robot.due_s(), self.station.due_s()]
            next_s = min((d for d in due_s if d > now_s), default=end_s)
            step_s = min(max(next_s - now_s, _STEP_S), _LONGEST_STEP_S)
            self.clock.advance_to(min(now_s + step_s, end_s))
        return False

    def connect(self, seconds: float = 20.0) -> None:
        """Raises `RuntimeError` when they have not found each other in time."""
        if not self.run(seconds, lambda: self.robot.connected and self.station.connected):
            raise RuntimeError("robot and station have not found each other")

    def _next_byte_s(self) -> float:
        return min(m.line.next_for_host_s for m in [*self.robot_modules, *self.station_modules])

    def _module(self, name: str, pair: int, own: int, to: int) -> EmulatedEs920lr:
        flash = dataclasses.replace(
            self.settings, channel=CHANNELS[pair], own_id=own + 2 * pair, destination_id=to + 2 * pair
        )
        module = EmulatedEs920lr(self.timeline, self.channel, name, flash, (0.0, 0.0 if own == 1 else 5.0))
        module.power_on()
        return module

    def _opener(self, module: EmulatedEs920lr) -> Callable[[], Es920lr]:
        return lambda: Es920lr(EmulatedPort(module, self.timeline), module.flash, self.clock, reset=module.reset)
