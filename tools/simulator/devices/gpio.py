"""GPIO lines behind the interface of gpiod 2: edges are the kernel's own structures on a real file descriptor."""

from __future__ import annotations

import errno
import os
import struct
from dataclasses import dataclass
from enum import Enum
from types import SimpleNamespace
from typing import Any

_EVENT = struct.Struct("<QIIII24x")  # struct gpio_v2_line_event
_CYCLE = ((0, 0), (1, 0), (1, 1), (0, 1))  # levels of A and B in forward turns


class Value(Enum):
    INACTIVE = 0
    ACTIVE = 1


class Direction(Enum):
    INPUT = 2
    OUTPUT = 3


class Edge(Enum):
    BOTH = 4


class Bias(Enum):
    AS_IS = 1
    PULL_UP = 5


@dataclass(frozen=True)
class LineSettings:
    direction: Direction
    edge_detection: Edge | None = None
    bias: Bias = Bias.AS_IS
    output_value: Value = Value.INACTIVE


class Request:
    """Lines in use. An edge becomes an event if the lines were asked for events."""

    def __init__(self, chip: GpioChip, lines: tuple[int, ...], settings: LineSettings, buffer_size: int) -> None:
        self._chip = chip
        self._lines = lines
        self.settings = settings
        self.buffer_size = buffer_size
        self._seqno = 0
        self.fd, self._events = os.pipe()

    def get_values(self, lines: list[int]) -> list[Value]:
        return [Value(self._chip.levels.get(line, 0)) for line in lines]

    def set_values(self, values: dict[int, Value]) -> None:
        if self._chip.is_broken:
            raise OSError(errno.EIO, "Input/output error")
        for line, value in values.items():
            self._chip.set(line, value.value)

    def release(self) -> None:
        self._chip.used -= set(self._lines)
        self._chip.requests.remove(self)
        os.close(self.fd)
        os.close(self._events)

    def edge(self, line: int, level: int, lost: bool) -> None:
        if self.settings.edge_detection is not None and line in self._lines:
            self._seqno += 1
            if not lost:
                event = _EVENT.pack(self._chip.now_ns, 1 if level else 2, line, self._seqno, self._seqno)
                os.write(self._events, event)


class GpioChip:
    def __init__(self, path: str = "/dev/gpiochip0") -> None:
        self.path = path
        self.levels: dict[int, int] = {}
        self.history: list[tuple[int, int]] = []
        self.used: set[int] = set()
        self.requests: list[Request] = []
        self.now_ns = 0
        self.is_broken = False

    def library(self) -> SimpleNamespace:
        """A stand-in for the module gpiod; its `line` is a module of its own."""
        line = SimpleNamespace(Value=Value, Direction=Direction, Edge=Edge, Bias=Bias)
        return SimpleNamespace(request_lines=self._request, LineSettings=LineSettings, line=line)

    def set(self, line: int, level: int, lost: bool = False) -> None:
        """Change a level; `lost`: the event falls out of a full queue."""
        self.now_ns += 1000
        if self.levels.get(line, 0) != level:
            self.levels[line] = level
            self.history.append((line, level))
            for request in self.requests:
                request.edge(line, level, lost)

    def turn(self, line_a: int, line_b: int, edges: int, lost: bool = False) -> None:
        """Turn an encoder by quarter ticks, forward where A leads B."""
        for _ in range(abs(edges)):
            place = _CYCLE.index((self.levels.get(line_a, 0), self.levels.get(line_b, 0)))
            a, b = _CYCLE[(place + (1 if edges > 0 else -1)) % 4]
            self.set(line_a, a, lost)
            self.set(line_b, b, lost)

    def _request(
        self, path: str, config: dict[Any, LineSettings], consumer: str, event_buffer_size: int = 0
    ) -> Request:
        if path != self.path:
            raise FileNotFoundError(errno.ENOENT, "No such file or directory", path)
        ((lines, settings),) = config.items()
        if self.used & set(lines):
            raise OSError(errno.EBUSY, "Device or resource busy")
        self.used |= set(lines)
        request = Request(self, tuple(lines), settings, event_buffer_size)
        self.requests.append(request)
        if settings.direction is Direction.OUTPUT:
            request.set_values(dict.fromkeys(lines, settings.output_value))
        return request
