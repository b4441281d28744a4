"""Where the floor is in a depth image of a camera held by hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import DepthImage
from shared.geometry.camera import Intrinsics
from tools.evaluate.depth.labels import cloud_m


@dataclass(frozen=True, slots=True, eq=False)
class FloorMount:
    """A camera held by hand: `matrix` (4, 4) takes its optical frame to one that stands on the floor."""

    matrix: NDArray[np.float64]

    def robot_from_optical(self) -> NDArray[np.float64]:
        return self.matrix


_LOWEST_CAMERA_M = 0.05  # above the floor


def find_floor(image: DepthImage, intrinsics: Intrinsics) -> FloorMount | None:
    """The lowest large plane that faces up, if less than 2 % of the points lie below it; None without one."""
    points = cloud_m(image, intrinsics)[image.depth > 0][::37]
    if len(points) < 100:
        return None
    rng = np.random.default_rng(1)
    best: tuple[float, NDArray[np.float64]] | None = None
    for _ in range(600):
        a, b, c = points[rng.integers(0, len(points), 3)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-3:
            continue
        normal = normal / length * (-1.0 if normal[1] > 0 else 1.0)
        if -normal[1] < 0.5:  # the camera is held upright to within 60 degrees
            continue
        if -normal @ a < _LOWEST_CAMERA_M:
            continue
        heights = (points - a) @ normal
        share = float(np.mean(np.abs(heights) < 0.02))
        if share > 0.04 and np.mean(heights < -0.05) < 0.02 and (best is None or share > best[0]):
            best = share, np.append(normal, -normal @ a)
    return None if best is None else FloorMount(_standing_frame(best[1]))


def _standing_frame(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) for a floor `plane[:3] @ p + plane[3] == 0`: z up, x where the camera looks."""
    up = plane[:3]
    forward = np.array([0.0, 0.0, 1.0]) - up[2] * up
    forward /= np.linalg.norm(forward)
    matrix = np.eye(4)
    matrix[:3, :3] = forward, np.cross(up, forward), up
    matrix[2, 3] = plane[3]
    return matrix
