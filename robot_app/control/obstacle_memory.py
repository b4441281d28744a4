"""What stands near the robot, remembered for a while: the scanner does not see behind the car."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.control import _kernels
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry


@dataclass(frozen=True, slots=True)
class ObstacleMemoryConfig:
    cell_m: float = 0.025  # a few times the noise of the scanner (1 cm)
    cells: int = 144  # along each side of the square that is remembered: 3.6 m
    reach_m: float = 1.7  # points farther from the robot than this are not given out
    max_age_s: float = 30.0  # odometry is good to a centimetre over what the robot drives meanwhile nearby
    min_hits: int = 2  # a single hit may be a mixed pixel at an edge
    max_hits: int = 8  # so many scans that see through a point forget it
    see_through_slack_m: float = 0.08  # a beam must pass a point by this to forget it
    max_points: int = 2500


class ObstacleMemory:
    """Scan points of the last seconds on a rolling grid in the odom frame, one per cell."""

    def __init__(self, config: ObstacleMemoryConfig) -> None:
        self._config = config
        size = config.cells
        self._owner = np.full((size, size, 2), np.iinfo(np.int64).min, np.int64)
        self._mean_m = np.zeros((size, size, 2))
        self._count = np.zeros((size, size), np.int64)
        self._seen_s = np.full((size, size), -math.inf)
        self._points_m = np.zeros((config.max_points, 2))

    def add_scan(
        self,
        stamp_s: float,
        ranges_m: NDArray[np.floating],
        geometry: ScanGeometry,
        odom_from_robot: Pose2,
        speed_mps: float = 0.0,
        yaw_rate_radps: float = 0.0,
        lateral_mps: float = 0.0,
    ) -> None:
        """Take a scan, (B,) with NaN where nothing was measured; pose and motion are the robot's at `stamp_s`."""
        ranges = np.asarray(ranges_m, dtype=np.float64)
        odom_from_scanner = odom_from_robot @ geometry.robot_from_scanner
        valid = (ranges >= geometry.range_min_m) & (ranges <= self._config.reach_m)  # NaN compares false
        late_s = geometry.beam_interval_s * np.flatnonzero(valid)
        turned = odom_from_scanner.theta_rad + yaw_rate_radps * late_s
        angles = geometry.angles_rad(len(ranges))[valid] + turned
        heading = odom_from_robot.theta_rad + yaw_rate_radps * late_s / 2
        sideways_mps = geometry.robot_from_scanner.x_m * yaw_rate_radps + lateral_mps
        hits = np.column_stack(
            (
                odom_from_scanner.x_m
                + ranges[valid] * np.cos(angles)
                + late_s * (speed_mps * np.cos(heading) - sideways_mps * np.sin(heading)),
                odom_from_scanner.y_m
                + ranges[valid] * np.sin(angles)
                + late_s * (speed_mps * np.sin(heading) + sideways_mps * np.cos(heading)),
            )
        )
        self._forget_seen_through(ranges, geometry, odom_from_scanner)
        _kernels.insert_hits(
            hits,
            stamp_s,
            self._config.cell_m,
            self._config.max_hits,
            self._owner,
            self._mean_m,
            self._count,
            self._seen_s,
        )

    def _forget_seen_through(
        self, ranges_m: NDArray[np.float64], geometry: ScanGeometry, odom_from_scanner: Pose2
    ) -> None:
        _kernels.clear_seen_through(
            ranges_m,
            geometry.first_angle_rad,
            geometry.step_rad,
            odom_from_scanner.as_array(),
            self._config.reach_m,
            self._config.see_through_slack_m,
            self._mean_m,
            self._count,
        )

    def points_m(self, now_s: float, odom_from_robot: Pose2) -> NDArray[np.float64]:
        """(N, 2), odom frame: where something stands near the robot."""
        found = _kernels.collect_points(
            odom_from_robot.x_m,
            odom_from_robot.y_m,
            self._config.reach_m,
            now_s - self._config.max_age_s,
            self._config.min_hits,
            self._mean_m,
            self._count,
            self._seen_s,
            self._points_m,
        )
        return self._points_m[:found].copy()

    def forget(self) -> None:
        """Everything: after the odometry has jumped."""
        self._count[:] = 0
