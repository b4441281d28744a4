"""A flat world of walls and a scanner in it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan

FloatArray = NDArray[np.float64]


def _box(x: float, y: float, width: float, height: float) -> list[tuple[float, float, float, float]]:
    a, b = x + width, y + height
    return [(x, y, a, y), (a, y, a, b), (a, b, x, b), (x, b, x, y)]


LAB = np.array(
    _box(0.0, 0.0, 3.95, 4.2) + _box(0.3, 0.2, 0.5, 0.4) + _box(3.0, 3.5, 0.6, 0.4) + _box(1.7, 1.8, 0.5, 0.6)
)


def cast(walls: FloatArray, pose: Pose2, angles_rad: FloatArray, range_max_m: float) -> FloatArray:
    """(B,) exact distances to the nearest wall, NaN beyond `range_max_m`. `walls`: (W, 4) x1, y1, x2, y2."""
    direction = np.column_stack((np.cos(pose.theta_rad + angles_rad), np.sin(pose.theta_rad + angles_rad)))
    start, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    offset = start - (pose.x_m, pose.y_m)
    cross = direction[:, :1] * along[:, 1] - direction[:, 1:] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (offset[:, 0] * along[:, 1] - offset[:, 1] * along[:, 0]) / cross
        place = (offset[:, 0] * direction[:, 1:] - offset[:, 1] * direction[:, :1]) / cross
    distance = np.where((distance > 0) & (place >= 0) & (place <= 1), distance, np.inf)
    nearest = distance.min(axis=1)
    return np.where(nearest <= range_max_m, nearest, np.nan)


ScanMaker = Callable[..., PointScan]


@pytest.fixture
def lab() -> FloatArray:
    """(W, 4): the walls of a room of 3.95 m by 4.2 m and of three boxes in it."""
    return LAB


@pytest.fixture
def scan_from() -> ScanMaker:
    """A scan of 240 degrees and 227 beams with 1 cm of noise, as the robot makes it."""

    def make(
        walls: FloatArray,
        pose: Pose2,
        rng: np.random.Generator | None,
        odom: Pose2 | None = None,
        stamp_s: float = 0.0,
        range_max_m: float = 4.0,
        noise_m: float = 0.01,
    ) -> PointScan:
        angles = np.linspace(-math.radians(120), math.radians(120), 227)
        ranges = cast(walls, pose, angles, range_max_m)
        if rng is not None:
            ranges = ranges + rng.normal(0.0, noise_m, len(ranges))
        seen = np.isfinite(ranges)
        points = np.column_stack((ranges * np.cos(angles), ranges * np.sin(angles)))[seen]
        return PointScan(stamp_s, odom or pose, np.zeros(2), points)

    return make


@pytest.fixture
def lap() -> Callable[[int], list[Pose2]]:
    """Poses once around the box in the middle of the lab, at equal distances."""

    def make(count: int) -> list[Pose2]:
        angle = np.linspace(0.0, math.tau, count)
        return [
            Pose2(1.95 + 1.05 * math.sin(a), 2.1 - 1.15 * math.cos(a), math.remainder(float(a), math.tau))
            for a in angle.tolist()
        ]

    return make
