"""What odometry is worth, and when a match deserves belief against it: the same for every method."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.se2_arrays import between

FloatArray = NDArray[np.float64]


class OdometryNoise(Protocol):
    """A fixed part and a part of the way, and of the turn."""

    @property
    def odometry_shift_m(self) -> float: ...
    @property
    def odometry_shift_ratio(self) -> float: ...
    @property
    def odometry_turn_rad(self) -> float: ...
    @property
    def odometry_turn_ratio(self) -> float: ...


def odometry_sigma(noise: OdometryNoise, motion: FloatArray) -> FloatArray:
    """(3,): standard deviations of a motion, (3,), that odometry measured."""
    shift_m = noise.odometry_shift_m + noise.odometry_shift_ratio * float(np.hypot(motion[0], motion[1]))
    turn_rad = noise.odometry_turn_rad + noise.odometry_turn_ratio * abs(float(motion[2]))
    return np.array([shift_m, shift_m, turn_rad])


def surprise(predicted: FloatArray, pose: FloatArray, sigma: FloatArray) -> float:
    """How far a match at `pose`, (3,), is from what was predicted, in standard deviations; may be not a number."""
    return float(np.abs(between(predicted, pose) / sigma).max())


def needed_share(least: float, most: float, far: float) -> float:
    """Of points that fit: `least` at the prediction itself, `most` where a match is as `far`, 1 or more, as it may be.

    A robot that was carried off fits somewhere near by chance.
    """
    return least + min(1.0, far) * (most - least)
