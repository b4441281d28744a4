"""A scan as SLAM wants it: points in the robot's frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from shared.messages import Observation


@dataclass(frozen=True, slots=True, eq=False)
class PointScan:
    """What the scanner hit, freed of the robot's motion during the sweep.

    `points_m`: (N, 2) float64, robot frame at `stamp_s`, in beam order. `origin_m`: (2,), the scanner.
    """

    stamp_s: float
    odom_from_robot: Pose2
    origin_m: NDArray[np.float64]
    points_m: NDArray[np.float64]


def to_points(observation: Observation) -> PointScan:
    """Back-project the beams; beam i was measured `i * beam_interval_s` later, when the robot stood elsewhere."""
    geometry = observation.geometry
    ranges = observation.ranges_m.astype(np.float64)
    valid = (ranges >= geometry.range_min_m) & (ranges <= geometry.range_max_m)  # NaN compares false
    beams = np.flatnonzero(valid)
    angles = geometry.angles_rad(len(ranges))[beams]
    ranges = ranges[beams]
    points = np.empty((len(beams), 2))
    np.multiply(ranges, np.cos(angles), out=points[:, 0])
    np.multiply(ranges, np.sin(angles), out=points[:, 1])
    points = geometry.robot_from_scanner.apply(points)
    if geometry.beam_interval_s != 0.0:
        late_s = geometry.beam_interval_s * beams.astype(np.float64)
        points = _undo_motion(points, late_s, observation.speed_mps, observation.yaw_rate_radps)
    return PointScan(
        observation.stamp_s,
        observation.odom_from_robot,
        np.array([geometry.robot_from_scanner.x_m, geometry.robot_from_scanner.y_m]),
        points,
    )


def _undo_motion(
    points_m: NDArray[np.float64], late_s: NDArray[np.float64], speed_mps: float, yaw_rate_radps: float
) -> NDArray[np.float64]:
    """Points seen `late_s` after the stamp by a robot on a circular arc, in its frame at the stamp."""
    turned = yaw_rate_radps * late_s
    c, s = np.cos(turned), np.sin(turned)
    chord = speed_mps * late_s * np.sinc(turned / (2 * np.pi))
    return np.column_stack(
        (
            c * points_m[:, 0] - s * points_m[:, 1] + chord * np.cos(turned / 2),
            s * points_m[:, 0] + c * points_m[:, 1] + chord * np.sin(turned / 2),
        )
    )
