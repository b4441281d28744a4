"""How far a map and a trajectory are from the truth.

`map_rmse_m`: of all occupied cells (probability above 0.750) to the nearest true surface at the scanner's height.
`map_completeness`: the share of the true surface reachable by the scanner with an occupied cell within 5 cm.
Both after one rigid alignment, which is found robustly but applied to everything.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from shared.geometry.se2 import Pose2
from station_gui.mapping.snapshot import GridMap
from tools.evaluate._kernels import nearest_on_segments, seen_from_any
from tools.simulator.truth import TrueSurfaces

_SAMPLE_M = 0.01
_NEAR_M = 0.05
_SCAN_MIN_M, _SCAN_MAX_M = 0.06, 4.0
_MIN_COSINE = 0.10  # surfaces seen under less than 6 degrees give no echo
_STAND_CELL_M = 0.05
_STAND_CLEARANCE_M = 0.12  # half the robot's width and a margin
_ICP_ITERATIONS = 60
_ICP_SCALES_M = (0.15, 0.06, 0.03)  # of the Cauchy weight, from coarse to fine
_MIN_CELLS = 10


@dataclass(frozen=True, slots=True)
class MapError:
    """Not a number where the map has too few occupied cells to say."""

    map_rmse_m: float
    map_completeness: float


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSamples:
    """Points (N, 2) every centimetre along surfaces and the directions (N, 2) that face the free space."""

    points_m: NDArray[np.float64]
    normals: NDArray[np.float64]


def map_error(grid: GridMap, truth: TrueSurfaces) -> MapError:
    """Compare a grid, whose frame is about that of the start pose, with the true surfaces."""
    cells_m = grid.occupied_m()
    if len(cells_m) < _MIN_CELLS:
        return MapError(math.nan, 0.0)
    aligned_m = align(cells_m, truth).apply(cells_m)
    distance_m = _nearest(aligned_m, truth.segments_m)[1]
    reachable = reachable_surface(truth)
    to_cell_m = cKDTree(aligned_m).query(reachable.points_m)[0]
    return MapError(
        map_rmse_m=math.sqrt(float(np.mean(np.square(distance_m)))),
        map_completeness=float(np.mean(to_cell_m <= _NEAR_M)),
    )


def align(cells_m: NDArray[np.float64], truth: TrueSurfaces) -> Pose2:
    """`room_from_map`: the rigid motion that brings the cells (N, 2) to the surfaces, from the start pose on.

    Iterated closest points with point-to-line residuals and Cauchy weights, whose scale shrinks: outliers do not
    pull, but they are not forgiven either, since the error counts all cells.
    """
    pose = truth.start
    for scale_m in _ICP_SCALES_M:
        for _ in range(_ICP_ITERATIONS):
            step = _icp_step(cells_m, truth.segments_m, pose, scale_m)
            pose = Pose2(pose.x_m + step[0], pose.y_m + step[1], pose.theta_rad + step[2])
            if np.abs(step).max() < 1e-6:
                break
    return pose


def _icp_step(
    cells_m: NDArray[np.float64], segments_m: NDArray[np.float64], pose: Pose2, scale_m: float
) -> NDArray[np.float64]:
    """(3,): one Gauss-Newton step of x, y and heading."""
    moved_m = pose.apply(cells_m)
    foot_m, distance_m = _nearest(moved_m, segments_m)
    normal = (moved_m - foot_m) / np.maximum(distance_m, 1e-9)[:, None]
    lever_m = moved_m - (pose.x_m, pose.y_m)
    turning = lever_m[:, 0] * normal[:, 1] - lever_m[:, 1] * normal[:, 0]
    jacobian = np.column_stack((normal, turning))
    weight = 1 / (1 + np.square(distance_m / scale_m))
    information = jacobian.T @ (jacobian * weight[:, None]) + 1e-9 * np.eye(3)
    step = np.linalg.solve(information, -jacobian.T @ (weight * distance_m))
    return np.asarray(step, dtype=np.float64)


def surface_samples(truth: TrueSurfaces) -> SurfaceSamples:
    """The middle of each centimetre of all surfaces; free space is on the left of a segment's direction."""
    points, normals = [], []
    for start, end in truth.segments_m:
        along = end - start
        length_m = float(np.hypot(*along))
        count = max(1, round(length_m / _SAMPLE_M))
        fractions = (np.arange(count) + 0.5) / count
        points.append(start + fractions[:, None] * along)
        normals.append(np.tile(np.array([-along[1], along[0]]) / length_m, (count, 1)))
    return SurfaceSamples(np.concatenate(points), np.concatenate(normals))


def reachable_surface(truth: TrueSurfaces) -> SurfaceSamples:
    """The samples that the scanner sees from somewhere the robot can stand."""
    samples = surface_samples(truth)
    seen = np.zeros(len(samples.points_m), np.bool_)
    seen_from_any(
        samples.points_m, samples.normals, standing_places_m(truth), truth.segments_m,
        _SCAN_MIN_M, _SCAN_MAX_M, _MIN_COSINE, seen,
    )  # fmt: skip
    return SurfaceSamples(samples.points_m[seen], samples.normals[seen])


def standing_places_m(truth: TrueSurfaces) -> NDArray[np.float64]:
    """(V, 2), room frame: 5 cm cells that a disc as wide as the robot reaches from the start, touching nothing."""
    low = truth.segments_m.reshape(-1, 2).min(axis=0)
    high = truth.segments_m.reshape(-1, 2).max(axis=0)
    columns, rows = np.ceil((high - low) / _STAND_CELL_M).astype(int)
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    centres_m = low + _STAND_CELL_M * np.column_stack((x.ravel(), y.ravel()))
    free = (_nearest(centres_m, truth.segments_m)[1] >= _STAND_CLEARANCE_M).reshape(rows, columns)
    label = ndimage.label(free)[0]
    column, row = ((np.array([truth.start.x_m, truth.start.y_m]) - low) / _STAND_CELL_M).astype(int)
    if not free[row, column]:
        raise ValueError("the start pose leaves no room for the robot")
    places_m: NDArray[np.float64] = centres_m[(label == label[row, column]).ravel()]
    return places_m


def pose_error(estimated: NDArray[np.float64], truth: NDArray[np.float64]) -> float:
    """RMSE in m of the positions of (K, 4) stamps and poses after one rigid alignment.

    `truth`: (N, 4) time_s, x_m, y_m, theta_rad, interpolated to the stamps; all must lie within it.
    """
    stamps = estimated[:, 0]
    if len(stamps) < 2:
        raise ValueError("a trajectory error needs at least two poses")
    if stamps.min() < truth[0, 0] - 0.05 or stamps.max() > truth[-1, 0] + 0.05:
        raise ValueError("the trajectory goes beyond the recorded truth")
    true_m = np.column_stack([np.interp(stamps, truth[:, 0], truth[:, axis]) for axis in (1, 2)])
    fitted = _rigid_fit(estimated[:, 1:3], true_m).apply(estimated[:, 1:3])
    return math.sqrt(float(np.mean(np.sum(np.square(fitted - true_m), axis=1))))


def _rigid_fit(source_m: NDArray[np.float64], target_m: NDArray[np.float64]) -> Pose2:
    """The motion that brings source (N, 2) nearest to target (N, 2) in the least-squares sense."""
    source_middle, target_middle = source_m.mean(axis=0), target_m.mean(axis=0)
    s, t = source_m - source_middle, target_m - target_middle
    theta = math.atan2(float(np.sum(s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0])), float(np.sum(s * t)))
    rotated = Pose2(0.0, 0.0, theta).apply(source_middle[None, :])[0]
    return Pose2(float(target_middle[0] - rotated[0]), float(target_middle[1] - rotated[1]), theta)


def _nearest(
    points_m: NDArray[np.float64], segments_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    foot_m, distance_m = np.empty_like(points_m), np.empty(len(points_m))
    nearest_on_segments(np.ascontiguousarray(points_m), np.ascontiguousarray(segments_m), foot_m, distance_m)
    return foot_m, distance_m
