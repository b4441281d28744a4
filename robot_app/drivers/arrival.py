"""When a device that sends by itself measured: its own clock, laid over the host's."""

from __future__ import annotations

_DRIFT = 2e-4  # quartz clocks differ by less than 200 ppm
_JUMP_S = 3600.0  # so late is nothing that waited in a buffer: the device's clock was set


class ArrivalFilter:
    """Arrival times without their jitter.

    A sample may arrive late and never early, so the smallest difference between arrival and the device's own stamp
    is the true one. It may grow by the drift between two clocks.
    """

    def __init__(self) -> None:
        self._offset_s: float | None = None
        self._last_s = 0.0

    def arrival_s(self, device_s: float, arrived_s: float) -> float:
        """When the sample stamped `device_s` would have arrived on an idle host; not after `arrived_s`."""
        offset_s = arrived_s - device_s
        if self._offset_s is not None:
            grown_s = self._offset_s + _DRIFT * max(0.0, arrived_s - self._last_s)
            offset_s = offset_s if offset_s - grown_s > _JUMP_S else min(offset_s, grown_s)
        self._offset_s, self._last_s = offset_s, arrived_s
        return device_s + offset_s


class WrappingCounter:
    """Seconds of a counter that starts again at `2 ** bits` ticks."""

    def __init__(self, bits: int, tick_s: float) -> None:
        self._modulus = 1 << bits
        self._tick_s = tick_s
        self._last: int | None = None
        self._ticks = 0

    def seconds(self, count: int) -> float:
        """Since the first call; goes back by less than half a turn when `count` does."""
        if self._last is not None:
            step = (count - self._last) % self._modulus
            self._ticks += step if step < self._modulus // 2 else step - self._modulus
        self._last = count
        return self._ticks * self._tick_s
