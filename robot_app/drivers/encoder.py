"""Quadrature encoders of the wheels by edge events of the kernel.

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

from robot_app.drivers.base import DeviceError, EncoderCount, OmniCount
from robot_app.drivers.config import EncoderConfig, OmniWheelsConfig
from robot_app.drivers.gpio import advice, load_gpiod
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

    def __init__(self, line_a: int, line_b: int, reverse: bool) -> None:
        self.lines = (line_a, line_b)
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


class _Counter:
    """Counts the ticks of some wheels at one GPIO chip.

    Lost wires cannot be told from standing wheels here; a motor that gets current and does not turn can.
    """

    def __init__(self, chip: str, wheels: tuple[_Wheel, ...], pull_up: bool) -> None:
        self._name = f"encoders at {chip}"
        self._wheels = wheels
        self._lines = {line: (wheel, i) for wheel in wheels for i, line in enumerate(wheel.lines)}
        self._last_seqno: int | None = None
        self.lost_edges = 0
        self._tell_at = 1  # lost edges: a line that chatters must not fill the log
        self._request: Any = self._open(chip, pull_up)
        self._read_levels()

    @property
    def impossible_edges(self) -> int:
        return sum(wheel.impossible for wheel in self._wheels)

    def ticks(self, timeout_s: float) -> list[int]:
        """The counts by now; waits for an edge at most `timeout_s`, and answers without one as well."""
        if self._request is None:
            raise DeviceError(f"{self._name}: is closed")
        try:
            self._drain(timeout_s)
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self._name}: cannot be read: {error}") from error
        return [wheel.ticks for wheel in self._wheels]

    def close(self) -> None:
        request, self._request = self._request, None
        if request is not None:
            request.release()

    def _open(self, chip: str, pull_up: bool) -> Any:
        gpiod = load_gpiod("encoders")
        line = gpiod.line
        settings = gpiod.LineSettings(
            direction=line.Direction.INPUT,
            edge_detection=line.Edge.BOTH,
            bias=line.Bias.PULL_UP if pull_up else line.Bias.AS_IS,
        )
        try:
            return gpiod.request_lines(
                chip,
                consumer="robot-app encoders",
                config={tuple(self._lines): settings},
                event_buffer_size=_QUEUED_EVENTS,
            )
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self._name}, lines {', '.join(map(str, self._lines))}: {advice(error)}") from error

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
            if self.lost_edges >= self._tell_at:
                self._tell_at = 2 * self.lost_edges
                _log.warning("%s: %d edges were lost so far; nobody read them in time", self._name, self.lost_edges)
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
        for i, wheel in enumerate(self._wheels):
            wheel.set_levels(levels[2 * i], levels[2 * i + 1])


class QuadratureEncoders(_Counter):
    """Of the car's rear wheels."""

    def __init__(self, config: EncoderConfig, clock: Clock) -> None:
        self._clock = clock
        c = config
        wheels = _Wheel(c.left_a, c.left_b, c.left_reversed), _Wheel(c.right_a, c.right_b, c.right_reversed)
        super().__init__(c.chip, wheels, c.pull_up)

    @property
    def losses(self) -> dict[str, int]:
        return {"lost edges": self.lost_edges, "impossible edges": self.impossible_edges}

    def read(self, timeout_s: float) -> EncoderCount:
        """Waits for an edge at most `timeout_s`, and answers without one as well."""
        left, right = self.ticks(timeout_s)
        return EncoderCount(self._clock.now_s(), left, right)


class OmniEncoders(_Counter):
    """Of the omnidirectional robot's three wheels."""

    def __init__(self, config: OmniWheelsConfig, clock: Clock) -> None:
        self._clock = clock
        wheels = tuple(_Wheel(w.encoder_a, w.encoder_b, w.encoder_reversed) for w in config.wheels)
        super().__init__(config.gpio_chip, wheels, config.pull_up)

    def read(self, timeout_s: float) -> OmniCount:
        """Waits for an edge at most `timeout_s`, and answers without one as well."""
        right, left, back = self.ticks(timeout_s)
        return OmniCount(self._clock.now_s(), (right, left, back))
