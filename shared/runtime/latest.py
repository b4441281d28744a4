"""The way a sampled value passes between threads of different speed."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Stamped(Generic[T]):
    """A value and when it was true."""

    value: T
    stamp_s: float


class Latest(Generic[T]):
    """Holds the newest value; a reader must say how old a value may be."""

    def __init__(self) -> None:
        self._stamped: Stamped[T] | None = None
        self._changed = threading.Condition()

    def put(self, value: T, stamp_s: float) -> None:
        with self._changed:
            self._stamped = Stamped(value, stamp_s)
            self._changed.notify_all()

    def stamped(self) -> Stamped[T] | None:
        return self._stamped

    def fresh(self, now_s: float, max_age_s: float) -> T | None:
        """The value unless it is older than `max_age_s`."""
        stamped = self._stamped
        if stamped is None or now_s - stamped.stamp_s > max_age_s:
            return None
        return stamped.value

    def age_s(self, now_s: float) -> float:
        stamped = self._stamped
        return float("inf") if stamped is None else now_s - stamped.stamp_s
