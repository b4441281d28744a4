"""Whether the robot, back at its start, sees the surfaces where its first scans put them.

Independent of SLAM: the surfaces seen at the last visit are compared with those of the first alone, and aligned with
them by iterated closest points from many starts; that offset is what the map is off by at the end of the loop. Which
scans are the two visits is marked by hand for the logs that are measured: a map that drifts past its own start must
not be excused from the comparison. The poses under test decide only for other logs.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from shared.geometry.se2 import Pose2, wrap_angle
from tools.evaluate.urg.cloud import Cloud

FloatArray = NDArray[np.float64]

VISIT_M = 1.5  # nearer to the first pose is at the start
AWAY_M = 2.5  # farther has left it
_FACING_COS = math.cos(math.radians(30.0))
_OVERLAP_M = 0.30  # surfaces farther apart are not the same
_INLIER_M = 0.05
_SCALES_M = (0.20, 0.08, 0.03)  # of the Cauchy weight
_ITERATIONS = 15
_STARTS_M = np.linspace(-0.75, 0.75, 11)
_STARTS_RAD = np.radians(np.linspace(-12.0, 12.0, 9))
_START_SCALE_M = 0.10
_DESCENTS = 12  # of the starts, the best ones
_REFERENCE_POINTS, _QUERY_POINTS = 10_000, 1_500
_MIN_POINTS = 200
_SURE_OVERLAP = 0.5  # less of the visit on the first one's surfaces: the map may be off by more than the starts reach
_WIDE_STARTS_M = np.linspace(-1.6, 1.6, 9)  # about the middle of the first visit: both are within VISIT_M of the start
_WIDE_STARTS_RAD = np.radians(np.arange(-180.0, 180.0, 10.0))
_WIDE_SCALE_M = 0.20
_WIDE_POINTS = 150
_WIDE_DESCENTS = 24

# First and last scan of the first and of the last visit to the start, by scan number. Marked where the surfaces of both
# lie on one another once they are aligned (to 7 mm in the median), whatever the poses of a map say.
MARKED_VISITS = {
    "exp1": ((0, 38), (337, 421)),
    "exp2": ((0, 67), (346, 378)),
    "test_lab2": ((0, 87), (322, 403)),
}


@dataclass(frozen=True, slots=True)
class Revisit:
    """`median_m`, `p95_m`: distances between the surfaces that both visits saw, as the map has them.

    `offset_m`, `offset_deg`: the motion, about the robot's place at the visit, that aligns them best.
    `overlap`: share of the last visit's points that lie on surfaces of the first, once aligned. The distances are not
    a number where the map has the surfaces too far apart to call them the same; the offset where nothing aligns them.
    """

    first_scans: int
    last_scans: int
    overlap: float
    median_m: float
    p95_m: float
    offset_m: float
    offset_deg: float
    aligned_median_m: float


def visits(poses: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Scans of the first and of the last visit to the place of the first of (N, 3) poses; None without a return."""
    away_m = np.hypot(*(poses[:, :2] - poses[0, :2]).T)
    left = np.flatnonzero(away_m > AWAY_M)
    if not len(left):
        return None
    first = np.flatnonzero(away_m[: left[0]] <= VISIT_M)
    back = np.flatnonzero(away_m <= VISIT_M)
    last = int(back[-1])
    if last < left[0]:
        return None
    begins = left[left < last][-1]
    return first, back[back > begins]


Marks = tuple[tuple[int, int], tuple[int, int]]


def revisit(cloud: Cloud, poses: FloatArray, marked: Marks | None = None) -> Revisit | None:
    """`marked`: first and last scan of both visits. None when the robot does not come back, or saw too little there."""
    found = _marked_scans(marked, len(poses)) if marked is not None else visits(poses)
    if found is None:
        return None
    first, last = found
    reference, query = cloud[np.isin(cloud.scan, first)], cloud[np.isin(cloud.scan, last)]
    if min(len(reference), len(query)) < _MIN_POINTS:
        return None
    reference, query = _thinned(reference, _REFERENCE_POINTS), _thinned(query, _QUERY_POINTS)
    matcher = _Matcher(reference, query, poses[last, :2].mean(axis=0))
    offset = matcher.best_offset()
    if len(matcher.distances_m(offset)) < _SURE_OVERLAP * len(query):
        offset = matcher.better_of(offset, matcher.far_offset(poses[first, :2].mean(axis=0)))
    distance_m, aligned_m = matcher.distances_m(Pose2()), matcher.distances_m(offset)
    known, aligned = len(distance_m) >= _MIN_POINTS, len(aligned_m) >= _MIN_POINTS
    return Revisit(
        first_scans=len(first),
        last_scans=len(last),
        overlap=len(aligned_m) / len(query),
        median_m=float(np.median(distance_m)) if known else math.nan,
        p95_m=float(np.percentile(distance_m, 95)) if known else math.nan,
        offset_m=math.hypot(offset.x_m, offset.y_m) if aligned else math.nan,
        offset_deg=math.degrees(wrap_angle(offset.theta_rad)) if aligned else math.nan,
        aligned_median_m=float(np.median(aligned_m)) if aligned else math.nan,
    )


def _marked_scans(marked: Marks, scans: int) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """None for a log that ends before the last visit does."""
    if marked[1][1] >= scans:
        return None
    return np.arange(marked[0][0], marked[0][1] + 1), np.arange(marked[1][0], marked[1][1] + 1)


def _thinned(cloud: Cloud, points: int) -> Cloud:
    step = max(1, math.ceil(len(cloud) / points))
    return cloud[np.arange(0, len(cloud), step)]


class _Matcher:
    """Moves the query about `middle_m` and compares it with the reference."""

    def __init__(self, reference: Cloud, query: Cloud, middle_m: FloatArray) -> None:
        self._reference = reference
        self._tree = cKDTree(reference.points_m)
        self._query = query
        self._points_m = query.points_m - middle_m
        self._normals = query.normals
        self._middle_m = middle_m

    def distances_m(self, offset: Pose2) -> FloatArray:
        """(M,): of the points that have a surface nearby, from the line of it."""
        residual_m, _, same = self._compare(offset)
        return np.abs(residual_m[same])

    def best_offset(self) -> Pose2:
        """Of many starts the one that ends with the most points on surfaces."""
        starts = [Pose2(*start) for start in itertools.product(_STARTS_M, _STARTS_M, _STARTS_RAD)]
        starts.sort(key=lambda start: -self._score(start, _START_SCALE_M))
        ends = [self._descend(start) for start in (Pose2(), *starts[:_DESCENTS])]
        return max(ends, key=lambda end: self._score(end, _INLIER_M))

    def far_offset(self, place_m: FloatArray) -> Pose2:
        """The same for a query that may be anywhere and turned by anything, but is seen from about `place_m` (2,)."""
        away_m = place_m - self._middle_m
        steps = itertools.product(away_m[0] + _WIDE_STARTS_M, away_m[1] + _WIDE_STARTS_M, _WIDE_STARTS_RAD)
        starts = [Pose2(*start) for start in steps]
        every = max(1, len(self._points_m) // _WIDE_POINTS)
        few = _Matcher(self._reference, self._query[np.arange(0, len(self._query), every)], self._middle_m)
        starts.sort(key=lambda start: -few._score(start, _WIDE_SCALE_M))
        ends = [self._descend(start) for start in starts[:_WIDE_DESCENTS]]
        return max(ends, key=lambda end: self._score(end, _INLIER_M))

    def better_of(self, one: Pose2, other: Pose2) -> Pose2:
        return max(one, other, key=lambda end: self._score(end, _INLIER_M))

    def _score(self, offset: Pose2, scale_m: float) -> float:
        residual_m, _, same = self._compare(offset)
        return float(np.where(same, 1 / (1 + np.square(residual_m / scale_m)), 0.0).sum())

    def _descend(self, offset: Pose2) -> Pose2:
        for scale_m in _SCALES_M:
            for _ in range(_ITERATIONS):
                step = self._step(offset, scale_m)
                offset = Pose2(offset.x_m + step[0], offset.y_m + step[1], offset.theta_rad + step[2])
                if np.abs(step).max() < 1e-5:
                    break
        return offset

    def _step(self, offset: Pose2, scale_m: float) -> FloatArray:
        """(3,): one Gauss-Newton step with point-to-line residuals and Cauchy weights."""
        residual_m, normals, same = self._compare(offset)
        turned = Pose2(0.0, 0.0, offset.theta_rad).apply(self._points_m)
        turning = turned[:, 0] * normals[:, 1] - turned[:, 1] * normals[:, 0]
        jacobian = np.column_stack((normals, turning))[same]
        weight = 1 / (1 + np.square(residual_m[same] / scale_m))
        information = jacobian.T @ (jacobian * weight[:, None]) + 1e-6 * np.eye(3)
        return np.asarray(np.linalg.solve(information, -jacobian.T @ (weight * residual_m[same])))

    def _compare(self, offset: Pose2) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """For each point the signed distance from the nearest surface, that one's normal, whether it is the same."""
        moved_m = offset.apply(self._points_m) + self._middle_m
        apart_m, nearest = self._tree.query(moved_m, distance_upper_bound=_OVERLAP_M)
        found = np.isfinite(apart_m)
        nearest = np.where(found, nearest, 0)
        normals = self._reference.normals[nearest]
        facing = np.sum(Pose2(0.0, 0.0, offset.theta_rad).apply(self._normals) * normals, axis=1) > _FACING_COS
        residual_m = np.sum((moved_m - self._reference.points_m[nearest]) * normals, axis=1)
        return residual_m, normals, found & facing
