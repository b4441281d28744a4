"""What a driver does after it has lost its device: it raises, and tries again with the next read, not too often."""

from __future__ import annotations

from robot_app.drivers.base import DeviceError
from shared.runtime.clock import Clock


class Reopening:
    """Remembers why the device was lost and when to try again."""

    def __init__(self, clock: Clock, every_s: float) -> None:
        self._clock = clock
        self._every_s = every_s
        self._fault: str | None = None
        self._next_s = 0.0

    @property
    def is_lost(self) -> bool:
        return self._fault is not None

    def lost(self, error: DeviceError) -> None:
        self._fault = str(error)
        self._next_s = self._clock.now_s() + self._every_s

    def found(self) -> None:
        self._fault = None

    def check_found(self) -> None:
        """Raises the `DeviceError` again as long as the device has not measured anything since."""
        if self._fault is not None:
            raise DeviceError(self._fault)

    def check_due(self) -> None:
        """Raises the `DeviceError` again while it is too early for another try."""
        if self._fault is not None and self._clock.now_s() < self._next_s:
            raise DeviceError(self._fault)
