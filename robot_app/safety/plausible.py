"""Sensors that go on sending and say nothing: covered, hanging, or sending what no room looks like."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import ImuSample, RawScan

_IMU_REPEATS = 4  # of all six values, each of which has noise
_JUMP_M = 0.5  # between neighbouring beams
_JUMPS_SHARE = 0.4  # a room has one jump in ten at most; ranges drawn by lot have three in four


class ScanWatch:
    """Noise repeats nothing, so a scan that is the last one again is not measured."""

    def __init__(self, min_beams: int) -> None:
        self._min_beams = min_beams
        self._last_ranges_m: NDArray[np.float32] | None = None

    def can_see(self, raw: RawScan) -> bool:
        last, self._last_ranges_m = self._last_ranges_m, raw.ranges_m
        if last is not None and np.array_equal(raw.ranges_m, last, equal_nan=True):
            return False
        ranges_m = raw.ranges_m[np.isfinite(raw.ranges_m)]
        return len(ranges_m) >= self._min_beams and not _is_garbage(ranges_m)


def _is_garbage(ranges_m: NDArray[np.float32]) -> bool:
    """`ranges_m`: (N,), those that were measured, in the order of the beams."""
    jumps = np.abs(np.diff(ranges_m)) > _JUMP_M
    return bool(jumps.mean() > _JUMPS_SHARE)


class ImuWatch:
    """One that hangs repeats its last sample; noise does so now and then, but not four times."""

    def __init__(self) -> None:
        self._last: tuple[float, ...] = ()
        self._repeats = 0

    def is_alive(self, imu: ImuSample) -> bool:
        values = (*imu.gyro_radps, *imu.acceleration_mps2)
        self._repeats = self._repeats + 1 if values == self._last else 0
        self._last = values
        return self._repeats < _IMU_REPEATS
