"""Where a simulated sensor leaves its newest sample."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

T = TypeVar("T")


class Mailbox(Generic[T]):
    """The newest sample; each is handed out once.

    All mailboxes of a world share the condition that the world notifies whenever it has moved.
    """

    def __init__(self, moved: threading.Condition) -> None:
        self._moved = moved
        self._value: T | None = None

    def put(self, value: T) -> None:
        self._value = value

    def take(self, timeout_s: float) -> T | None:
        """The newest sample that was not taken before; waits for one at most `timeout_s`."""
        with self._moved:
            if self._value is None and timeout_s > 0:
                self._moved.wait_for(lambda: self._value is not None, timeout_s)
            value, self._value = self._value, None
            return value
