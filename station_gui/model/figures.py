"""How the link and the map do: rates over the last seconds and over the mission."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass

_WINDOW_S = 3.0
_KEPT = 1024


class RateMeter:
    """Events and their amounts per second, over the last three seconds."""

    def __init__(self) -> None:
        self._events: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        self._lock = threading.Lock()

    def add(self, now_s: float, amount: float = 1.0) -> None:
        with self._lock:
            self._events.append((now_s, amount))

    def per_second(self, now_s: float) -> float:
        return sum(amount for _, amount in self._recent(now_s)) / _WINDOW_S

    def mean(self, now_s: float) -> float:
        """The mean amount of an event; 0 when there was none."""
        recent = self._recent(now_s)
        return sum(amount for _, amount in recent) / len(recent) if recent else 0.0

    def _recent(self, now_s: float) -> list[tuple[float, float]]:
        with self._lock:
            return [event for event in self._events if now_s - event[0] <= _WINDOW_S]


@dataclass(slots=True)
class MissionFigures:
    """Totals since the station was made."""

    observations: int = 0
    observation_bytes: int = 0
    observations_dropped: int = 0  # the mapping was too slow for them
    updates_seen: int = 0  # different maps that the operator's window has looked at
    first_update_s: float = 0.0
    last_update_s: float = 0.0

    def saw_update(self, now_s: float) -> None:
        if self.updates_seen == 0:
            self.first_update_s = now_s
        self.updates_seen += 1
        self.last_update_s = now_s

    @property
    def refresh_hz(self) -> float:
        """Map updates per second that reached the operator, from the first to the last."""
        seconds = self.last_update_s - self.first_update_s
        return (self.updates_seen - 1) / seconds if seconds > 0 else 0.0

    @property
    def bytes_per_observation(self) -> float:
        return self.observation_bytes / self.observations if self.observations else 0.0
