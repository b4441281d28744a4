"""Emulated modules as ports: in the process on any clock, or on pseudo-terminals in real time."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import termios
import threading
import tty
from collections.abc import Callable, Sequence
from typing import Protocol

from shared.link.base import LinkError
from shared.link.byte_port import PortStatistics
from shared.link.es920lr.settings import BAUD_RATES
from shared.runtime.clock import ManualClock, MonotonicClock
from tools.simulator.devices.es920lr import EmulatedEs920lr
from tools.simulator.radio.timeline import Timeline

_LONGEST_SLEEP_S = 0.02  # so that somebody who switches a module off is soon heard
_JOIN_TIMEOUT_S = 3.0
_SPEEDS = {getattr(termios, f"B{rate}"): rate for rate in BAUD_RATES}
_UNPLUGGED = "unplugged"


class EmulatedPort:
    """The host's end of a module's serial line.

    On a manual clock a `read` that waits moves `waiting_clock` to the next event; without one it never waits, for
    those who move the clock themselves.
    """

    def __init__(self, module: EmulatedEs920lr, timeline: Timeline, waiting_clock: ManualClock | None = None) -> None:
        self.name = module.name
        self.statistics = PortStatistics()
        self.baud_rate = module.flash.baud_rate
        self._module = module
        self._timeline = timeline
        self._clock = waiting_clock
        self._closed: str | None = None

    def write(self, data: bytes) -> None:
        self._fail_if_closed()
        self._timeline.run()
        self._module.line.write(data, self.baud_rate)
        self.statistics.written_bytes += len(data)

    def read(self, timeout_s: float) -> bytes:
        self._fail_if_closed()
        self._timeline.run()
        data = self._module.line.read(self.baud_rate)
        if not data and self._clock is not None and timeout_s > 0:
            data = self._wait(self._clock, timeout_s)
        self.statistics.read_bytes += len(data)
        return data

    def set_baud_rate(self, baud_rate: int) -> bool:
        self._fail_if_closed()
        self.baud_rate = baud_rate
        return True

    def close(self) -> None:
        self._closed = self._closed or "the port is closed"

    def unplug(self) -> None:
        self._closed = _UNPLUGGED

    def _wait(self, clock: ManualClock, timeout_s: float) -> bytes:
        until_s = clock.now_s() + timeout_s
        while clock.now_s() < until_s:
            next_s = min(self._timeline.next_s, self._module.line.next_for_host_s, until_s)
            clock.advance_to(max(next_s, clock.now_s()))
            self._timeline.run()
            if data := self._module.line.read(self.baud_rate):
                return data
        return b""

    def _fail_if_closed(self) -> None:
        if self._closed is not None:
            raise LinkError(f"{self.name}: {self._closed}")


class Wire(Protocol):
    """The host's end of a module's serial line: a file to read and write, and the rate the host speaks at."""

    @property
    def module(self) -> EmulatedEs920lr: ...
    @property
    def master(self) -> int: ...
    @property
    def path(self) -> str: ...
    @property
    def host_baud_rate(self) -> int: ...

    def close(self) -> None: ...


class _Pty:
    def __init__(self, module: EmulatedEs920lr) -> None:
        self.module = module
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(self.slave)

    @property
    def host_baud_rate(self) -> int:
        """What the program has set; at a rate that the module does not know it hears garbage."""
        return _SPEEDS.get(termios.tcgetattr(self.slave)[4], 1_200)

    def close(self) -> None:
        for fd in (self.master, self.slave):
            with contextlib.suppress(OSError):
                os.close(fd)


class PtyRadios:
    """Modules on pseudo-terminals in real time, all in one thread with their air. Use as a context manager.

    `paths[i]` is the port of module i. Touch modules and channel only within `do`.
    """

    def __init__(
        self,
        clock: MonotonicClock,
        timeline: Timeline,
        modules: Sequence[EmulatedEs920lr],
        wires: Sequence[Wire] = (),
    ) -> None:
        """`wires`: further modules of the same air, on ends that somebody else made."""
        self._timeline = timeline
        self._clock = clock
        self._ptys: list[Wire] = [*map(_Pty, modules), *wires]
        self.paths = [p.path for p in self._ptys]
        self._plugged = list(self._ptys)
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="emulated radios", daemon=True)
        for wire in self._ptys:
            wire.module.power_on()
        self._thread.start()

    def __enter__(self) -> PtyRadios:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def do(self, action: Callable[[], None]) -> None:
        with self._lock:
            self._timeline.run()
            action()

    def unplug(self, index: int) -> None:
        """The port vanishes while it may be open."""
        with self._lock:
            unplugged = self._ptys[index]
            self._plugged = [p for p in self._plugged if p is not unplugged]
            unplugged.close()

    def close(self) -> None:
        self._stop.set()
        self._thread.join(_JOIN_TIMEOUT_S)
        for p in self._plugged:
            p.close()
        self._plugged = []

    def _run(self) -> None:
        while not self._stop.is_set():
            with self._lock:
                plugged = list(self._plugged)
                wait_s = self._next_s() - self._clock.now_s()
            with contextlib.suppress(OSError, ValueError):  # unplugged meanwhile
                select.select([p.master for p in plugged], [], [], min(max(wait_s, 0.0), _LONGEST_SLEEP_S))
            with self._lock:
                for p in self._plugged:
                    self._serve(p)

    def _next_s(self) -> float:
        lines = (p.module.line.next_for_host_s for p in self._plugged)
        return min(self._timeline.next_s, *lines) if self._plugged else self._timeline.next_s

    def _serve(self, p: Wire) -> None:
        self._timeline.run()
        with contextlib.suppress(BlockingIOError):
            if data := os.read(p.master, 4_096):
                p.module.line.write(data, p.host_baud_rate)
        if said := p.module.line.read(p.host_baud_rate):
            with contextlib.suppress(BlockingIOError):  # nobody reads: a real adapter loses it too
                os.write(p.master, said)
