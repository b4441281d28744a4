"""Poses in the plane, SE(2).

A pose named `map_from_robot` takes coordinates in the robot frame to the map frame, so that neighbouring
names match: `map_from_camera = map_from_robot @ robot_from_camera`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def wrap_angle(angle_rad: float) -> float:
    """The same angle in (-pi, pi]."""
    wrapped = math.remainder(angle_rad, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


@dataclass(frozen=True, slots=True)
class Pose2:
    """A rigid motion of the plane: first rotate by `theta_rad`, then move by (`x_m`, `y_m`)."""

    x_m: float = 0.0
    y_m: float = 0.0
    theta_rad: float = 0.0

    def __matmul__(self, other: Pose2) -> Pose2:
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return Pose2(
            self.x_m + c * other.x_m - s * other.y_m,
            self.y_m + s * other.x_m + c * other.y_m,
            wrap_angle(self.theta_rad + other.theta_rad),
        )

    def inverse(self) -> Pose2:
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return Pose2(
            -c * self.x_m - s * self.y_m,
            s * self.x_m - c * self.y_m,
            wrap_angle(-self.theta_rad),
        )

    def apply(self, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """`points_m`: (N, 2) in this pose's inner frame; the result is (N, 2) in its outer frame."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        rotation = np.array([[c, s], [-s, c]])
        rotated: NDArray[np.float64] = np.asarray(points_m, dtype=np.float64) @ rotation
        rotated += (self.x_m, self.y_m)
        return rotated

    def apply_3d(self, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """`points_m`: (N, 3); the height stays as it is (paper 1, eqs 34 and 35 with tz = 0)."""
        points = np.array(points_m, dtype=np.float64, copy=True)
        points[:, :2] = self.apply(points[:, :2])
        return points

    def distance_m(self, other: Pose2) -> float:
        return math.hypot(self.x_m - other.x_m, self.y_m - other.y_m)

    def as_array(self) -> NDArray[np.float64]:
        """(3,): x in m, y in m, theta in rad."""
        return np.array([self.x_m, self.y_m, self.theta_rad])

    @staticmethod
    def from_array(values: NDArray[np.floating]) -> Pose2:
        return Pose2(float(values[0]), float(values[1]), wrap_angle(float(values[2])))


def interpolate(start: Pose2, end: Pose2, fraction: float) -> Pose2:
    """The pose a `fraction` of the way from `start` to `end`, position and heading each linear in it."""
    return Pose2(
        start.x_m + fraction * (end.x_m - start.x_m),
        start.y_m + fraction * (end.y_m - start.y_m),
        wrap_angle(start.theta_rad + fraction * wrap_angle(end.theta_rad - start.theta_rad)),
    )
