"""Quadrature encoders of the rear wheels by edge events of the kernel.

The kernel stamps and queues every edge, so that none is missed while nobody reads; each event tells which line
changed to which level. All four edges of a tick are followed, and a tick is counted for every four of them: a wheel
that trembles on an edge counts nothing.
"""

from __future__ import annotations

import logging
import os
import select
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import DeviceError, EncoderCount
from robot_app.drivers.config import EncoderConfig
from robot_app.drivers.gpio import load_gpiod
from shared.runtime.clock import Clock

_log = logging.getLogger(__name__)
# struct gpio_v2_line_event of linux/gpio.h, 48 bytes: reading it whole is 60 times faster than an object each
EVENT = np.dtype(
    [
        ("timestamp_ns", "<u8"),
        ("id", "<u4"),
        ("offset", "<u4"),
        ("seqno", "<u4"),
        ("line_seqno", "<u4"),
        ("padding", "<u4", 6),
    ]
)
_RISING = 1
_QUEUED_EVENTS = 1024  # what the kernel keeps at most: 0.5 s at full speed
_READ_BYTES = 256 * EVENT.itemsize
_READS_AT_ONCE = 8
_EDGES_PER_TICK = 4
# Place in the cycle A B = 00, 10, 11, 01: forward turns go through it in this order.
_PHASE = {(0, 0): 0, (1, 0): 1, (1, 1): 2, (0, 1): 3}


class _Wheel:
    """Follows the two lines of one wheel."""

    def __init__(self, reverse: bool) -> None:
        self._sign = -1 if reverse else 1
        self.levels = [0, 0]
        self.edges = 0
        self.impossible = 0

    def set_levels(self, a: int, b: int) -> None:
        self.levels = [a, b]

    def edge(self, line: int, level: int) -> None:
        before = _PHASE[self.levels[0], self.levels[1]]
        if self.levels[line] == level:
            self.impossible += 1  # an edge is missing between two of the same kind
        self.levels[line] = level
        step = (_PHASE[self.levels[0], self.levels[1]] - before + 1) % 4 - 1
        self.edges += self._sign * step

    @property
    def ticks(self) -> int:
        return self.edges // _EDGES_PER_TICK


class QuadratureEncoders:
    """Lost wires cannot be told from standing wheels here; a motor that gets current and does not turn can."""

    def __init__(self, config: EncoderConfig, clock: Clock) -> None:
        self._clock = clock
        self._name = f"encoders at {config.chip}"
        left, right = _Wheel(config.left_reversed), _Wheel(config.right_reversed)
        self._left, self._right = left, right
        self._lines = {config.left_a: (left, 0), config.left_b: (left, 1)}
        self._lines |= {config.right_a: (right, 0), config.right_b: (right, 1)}
        self._last_seqno: int | None = None
        self.lost_edges = 0
        self._request: Any = self._open(config)
        self._read_levels()

    @property
    def impossible_edges(self) -> int:
        return self._left.impossible + self._right.impossible

    def read(self, timeout_s: float) -> EncoderCount:
        """The count by now; waits for an edge at most `timeout_s`, and answers without one as well."""
        if self._request is None:
            raise DeviceError(f"{self._name}: is closed")
        try:
            self._drain(timeout_s)
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self._name}: cannot be read: {error}") from error
        return EncoderCount(self._clock.now_s(), self._left.ticks, self._right.ticks)

    def close(self) -> None:
        request, self._request = self._request, None
        if request is not None:
            request.release()

    def _open(self, config: EncoderConfig) -> Any:
        gpiod = load_gpiod("encoders")
        line = gpiod.line
        settings = gpiod.LineSettings(
            direction=line.Direction.INPUT,
            edge_detection=line.Edge.BOTH,
            bias=line.Bias.PULL_UP if config.pull_up else line.Bias.AS_IS,
        )
        try:
            return gpiod.request_lines(
                config.chip,
                consumer="robot-app encoders",
                config={tuple(self._lines): settings},
                event_buffer_size=_QUEUED_EVENTS,
            )
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self._name}, lines {', '.join(map(str, self._lines))}: {error}") from error

    def _drain(self, timeout_s: float) -> None:
        for i in range(_READS_AT_ONCE):
            if not select.select([self._request.fd], [], [], max(0.0, timeout_s) if i == 0 else 0.0)[0]:
                return
            data = os.read(self._request.fd, _READ_BYTES)
            whole = len(data) // EVENT.itemsize * EVENT.itemsize
            self._take(np.frombuffer(data[:whole], EVENT))

    def _take(self, events: NDArray[np.void]) -> None:
        if not len(events):
            return
        lost = self._count_lost(events["seqno"])
        for offset, kind in zip(events["offset"].tolist(), events["id"].tolist(), strict=True):
            wheel_line = self._lines.get(offset)
            if wheel_line is not None:
                wheel_line[0].edge(wheel_line[1], int(kind == _RISING))
        if lost:
            self.lost_edges += lost
            _log.warning("%s: %d edges were lost; nobody read them in time", self._name, lost)
            self._read_levels()

    def _count_lost(self, seqno: NDArray[np.uint32]) -> int:
        """The kernel numbers the events of a request, and drops the oldest when its queue is full."""
        first = int(seqno[0]) - 1 if self._last_seqno is None else self._last_seqno
        self._last_seqno = int(seqno[-1])
        return (self._last_seqno - first) % 2**32 - len(seqno)

    def _read_levels(self) -> None:
        offsets = list(self._lines)
        try:
            levels = [int(value.value) for value in self._request.get_values(offsets)]
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self._name}: levels cannot be read: {error}") from error
        self._left.set_levels(levels[0], levels[1])
        self._right.set_levels(levels[2], levels[3])
