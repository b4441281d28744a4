"""The mission log: what happened, for the operator. Bounded; any thread may write."""

from __future__ import annotations

import logging
import threading
from collections import deque

from shared.runtime.clock import Clock
from station_gui.model.view import LogEntry, Severity

_log = logging.getLogger("station")
_LEVELS = {Severity.INFO: logging.INFO, Severity.WARNING: logging.WARNING, Severity.ERROR: logging.ERROR}
_KEPT = 2000


class Journal:
    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._entries: deque[LogEntry] = deque(maxlen=_KEPT)
        self._count = 0
        self._lock = threading.Lock()

    @property
    def length(self) -> int:
        """How many entries there have been."""
        return self._count

    def add(self, severity: Severity, text: str) -> None:
        with self._lock:
            self._entries.append(LogEntry(self._clock.now_s(), severity, text))
            self._count += 1
        _log.log(_LEVELS[severity], "%s", text)

    def since(self, index: int) -> list[LogEntry]:
        """The entries from the index-th on, as far as they are kept."""
        with self._lock:
            entries = list(self._entries)
            first = self._count - len(entries)
        return entries[max(0, index - first) :]
