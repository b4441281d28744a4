"""A serial line between a host and a module: bytes take their time, and mean nothing at the wrong rate."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from tools.simulator.radio.timeline import Timeline

_BITS_A_BYTE = 10  # start and stop bit
_RECEIVE_BUFFER_BYTES = 64  # of the module's serial manager
_LINE_BYTES = 65_536  # what a host that is never read, or writes without end, may have on the way


class SerialLine:
    """The module's end calls `say`, the host's end `write` and `read`. `take_byte` gets what the module hears.

    While the module is occupied (`occupy`) its bytes wait in a buffer of 64; more are lost.
    """

    def __init__(self, timeline: Timeline, baud_rate: int, take_byte: Callable[[int], None]) -> None:
        self.baud_rate = baud_rate  # the module's
        self.powered = False
        self.overrun_bytes = 0
        self._timeline = timeline
        self._take_byte = take_byte
        self._to_module: deque[tuple[float, int, int]] = deque()  # arrival, byte, rate
        self._to_module_free_s = 0.0
        self._arrival_is_due = False
        self._buffer: deque[int] = deque()
        self._occupied_until_s = 0.0
        self._to_host: deque[tuple[float, int, int]] = deque()
        self._to_host_free_s = 0.0

    def write(self, data: bytes, baud_rate: int) -> None:
        """The host says `data` at its rate."""
        at_s = max(self._timeline.now_s, self._to_module_free_s)
        for byte in data[: _LINE_BYTES - len(self._to_module)]:
            at_s += _BITS_A_BYTE / baud_rate
            self._to_module.append((at_s, byte, baud_rate))
        self._to_module_free_s = at_s
        self._await_arrival()

    def read(self, baud_rate: int) -> bytes:
        """What has reached the host, which listens at its rate."""
        now_s, arrived = self._timeline.now_s, bytearray()
        while self._to_host and self._to_host[0][0] <= now_s:
            _, byte, rate = self._to_host.popleft()
            arrived.append(byte if rate == baud_rate else _garbled(byte))
        return bytes(arrived)

    @property
    def next_for_host_s(self) -> float:
        """When the next byte reaches the host; infinite when none is on the way."""
        return self._to_host[0][0] if self._to_host else math.inf

    def say(self, data: bytes) -> float:
        """The module says `data`; returns when the last byte is out."""
        at_s = max(self._timeline.now_s, self._to_host_free_s)
        for byte in data[: _LINE_BYTES - len(self._to_host)]:
            at_s += _BITS_A_BYTE / self.baud_rate
            self._to_host.append((at_s, byte, self.baud_rate))
        self._to_host_free_s = at_s
        return at_s

    def occupy(self, seconds: float) -> None:
        """The module looks after something else and takes no bytes."""
        self._occupied_until_s = self._timeline.now_s + seconds
        self._timeline.at(self._occupied_until_s, self._drain)

    def cut(self) -> None:
        """The module loses its power: what it was saying ends, what it had not taken is gone."""
        now_s = self._timeline.now_s
        self.powered = False
        self._buffer.clear()
        self._occupied_until_s = now_s
        self._to_host = deque(entry for entry in self._to_host if entry[0] <= now_s)
        self._to_host_free_s = now_s

    def _await_arrival(self) -> None:
        if self._to_module and not self._arrival_is_due:
            self._arrival_is_due = True
            self._timeline.at(self._to_module[0][0], self._arrive)

    def _arrive(self) -> None:
        self._arrival_is_due = False
        _, byte, rate = self._to_module.popleft()
        if self.powered:
            if len(self._buffer) < _RECEIVE_BUFFER_BYTES:
                self._buffer.append(byte if rate == self.baud_rate else _garbled(byte))
            else:
                self.overrun_bytes += 1
            self._drain()
        self._await_arrival()

    def _drain(self) -> None:
        while self._buffer and self._timeline.now_s >= self._occupied_until_s:
            self._take_byte(self._buffer.popleft())


def _garbled(byte: int) -> int:
    return 255 - byte
