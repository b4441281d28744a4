"""Depth camera: from pixels to points and to the robot's frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A pinhole camera; pixel (0, 0) has its centre at image coordinates (0.5, 0.5)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @staticmethod
    def from_field_of_view(width: int, height: int, horizontal_rad: float, vertical_rad: float) -> Intrinsics:
        return Intrinsics(
            width,
            height,
            width / 2 / math.tan(horizontal_rad / 2),
            height / 2 / math.tan(vertical_rad / 2),
            width / 2,
            height / 2,
        )

    def ray_slopes(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """x/z of each column, (width,), and y/z of each row, (height,).

        A point is `(x/z, y/z, 1) * depth` in the optical frame: x right, y down, z forward. Equations 4–6 of
        paper 1 put equal angles between pixels, which is true of no pinhole camera; at the centre and at the
        border of the image both agree, and in between they differ by up to 4 % of the depth.
        """
        columns = (np.arange(self.width) + 0.5 - self.cx) / self.fx
        rows = (np.arange(self.height) + 0.5 - self.cy) / self.fy
        return columns.astype(np.float32), rows.astype(np.float32)


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Where the camera sits: forward of and above the robot's origin, how far it looks down, leans and looks aside."""

    x_m: float
    z_m: float
    pitch_down_rad: float
    roll_right_rad: float = 0.0  # about the direction it looks in; positive with its right side down
    yaw_left_rad: float = 0.0

    def robot_from_optical(self) -> NDArray[np.float64]:
        """(4, 4): optical frame (x right, y down, z forward) to robot frame (x forward, y left, z up)."""
        c, s = math.cos(self.pitch_down_rad), math.sin(self.pitch_down_rad)
        pitched = np.array([[0.0, -s, c], [-1.0, 0.0, 0.0], [0.0, -c, -s]])
        matrix = np.eye(4)
        matrix[:3, :3] = _about_z(self.yaw_left_rad) @ pitched @ _about_z(self.roll_right_rad)
        matrix[:3, 3] = self.x_m, 0.0, self.z_m
        return matrix


def _about_z(angle_rad: float) -> NDArray[np.float64]:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
