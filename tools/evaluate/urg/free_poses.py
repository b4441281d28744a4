"""The poses that lay the surfaces of all scans best on one another: what a map still has twice with them is not SLAM's.

Every scan is moved at once, by point-to-line distances from scans taken soon before and after and from scans of other
times near the same place (Gauss-Newton, Cauchy weights that narrow). Nothing of SLAM holds them but where it begins;
the wheels' motion from scan to scan is a weak tie where surfaces are too few to tell a place.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, eye_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from shared.geometry.se2 import Pose2, wrap_angle
from station_gui.mapping.scan import PointScan
from tools.evaluate.urg.cloud import line_normals

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NEXT_SCANS = (1, 3)
_OTHER_TIMES = 12  # scans of other times that each one is compared with
_OTHER_TIME_SCANS = 20  # a scan this much later or earlier is of another time
_NEARBY_M = 4.0
_EVERY_POINT = 5
_FEWEST_POINTS = 5
_FACING_COS = math.cos(math.radians(40.0))
_STAGES = ((0.50, 0.20, 6), (0.30, 0.08, 8), (0.15, 0.03, 12))  # farthest pair of points, Cauchy scale, iterations
_WHEELS_INFORMATION = np.array([44.0, 44.0, 100.0])  # of 3 mm and 2 mrad a step, in units of a point that is off 2 cm
_DAMPING = 1e-3
_STEP_MAX_M = 0.2
_CONVERGED = 1e-3  # m and rad


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """Points and normals of one scan, (N, 2), robot frame."""

    points_m: FloatArray
    normals: FloatArray
    tree: cKDTree


@dataclass(slots=True, eq=False)
class _NormalEquations:
    """H step = g over (N, 3) poses."""

    poses: int
    rows: list[IntArray] = field(default_factory=list)
    columns: list[IntArray] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)
    gradient: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.gradient = np.zeros(3 * self.poses)

    def add(self, one: int, other: int, jacobian: FloatArray, residual: FloatArray, weight: FloatArray) -> None:
        """`jacobian`: (M, 6), by the pose `one` and the pose `other`; `residual`, `weight`: (M,)."""
        index = np.concatenate((3 * one + np.arange(3), 3 * other + np.arange(3)))
        self.rows.append(np.repeat(index, 6))
        self.columns.append(np.tile(index, 6))
        self.values.append((jacobian.T @ (jacobian * weight[:, None])).ravel())
        self.gradient[index] -= jacobian.T @ (weight * residual)

    def solve(self) -> FloatArray:
        size = len(self.gradient)
        places = (np.concatenate(self.rows), np.concatenate(self.columns))
        information = coo_array((np.concatenate(self.values), places), shape=(size, size)).tocsc()
        information = information + _DAMPING * eye_array(size, format="csc")
        step = np.asarray(splu(information, permc_spec="MMD_AT_PLUS_A").solve(self.gradient)).reshape(-1, 3)
        step[:, :2] = np.clip(step[:, :2], -_STEP_MAX_M, _STEP_MAX_M)
        return step


def free_poses(scans: Sequence[PointScan], poses: FloatArray, max_range_m: float) -> FloatArray:
    """(N, 3), map_from_robot, from where SLAM put the scans, `poses` (N, 3). The map as a whole may move a little."""
    surfaces = [_surface(scan, max_range_m) for scan in scans]
    steps = [(a.odom_from_robot.inverse() @ b.odom_from_robot).as_array() for a, b in itertools.pairwise(scans)]
    poses = poses.copy()
    for reach_m, scale_m, iterations in _STAGES:
        pairs = _pairs(poses)
        for _ in range(iterations):
            equations = _NormalEquations(len(poses))
            for one, other in pairs:
                _add_surfaces(equations, poses, surfaces, (one, other), reach_m, scale_m)
            for k, step in enumerate(steps):
                _add_wheels(equations, poses, k, step)
            moved = equations.solve()
            poses += moved
            if np.abs(moved).max() < _CONVERGED:
                break
    return poses


def _surface(scan: PointScan, max_range_m: float) -> _Surface:
    normals = line_normals(scan.points_m, scan.origin_m)
    near = np.hypot(*(scan.points_m - scan.origin_m).T) <= max_range_m
    good = near & np.isfinite(normals[:, 0])
    return _Surface(scan.points_m[good], normals[good], cKDTree(scan.points_m[good]))


def _pairs(poses: FloatArray) -> list[tuple[int, int]]:
    """Which scans are compared."""
    pairs = [(k, k + apart) for apart in _NEXT_SCANS for k in range(len(poses) - apart)]
    number = np.arange(len(poses))
    for k, pose in enumerate(poses):
        near = np.hypot(*(poses[:, :2] - pose[:2]).T) <= _NEARBY_M
        other = np.flatnonzero(near & (np.abs(number - k) >= _OTHER_TIME_SCANS))
        if len(other):
            chosen = np.unique(np.linspace(0, len(other) - 1, _OTHER_TIMES).round().astype(np.int64))
            pairs += [(k, int(j)) for j in other[chosen]]
    return pairs


def _add_surfaces(
    equations: _NormalEquations, poses: FloatArray, surfaces: list[_Surface], pair: tuple[int, int], reach_m: float,
    scale_m: float,
) -> None:  # fmt: skip
    """Distances of points of the first scan from the lines of the second."""
    first, second = (surfaces[k] for k in pair)
    if min(len(first.points_m), len(second.points_m)) < _FEWEST_POINTS:
        return
    map_from_first, map_from_second = (Pose2.from_array(poses[k]) for k in pair)
    second_from_first = map_from_second.inverse() @ map_from_first
    every = slice(sum(pair) % _EVERY_POINT, None, _EVERY_POINT)
    points_m = second_from_first.apply(first.points_m[every])
    apart_m, nearest = second.tree.query(points_m, distance_upper_bound=reach_m)
    nearest = np.where(np.isfinite(apart_m), nearest, 0)
    turned = Pose2(0.0, 0.0, second_from_first.theta_rad).apply(first.normals[every])
    same = np.isfinite(apart_m) & (np.sum(turned * second.normals[nearest], axis=1) > _FACING_COS)
    if np.count_nonzero(same) < _FEWEST_POINTS:
        return
    points_m, nearest = points_m[same], nearest[same]
    residual_m = np.sum((points_m - second.points_m[nearest]) * second.normals[nearest], axis=1)
    normals = Pose2(0.0, 0.0, map_from_second.theta_rad).apply(second.normals[nearest])
    on_map_m = map_from_second.apply(points_m)
    by_first, by_second = (_by_pose(on_map_m - poses[k, :2], normals) for k in pair)
    weight = 1 / (1 + np.square(residual_m / scale_m))
    equations.add(*pair, np.column_stack((by_first, -by_second)), residual_m, weight)


def _by_pose(arm_m: FloatArray, normals: FloatArray) -> FloatArray:
    """(M, 3): what a pose's motion moves points along their normals."""
    return np.column_stack((normals, arm_m[:, 0] * normals[:, 1] - arm_m[:, 1] * normals[:, 0]))


def _add_wheels(equations: _NormalEquations, poses: FloatArray, k: int, step: FloatArray) -> None:
    """`step`: (3,), what the wheels did from scan k to the next, in the robot's frame at scan k."""
    cos, sin = math.cos(poses[k, 2]), math.sin(poses[k, 2])
    robot_from_map = np.array([[cos, sin], [-sin, cos]])
    way_m = robot_from_map @ (poses[k + 1, :2] - poses[k, :2])
    turn_rad = wrap_angle(float(poses[k + 1, 2] - poses[k, 2] - step[2]))
    jacobian = np.zeros((3, 6))
    jacobian[:2, :2], jacobian[:2, 3:5] = -robot_from_map, robot_from_map
    jacobian[:, 2] = way_m[1], -way_m[0], -1.0
    jacobian[2, 5] = 1.0
    equations.add(k, k + 1, jacobian, np.array([*(way_m - step[:2]), turn_rad]), _WHEELS_INFORMATION)
