"""All points of a log where SLAM finally put them, with the direction that each surface faces."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan

FloatArray = NDArray[np.float64]

_HALF_WINDOW = 4  # neighbours on each side that make a point's line
_GAP_M, _GAP_SHARE = 0.05, 0.03  # neighbours of one surface are no farther apart than this plus this share of the range
_MIN_NEIGHBOURS = 5
_STILL_SCANS = 10
_STILL_M, _STILL_RAD = 1e-4, 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """`points_m`, `normals`: (N, 2), map frame, normals of length 1 towards the scanner; `scan`: (N,), which one.

    `origins_m`: (N, 2), map frame, where the scanner was.
    """

    points_m: FloatArray
    normals: FloatArray
    scan: NDArray[np.int64]
    origins_m: FloatArray

    def __getitem__(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Cloud:
        return Cloud(self.points_m[chosen], self.normals[chosen], self.scan[chosen], self.origins_m[chosen])

    def __len__(self) -> int:
        return len(self.points_m)


def cloud_of(scans: Sequence[PointScan], poses: FloatArray, max_range_m: float) -> Cloud:
    """`poses`: (len(scans), 3), map_from_robot. Points without enough neighbours to tell a direction are left out."""
    points, normals, index, origins = [], [], [], []
    for number, (scan, pose) in enumerate(zip(scans, poses, strict=True)):
        near = np.hypot(*(scan.points_m - scan.origin_m).T) <= max_range_m
        normal = line_normals(scan.points_m, scan.origin_m)
        good = near & np.isfinite(normal[:, 0])
        map_from_robot = Pose2.from_array(pose)
        turned = Pose2(0.0, 0.0, map_from_robot.theta_rad)
        points.append(map_from_robot.apply(scan.points_m[good]))
        normals.append(turned.apply(normal[good]))
        index.append(np.full(int(good.sum()), number))
        origins.append(np.tile(map_from_robot.apply(scan.origin_m[None]), (int(good.sum()), 1)))
    return Cloud(np.concatenate(points), np.concatenate(normals), np.concatenate(index), np.concatenate(origins))


def line_normals(points_m: FloatArray, origin_m: FloatArray) -> FloatArray:
    """(N, 2): of the line through each of the points (N, 2) in beam order and its neighbours, towards the origin.

    NaN where fewer than five points belong together.
    """
    count = len(points_m)
    normals = np.full((count, 2), np.nan)
    if count < _MIN_NEIGHBOURS:
        return normals
    range_m = np.hypot(*(points_m - origin_m).T)
    gap_m = np.hypot(*np.diff(points_m, axis=0).T)
    breaks = gap_m > _GAP_M + _GAP_SHARE * np.minimum(range_m[1:], range_m[:-1])
    surface = np.concatenate(([0], np.cumsum(breaks)))
    offsets = np.arange(-_HALF_WINDOW, _HALF_WINDOW + 1)
    neighbour = np.clip(np.arange(count)[:, None] + offsets, 0, count - 1)
    unique = neighbour == np.arange(count)[:, None] + offsets
    weight = (unique & (surface[neighbour] == surface[:, None])).astype(np.float64)
    total = weight.sum(axis=1)
    mean = (weight[:, :, None] * points_m[neighbour]).sum(axis=1) / total[:, None]
    x, y = np.moveaxis(points_m[neighbour] - mean[:, None, :], 2, 0)
    sxx, syy, sxy = (weight * x * x).sum(axis=1), (weight * y * y).sum(axis=1), (weight * x * y).sum(axis=1)
    along = 0.5 * np.arctan2(2 * sxy, sxx - syy)
    normal = np.column_stack((-np.sin(along), np.cos(along)))
    towards = np.sign(np.sum(normal * (origin_m - points_m), axis=1))
    normals[:] = normal * np.where(towards == 0, 1.0, towards)[:, None]
    normals[total < _MIN_NEIGHBOURS] = np.nan
    return normals


def still_stretches(odometry: FloatArray) -> list[slice]:
    """Where (N, 3) odometry poses do not change for ten scans or more."""
    step = np.abs(np.diff(odometry, axis=0))
    moves = np.concatenate(([True], (step[:, :2].max(axis=1) > _STILL_M) | (step[:, 2] > _STILL_RAD), [True]))
    starts = np.flatnonzero(moves)
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(starts) if b - a >= _STILL_SCANS]


def range_noise_m(ranges_m: NDArray[np.float32], odometry: FloatArray) -> float:
    """Standard deviation of one beam of a robot that stands still, the median over beams and stretches.

    `ranges_m`: (N, B), NaN where nothing was measured. Not a number when the robot never stood still.
    """
    spreads = []
    for stretch in still_stretches(odometry):
        ranges = ranges_m[stretch].astype(np.float64)
        whole = np.isfinite(ranges).all(axis=0)
        spreads.append(ranges[:, whole].std(axis=0, ddof=1))
    together = np.concatenate(spreads) if spreads else np.zeros(0)
    return float(np.median(together)) if len(together) else float("nan")
