"""Where the wall beside the robot leads: the way a disc takes that rolls along it.

Walls and clutter are one thing here. The disc bridges gaps that are narrower than itself, follows inner corners
and wraps round outer corners, so its way is the "virtual wall" of what the car's body can pass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.control import _kernels
from shared.geometry.se2 import Pose2


@dataclass(frozen=True, slots=True)
class WallTraceConfig:
    distance_m: float = 0.45  # from the wall to the middle of the car, where there is room for it
    pass_radius_m: float = 0.36  # gaps narrower than twice this are wall: the car could not turn round in them
    tightest_m: float = 0.13  # the narrowest place, from its middle, in which a way is still looked for
    reach_m: float = 1.3  # a wall farther aside than this is not in sight
    preview_m: float = 1.6  # length of the way that is looked at
    step_m: float = 0.025
    cell_m: float = 0.03
    cells: int = 120  # 3.6 m
    middle_m: float = 0.13  # of the car, ahead of its origin


@dataclass(frozen=True, slots=True, eq=False)
class WallTrace:
    """`way_m`: (N, 2), odom frame, N >= 2, the way along the wall, from beside the robot onwards."""

    way_m: NDArray[np.float64]


class WallTracer:
    """Finds the way along the wall at one side; keeps only buffers between calls."""

    def __init__(self, config: WallTraceConfig, side: int) -> None:
        """`side`: +1 follows walls at the left, -1 at the right."""
        self._config = config
        self._side = float(side)
        self._field_m = np.zeros((config.cells, config.cells))
        self._way_m = np.zeros((round(config.preview_m / config.step_m), 2))
        self._left_m = self._low_m = 0.0

    def trace(self, points_m: NDArray[np.float64], odom_from_robot: Pose2) -> WallTrace | None:
        """None when there is no wall in sight. `points_m`: (N, 2), odom frame."""
        middle = odom_from_robot.apply(np.array([[self._config.middle_m, 0.0]]))[0]
        self._make_field(points_m, middle)
        level, start = self._touching_disc(middle, odom_from_robot.theta_rad)
        if start is None:
            return None
        count = _kernels.roll_along(
            self._field_m,
            self._left_m,
            self._low_m,
            self._config.cell_m,
            start,
            self._side,
            level,
            max(self._config.distance_m, level),
            self._config.step_m,
            self._way_m,
        )
        return WallTrace(self._way_m[:count].copy()) if count >= 2 else None

    def _make_field(self, points_m: NDArray[np.float64], middle_m: NDArray[np.float64]) -> None:
        cell = self._config.cell_m
        half = self._config.cells // 2
        self._left_m = (math.floor(middle_m[0] / cell) - half) * cell
        self._low_m = (math.floor(middle_m[1] / cell) - half) * cell
        _kernels.distance_field(points_m, self._left_m, self._low_m, cell, 2 * self._config.reach_m, self._field_m)

    def _touching_disc(
        self, middle_m: NDArray[np.float64], heading_rad: float
    ) -> tuple[float, NDArray[np.float64] | None]:
        """The radius of the disc and where it touches the wall nearest to the robot on the wall's side."""
        config = self._config
        aside = heading_rad + self._side * math.pi / 2
        widest = _kernels.widest_on_way(
            self._field_m, self._left_m, self._low_m, config.cell_m, middle_m, aside, config.reach_m
        )
        level = min(config.pass_radius_m, max(config.tightest_m, widest - config.cell_m))
        slope = self._slope(middle_m)
        at_wall = self._field(middle_m) < level and slope @ _unit(aside) < 0
        if at_wall:
            return level, middle_m
        spread = [math.radians(d) for d in (0, 15, -15, 30, -30, 45, -45, 60, -60)]
        found = self._nearest_contact(middle_m, [aside - self._side * s for s in spread], level)
        if found is None:
            ahead = [heading_rad + self._side * math.radians(d) for d in (20, 10, 0, -10, -20)]
            found = self._nearest_contact(middle_m, ahead, level)
        return level, found

    def _nearest_contact(
        self, middle_m: NDArray[np.float64], directions_rad: list[float], level_m: float
    ) -> NDArray[np.float64] | None:
        nearest, contact = math.inf, None
        for direction in directions_rad:
            walked = _kernels.walk_to_level(
                self._field_m,
                self._left_m,
                self._low_m,
                self._config.cell_m,
                middle_m,
                direction,
                level_m,
                self._config.reach_m,
            )
            if walked < nearest:
                nearest, contact = walked, middle_m + walked * _unit(direction)
        return contact

    def _field(self, point_m: NDArray[np.float64]) -> float:
        return float(
            _kernels.sample_field(self._field_m, self._left_m, self._low_m, self._config.cell_m, point_m[0], point_m[1])
        )

    def _slope(self, point_m: NDArray[np.float64]) -> NDArray[np.float64]:
        slope = np.zeros(2)
        _kernels.field_slope(
            self._field_m, self._left_m, self._low_m, self._config.cell_m, point_m[0], point_m[1], slope
        )
        return slope


def _unit(direction_rad: float) -> NDArray[np.float64]:
    return np.array([math.cos(direction_rad), math.sin(direction_rad)])
