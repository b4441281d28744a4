"""Core and session joined by a USB wire that flips, loses, doubles and inserts bytes, and falls silent."""

from __future__ import annotations

import numpy as np
import pytest

from shared.protocol import transceiver as t
from shared.protocol.transceiver_session import TransceiverSession
from tools.simulator.devices.mega_core import Core

USB, RADIOS = t.Port.USB, (t.Port.RADIO_A, t.Port.RADIO_B)
USB_BYTES_PER_MS, RADIO_BYTES_PER_MS = 45, 11


class Chaos:
    """A millisecond a turn. What each side said since the session began is compared with what the other heard."""

    def __init__(self, core: Core, rng: np.random.Generator, badness: float) -> None:
        self.core = core
        self.session = TransceiverSession(first_session=int(rng.integers(1 << 32)))
        self.heard_bytes = 0
        self._rng = rng
        self._badness = badness
        self._now_s = 0.0
        self._to_mega, self._to_host = bytearray(), bytearray()
        self._silent_until_s = 0.0
        self._forget()

    def _forget(self) -> None:
        self._written = [bytearray(), bytearray()]
        self._left = [bytearray(), bytearray()]
        self._arrived = [bytearray(), bytearray()]
        self._read = [bytearray(), bytearray()]
        self._generation = self.session.generation

    def turn(self) -> None:
        self._now_s += 0.001
        if self.session.generation != self._generation:
            self._settle()
        if self.session.is_up:
            self._talk()
        self._carry()
        for radio in range(t.RADIOS):
            self._left[radio] += self.core.leave(RADIOS[radio])[:255]
            self._read[radio] += self.session.read(radio)
            assert self._written[radio].startswith(self._left[radio])
            assert self._arrived[radio].startswith(self._read[radio])

    def _settle(self) -> None:
        """The session has ended: nothing is said until what was under way has drained, then all is counted anew."""
        self.session = TransceiverSession(first_session=int(self._rng.integers(1 << 32)))
        self._to_mega.clear()
        self._to_host.clear()
        for _ in range(t.SESSION_TIMEOUT_MS + 100):
            self.core.run(1)
            for port in (USB, *RADIOS):
                self.core.leave(port)
        self.heard_bytes += sum(map(len, self._read)) + sum(map(len, self._left))
        self._forget()

    def _talk(self) -> None:
        for radio in range(t.RADIOS):
            data = self._rng.bytes(int(self._rng.integers(RADIO_BYTES_PER_MS)))
            self._written[radio] += data[: self.session.write(radio, data)]
            if len(self._arrived[radio]) - len(self._read[radio]) > t.RADIO_TO_HOST_BYTES // 2:
                continue  # what the firmware has no room for is lost, and counted
            data = self._rng.bytes(int(self._rng.integers(RADIO_BYTES_PER_MS // 2)))
            assert self.core.arrive(RADIOS[radio], data) == len(data)
            self._arrived[radio] += data

    def _carry(self) -> None:
        self._to_mega += self.session.take_output()
        self._to_host += self.core.leave(USB)
        if self._rng.random() < self._badness / 500:
            self._silent_until_s = self._now_s + self._rng.uniform(0, 2)
        down, up = self._portion(self._to_mega), self._portion(self._to_host)
        self.core.arrive(USB, down)
        self.core.run(1)
        self.session.feed(up, self._now_s)

    def _portion(self, wire: bytearray) -> bytes:
        data = bytes(wire[:USB_BYTES_PER_MS])
        del wire[:USB_BYTES_PER_MS]
        return b"" if self._now_s < self._silent_until_s else self._spoilt(data)

    def _spoilt(self, data: bytes) -> bytes:
        if self._rng.random() > self._badness or not data:
            return data
        at = int(self._rng.integers(len(data)))
        match self._rng.integers(4):
            case 0:
                return data[:at] + bytes((data[at] ^ 1 << int(self._rng.integers(8)),)) + data[at + 1 :]
            case 1:
                return data[:at] + data[at + int(self._rng.integers(1, 20)) :]
            case 2:
                return data + data[at:]
            case _:
                return data[:at] + self._rng.bytes(int(self._rng.integers(1, 30))) + data[at:]


@pytest.mark.parametrize("badness", [0.0, 0.02, 0.1])
def test_every_stream_stays_in_order_and_whole_on_a_bad_wire(
    core: Core, rng: np.random.Generator, badness: float
) -> None:
    chaos = Chaos(core, rng, badness)
    for _ in range(3_000):
        chaos.turn()
    chaos._settle()
    assert chaos.heard_bytes > (35_000 if badness == 0.0 else 4_000)
    assert core.stopped()[0] == -1
