"""The only module of the product that knows what time it is."""

from __future__ import annotations

import threading
import time
from typing import Protocol


class Clock(Protocol):
    """Seconds that only go forward."""

    def now_s(self) -> float: ...

    def wait(self, stop: threading.Event, until_s: float) -> bool:
        """Wait until `until_s` or until `stop` is set; True when it was set."""
        ...


class MonotonicClock:
    """Real time, from zero at its making."""

    def __init__(self) -> None:
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        return time.monotonic() - self._start_s

    def wait(self, stop: threading.Event, until_s: float) -> bool:
        return stop.wait(max(0.0, until_s - self.now_s()))


class ManualClock:
    """Time that stands still until somebody moves it: for lock-step missions and tests."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def now_s(self) -> float:
        return self._now_s

    def advance_to(self, time_s: float) -> None:
        if time_s < self._now_s:
            raise ValueError(f"time cannot go back from {self._now_s} s to {time_s} s")
        self._now_s = time_s

    def advance(self, seconds: float) -> None:
        self.advance_to(self._now_s + seconds)

    def wait(self, stop: threading.Event, until_s: float) -> bool:
        self.advance_to(max(self._now_s, until_s))
        return stop.is_set()


def stopwatch_s() -> float:
    """A high-resolution reading for measuring how long a computation took."""
    return time.perf_counter()


def processor_time_s() -> float:
    """What the calling thread has computed so far; waiting takes none."""
    return time.thread_time()


def wall_clock_ns() -> int:
    """Nanoseconds since 1970, for the head of a recording."""
    return time.time_ns()


def wall_clock_name() -> str:
    """The time of day as part of a file name, to the second, UTC."""
    return time.strftime("%Y%m%d-%H%M%S", time.gmtime())
