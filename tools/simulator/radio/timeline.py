"""Events at their exact times, however coarsely the clock moves."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable

from shared.runtime.clock import Clock


class Entry:
    """Something that will happen, unless it is cancelled."""

    __slots__ = ("action", "cancelled")

    def __init__(self, action: Callable[[], None]) -> None:
        self.action = action
        self.cancelled = False

    def cancel(self) -> None:
        self.cancelled = True


class Timeline:
    """Runs events in the order of their times; those of one time in the order in which they were made."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: list[tuple[float, int, Entry]] = []
        self._count = 0
        self._event_s: float | None = None

    @property
    def now_s(self) -> float:
        """The time of the event that is happening, else that of the clock."""
        return self._clock.now_s() if self._event_s is None else self._event_s

    @property
    def next_s(self) -> float:
        """When the next event is due; infinite when there is none."""
        while self._waiting and self._waiting[0][2].cancelled:
            heapq.heappop(self._waiting)
        return self._waiting[0][0] if self._waiting else math.inf

    def after(self, delay_s: float, action: Callable[[], None]) -> Entry:
        return self.at(self.now_s + delay_s, action)

    def at(self, time_s: float, action: Callable[[], None]) -> Entry:
        entry = Entry(action)
        self._count += 1
        heapq.heappush(self._waiting, (max(time_s, self.now_s), self._count, entry))
        return entry

    def run(self) -> None:
        """Let everything happen that is due by now."""
        if self._event_s is not None:
            return
        until_s = self._clock.now_s()
        try:
            while self.next_s <= until_s:
                self._event_s, _, entry = heapq.heappop(self._waiting)
                entry.action()
        finally:
            self._event_s = None
