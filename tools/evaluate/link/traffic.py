"""Numbered observations as fast as the link takes them, and commands and stops the other way."""

from __future__ import annotations

import numpy as np

from shared.link.base import Lane, LinkError
from shared.link.radio_pair.link import RadioPair
from tools.simulator.radio.pair_rig import PairRig

_AHEAD_BYTES = 150  # that wait for the radios: enough that none of them is ever idle
_COMMAND_S = 1.0
_STOP_S = 5.0
_COMMAND_BYTES = 18  # `Drive` as the codec has it


class Traffic:
    """Hangs itself on the rig; the waits are from `send` to `receive`."""

    def __init__(self, rig: PairRig, size: int, rng: np.random.Generator) -> None:
        self.observation_waits_s: list[float] = []
        self.command_waits_s: list[float] = []
        self.stop_waits_s: list[float] = []
        self.came_s: list[float] = []
        self.duplicated = self.out_of_order = 0
        self._rig = rig
        self._size = size
        self._rng = rng
        self._sent_s: dict[bytes, float] = {}
        self._count = {b"o": 0, b"c": 0, b"s": 0}
        self._seen: set[bytes] = set()
        self._last = {b"o": -1, b"c": -1}
        self._command_s = self._stop_s = rig.clock.now_s() + 1.0
        self._ends = False
        rig.at_each_event = self._step

    @property
    def lost(self) -> int:
        """Of what was taken, not arrived so far."""
        return len(self._sent_s)

    def drained(self) -> bool:
        """Call it from the beginning of the end on: nothing new is sent."""
        self._ends = True
        return not self._sent_s

    def _step(self) -> None:
        now_s = self._rig.clock.now_s()
        if not self._ends:
            self._send(now_s)
        for link, waits in ((self._rig.station, self.observation_waits_s), (self._rig.robot, self.command_waits_s)):
            while (datagram := _received(link)) is not None:
                self._take(datagram, waits, now_s)

    def _send(self, now_s: float) -> None:
        robot, station = self._rig.robot, self._rig.station
        while robot.waiting_bytes < _AHEAD_BYTES and robot.send(self._next(b"o", self._size)):
            self._note(b"o", now_s)
        if now_s >= self._command_s:
            self._command_s += float(self._rng.uniform(0.5, 1.5)) * _COMMAND_S
            if station.send(self._next(b"c", _COMMAND_BYTES), Lane.COMMAND):
                self._note(b"c", now_s)
        if now_s >= self._stop_s:
            self._stop_s += float(self._rng.uniform(0.5, 1.5)) * _STOP_S
            if station.send(self._next(b"s", 10), Lane.NOW):
                self._note(b"s", now_s)

    def _next(self, kind: bytes, size: int) -> bytes:
        name = kind + self._count[kind].to_bytes(4, "little")
        return name + bytes(size - len(name))

    def _note(self, kind: bytes, now_s: float) -> None:
        self._sent_s[kind + self._count[kind].to_bytes(4, "little")] = now_s
        self._count[kind] += 1

    def _take(self, datagram: bytes, waits: list[float], now_s: float) -> None:
        name = datagram[:5]
        if name in self._seen:
            self.duplicated += 1
            return
        self._seen.add(name)
        waited_s = now_s - self._sent_s.pop(name)
        kind, number = name[:1], int.from_bytes(name[1:], "little")
        if kind == b"s":
            self.stop_waits_s.append(waited_s)
            return
        waits.append(waited_s)
        self.out_of_order += number != self._last[kind] + 1
        self._last[kind] = number
        if kind == b"o":
            self.came_s.append(now_s)


def _received(link: RadioPair) -> bytes | None:
    """The loss of the other side is no loss of what is on its way."""
    try:
        return link.receive(0.0)
    except LinkError:
        return link.receive(0.0)
