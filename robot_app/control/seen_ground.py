"""Which ground near the robot has been seen free at least once: behind the car the scanner sees nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.control import _kernels
from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry


@dataclass(frozen=True, slots=True)
class SeenGroundConfig:
    cell_m: float = 0.05
    cells: int = 72  # along each side of the rolling square: 3.6 m
    reach_m: float = 1.6
    behind_m: float = 0.70  # how far behind the rear axle unseen ground matters
    aside_m: float = 0.45


class SeenGround:
    """Remembers what beams have passed and where the car itself has stood, odom frame."""

    def __init__(self, car: CarGeometry, config: SeenGroundConfig) -> None:
        self._config = config
        self._owner = np.full((config.cells, config.cells, 2), np.iinfo(np.int64).min, np.int64)
        self._body = lattice(-car.rear_m, car.front_m, car.width_m / 2, config.cell_m / 2)
        self._behind = lattice(-config.behind_m, 0.0, config.aside_m, config.cell_m)
        self._unseen_m = np.empty_like(self._behind)

    def add_scan(self, ranges_m: NDArray[np.floating], geometry: ScanGeometry, odom_from_robot: Pose2) -> None:
        """Take a scan, (B,) with NaN where nothing was measured, made at this pose."""
        ranges = np.asarray(ranges_m, dtype=np.float64)
        valid = ranges >= geometry.range_min_m  # NaN compares false
        scanner = odom_from_robot @ geometry.robot_from_scanner
        angles = geometry.angles_rad(len(ranges))[valid] + scanner.theta_rad
        _kernels.mark_seen(
            scanner.as_array(), angles, ranges[valid], self._config.reach_m, self._config.cell_m, self._owner
        )
        self._mark_body(odom_from_robot)

    def _mark_body(self, odom_from_robot: Pose2) -> None:
        cells = np.floor(odom_from_robot.apply(self._body) / self._config.cell_m).astype(np.int64)
        column, row = cells.T
        self._owner[row % self._config.cells, column % self._config.cells] = np.column_stack((row, column))

    def unseen_m(self, odom_from_robot: Pose2) -> NDArray[np.float64]:
        """(N, 2), odom frame: points on the ground behind the car that were never seen."""
        candidates = odom_from_robot.apply(self._behind)
        found = _kernels.collect_unseen(candidates, self._config.cell_m, self._owner, self._unseen_m)
        return self._unseen_m[:found].copy()


def lattice(rear_m: float, front_m: float, half_m: float, step_m: float) -> NDArray[np.float64]:
    """(N, 2): points of a rectangle, robot frame."""
    x = np.linspace(rear_m, front_m, max(2, round((front_m - rear_m) / step_m) + 1))
    y = np.linspace(-half_m, half_m, max(2, round(2 * half_m / step_m) + 1))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
