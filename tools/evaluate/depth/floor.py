"""Where the floor is in a depth image of a camera held by hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import DepthImage
from shared.geometry.camera import Intrinsics
from tools.evaluate.depth.labels import cloud_m

FloatArray = NDArray[np.float64]

_STEP_PX = 8  # every so many pixels are looked at,
_ARM = 2  # and normals are taken over so many of these to either side
_GUESSES = 80
_FLAT_M, _FLAT_PER_M = 0.01, 0.004  # how far the floor's points lie from a plane; noise grows with the square
_LEAST_SHARE = 0.03  # of the points, that is floor
_MOST_BELOW = 0.003  # of the points, that lie below it: noise
_LEVEL = 0.5  # the camera is held upright to within 60 degrees,
_UPRIGHT = 0.4  # and to within 24 to the side
_LOWEST_CAMERA_M = 0.05  # above the floor


@dataclass(frozen=True, slots=True, eq=False)
class FloorMount:
    """A camera held by hand: `matrix` (4, 4) takes its optical frame to one that stands on the floor."""

    matrix: FloatArray

    def robot_from_optical(self) -> FloatArray:
        return self.matrix


def find_floor(image: DepthImage, intrinsics: Intrinsics) -> FloorMount | None:
    """The largest plane that faces up and has next to nothing below it; None without one.

    What has something below it is a table, not the floor, whatever its size.
    """
    grid_m = cloud_m(image, intrinsics)[_STEP_PX // 2 :: _STEP_PX, _STEP_PX // 2 :: _STEP_PX]
    points_m = grid_m[grid_m[..., 2] > 0]
    seeds_m, normals = _facing_up(grid_m)
    if len(points_m) < 100 or len(seeds_m) < 10:
        return None
    best: FloatArray | None = None
    most = int(_LEAST_SHARE * len(points_m))
    for k in np.random.default_rng(1).integers(0, len(seeds_m), _GUESSES):
        plane = np.append(normals[k], -normals[k] @ seeds_m[k])
        for _ in range(3):
            plane = _fitted(plane, seeds_m, normals)
        support = int(np.count_nonzero(_on_plane(plane, seeds_m, normals)))
        if support > most and _is_floor(plane, points_m):
            best, most = plane, support
    return None if best is None else FloorMount(_standing_frame(best))


def _facing_up(grid_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, 3), (N, 3): the points whose surface faces up, and its normals."""
    a, near = _ARM, grid_m[_ARM:-_ARM, _ARM:-_ARM]
    left, right = grid_m[a:-a, : -2 * a], grid_m[a:-a, 2 * a :]
    above, below = grid_m[: -2 * a, a:-a], grid_m[2 * a :, a:-a]
    normal = np.cross(right - left, above - below)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
    known = np.minimum.reduce([p[..., 2] for p in (near, left, right, above, below)]) > 0
    upright = known & (-normal[..., 1] > _LEVEL) & (np.abs(normal[..., 0]) < _UPRIGHT)
    return near[upright], normal[upright]


def _slack_m(points_m: FloatArray) -> FloatArray:
    slack: FloatArray = _FLAT_M + _FLAT_PER_M * points_m[:, 2] ** 2
    return slack


def _on_plane(plane: FloatArray, points_m: FloatArray, normals: FloatArray) -> NDArray[np.bool_]:
    on: NDArray[np.bool_] = (np.abs(points_m @ plane[:3] + plane[3]) < _slack_m(points_m)) & (normals @ plane[:3] > 0.8)
    return on


def _fitted(plane: FloatArray, points_m: FloatArray, normals: FloatArray) -> FloatArray:
    """The plane through the points that lie on `plane`, the far ones, which are noisy, counting less."""
    on = _on_plane(plane, points_m, normals)
    if np.count_nonzero(on) < 10:
        return plane
    weight = 1.0 / _slack_m(points_m[on])
    middle = (weight @ points_m[on]) / weight.sum()
    normal = np.linalg.svd((points_m[on] - middle) * weight[:, None], full_matrices=False)[2][2]
    normal = normal if normal[1] < 0 else -normal
    return np.append(normal, -normal @ middle)


def _is_floor(plane: FloatArray, points_m: FloatArray) -> bool:
    height_m = points_m @ plane[:3] + plane[3]
    below = np.mean(height_m < -3.0 * _slack_m(points_m))
    return bool(below < _MOST_BELOW and plane[3] > _LOWEST_CAMERA_M and -plane[1] > _LEVEL)


def _standing_frame(plane: FloatArray) -> FloatArray:
    """(4, 4) for a floor `plane[:3] @ p + plane[3] == 0`: z up, x where the camera looks."""
    up = plane[:3]
    forward = np.array([0.0, 0.0, 1.0]) - up[2] * up
    forward /= np.linalg.norm(forward)
    matrix = np.eye(4)
    matrix[:3, :3] = forward, np.cross(up, forward), up
    matrix[2, 3] = plane[3]
    return matrix
