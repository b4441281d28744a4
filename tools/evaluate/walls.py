"""How thick, how straight and how single the walls of a map are, without a ground truth.

A wall is a line that many points of many scans lie along, all facing the same side, for a metre or more. Drift shows
in three ways: the points spread more than the scanner does, the wall is no straight line, or it is there twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from tools.evaluate.cloud import Cloud

FloatArray = NDArray[np.float64]

_ANGLE_BINS = 180  # of the direction a wall faces, full turn
_RHO_BIN_M = 0.03
_FACING_COS = math.cos(math.radians(15.0))
_RIDGE_M = 0.05  # half the width in which a wall's points are looked for
_BAND_M = 0.10  # in which its spread is measured
_NEAR_M = 0.30  # in which a second wall is looked for
_BIN_M = 0.10  # along a wall
_BIN_POINTS = 4
_SCAN_POINTS = 10
_MAX_GAP_BINS = 3
_MIN_LENGTH_M = 1.0
_MIN_VOTES = 150
_MAX_PEAKS = 400
_FIT_ITERATIONS = 8

_WINDOW_BINS = 5  # half a metre in which a second wall must go on
_DOUBLE_MIN_M = 0.05  # nearer ridges are one thick wall
_DOUBLE_SHARE = 0.2  # of the points of the stronger ridge
_DOUBLE_VALLEY = 0.5  # between the ridges, of the weaker one's height
_DOUBLE_SCANS = 4
_SEEN_TOGETHER = 0.2  # scans that see both at once see two things


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """`ends_m`: (2, 2), map frame. Spreads are across the wall.

    `thickness_m`: standard deviation of the points about the straight line; `p95_m`: of their distances from it;
    `scanner_m`: of the points of one scan about their own line, which is the scanner's part; `bend_m`: greatest
    distance of the wall's local middle from the straight line; `double_m`: length of what is there twice.
    """

    ends_m: FloatArray
    points: int
    scans: int
    thickness_m: float
    p95_m: float
    scanner_m: float
    bend_m: float
    double_m: float

    @property
    def length_m(self) -> float:
        return float(np.hypot(*(self.ends_m[1] - self.ends_m[0])))


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """Points p with normal · p = rho; `along` is the normal turned by -90 degrees."""

    normal: FloatArray
    rho_m: float

    @property
    def along(self) -> FloatArray:
        return np.array([self.normal[1], -self.normal[0]])

    def across_m(self, points_m: FloatArray) -> FloatArray:
        return np.asarray(points_m @ self.normal - self.rho_m)


def find_walls(cloud: Cloud) -> list[Wall]:
    """The walls of a metre and more, the most voted first; a point belongs to one wall at most."""
    walls: list[Wall] = []
    left = cloud
    for _ in range(_MAX_PEAKS):
        line = _strongest(left)
        if line is None:
            break
        line = _fitted(left, line)
        facing = left.normals @ line.normal > _FACING_COS
        across_m = line.across_m(left.points_m)
        used = facing & (np.abs(across_m) < _RIDGE_M)
        for low_m, high_m in _stretches(left.points_m[used] @ line.along):
            along_m = left.points_m @ line.along
            inside = facing & (along_m >= low_m) & (along_m <= high_m)
            near = inside & (np.abs(across_m) < _NEAR_M + _RIDGE_M)
            walls.append(_measured(left[near], line))
            used |= near
        left = left[~used]
    return walls


def _strongest(cloud: Cloud) -> _Line | None:
    """Hough transform in which a point votes for the line that it faces away from."""
    if len(cloud) < _MIN_VOTES:
        return None
    angle = np.arctan2(cloud.normals[:, 1], cloud.normals[:, 0])
    angle_bin = np.floor((angle + math.pi) / math.tau * _ANGLE_BINS).astype(np.int64) % _ANGLE_BINS
    angles = (np.arange(_ANGLE_BINS) + 0.5) / _ANGLE_BINS * math.tau - math.pi
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    best_votes, best = 0, None
    spread_bins = (-1, 0, 1)  # a point's own direction is known to a few degrees only
    low_m = -float(np.abs(cloud.points_m).sum(axis=1).max()) - _RHO_BIN_M
    columns = math.ceil(-2 * low_m / _RHO_BIN_M) + 2
    votes = np.zeros(_ANGLE_BINS * columns, np.int64)
    for shift in spread_bins:
        voted = (angle_bin + shift) % _ANGLE_BINS
        rho_m = np.sum(cloud.points_m * directions[voted], axis=1)
        votes += np.bincount(
            voted * columns + np.floor((rho_m - low_m) / _RHO_BIN_M).astype(np.int64), minlength=len(votes)
        )
    place = int(votes.argmax())
    best_votes = int(votes[place])
    if best_votes >= _MIN_VOTES:
        best = _Line(directions[place // columns], low_m + (place % columns + 0.5) * _RHO_BIN_M)
    return best


def _fitted(cloud: Cloud, line: _Line) -> _Line:
    """Total least squares on the points of the ridge, from wide to narrow."""
    for step in range(_FIT_ITERATIONS):
        gate_m = _RIDGE_M * max(1.0, 2.0 - 0.25 * step)
        chosen = (cloud.normals @ line.normal > _FACING_COS) & (np.abs(line.across_m(cloud.points_m)) < gate_m)
        if chosen.sum() < _BIN_POINTS:
            break
        line = _total_least_squares(cloud.points_m[chosen], line.normal)
    return line


def _total_least_squares(points_m: FloatArray, facing: FloatArray) -> _Line:
    middle = points_m.mean(axis=0)
    normal = np.linalg.eigh(np.cov((points_m - middle).T))[1][:, 0]
    normal = normal * (1.0 if normal @ facing >= 0 else -1.0)
    return _Line(normal, float(normal @ middle))


def _stretches(along_m: FloatArray) -> list[tuple[float, float]]:
    """From where to where the wall goes on for a metre and more, without a gap of 0.3 m."""
    if not len(along_m):
        return []
    bins = np.floor(along_m / _BIN_M).astype(np.int64)
    first = int(bins.min())
    filled = np.flatnonzero(np.bincount(bins - first) >= _BIN_POINTS)
    if not len(filled):
        return []
    cuts = np.flatnonzero(np.diff(filled) > _MAX_GAP_BINS) + 1
    runs = [(int(run[0]), int(run[-1]) + 1) for run in np.split(filled, cuts)]
    return [((a + first) * _BIN_M, (b + first) * _BIN_M) for a, b in runs if (b - a) * _BIN_M >= _MIN_LENGTH_M]


def _measured(near: Cloud, line: _Line) -> Wall:
    """`near`: all points beside the wall that face as it does."""
    for _ in range(3):
        ridge = np.abs(line.across_m(near.points_m)) < _RIDGE_M
        line = _total_least_squares(near.points_m[ridge], line.normal)
    across_m, along_m = line.across_m(near.points_m), near.points_m @ line.along
    band = np.abs(across_m) < _BAND_M
    bins = np.floor((along_m - along_m.min()) / _BIN_M).astype(np.int64)
    middle_m = np.array([_median(across_m[band & (bins == k)]) for k in range(bins.max() + 1)])
    foot = line.normal * line.rho_m
    return Wall(
        ends_m=np.array([foot + along_m.min() * line.along, foot + along_m.max() * line.along]),
        points=int(band.sum()),
        scans=len(np.unique(near.scan[band])),
        thickness_m=float(across_m[band].std()),
        p95_m=float(np.percentile(np.abs(across_m[band]), 95)),
        scanner_m=_within_scans(across_m[band], along_m[band], near.scan[band]),
        bend_m=float(np.nanmax(np.abs(middle_m))),
        double_m=_BIN_M * float(_double_bins(across_m, bins, near.scan).sum()),
    )


def _within_scans(across_m: FloatArray, along_m: FloatArray, scan: NDArray[np.int64]) -> float:
    """Standard deviation about a line for each scan with ten points and more; each line takes two."""
    squares, freedom = 0.0, 0
    for number in np.unique(scan):
        x, y = along_m[scan == number], across_m[scan == number]
        if len(x) >= _SCAN_POINTS:
            x = x - x.mean()
            residual = y - y.mean() - x * (x @ y) / max(float(x @ x), 1e-12)
            squares, freedom = squares + float(residual @ residual), freedom + len(x) - 2
    return math.sqrt(squares / freedom) if freedom else math.nan


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if len(values) >= _BIN_POINTS else math.nan


def _double_bins(across_m: FloatArray, bins: NDArray[np.int64], scan: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(bins,): where a second ridge stands beside the first for half a metre, seen by other scans."""
    count = int(bins.max()) + 1
    double = np.zeros(count, np.bool_)
    for first in range(max(0, count - _WINDOW_BINS + 1)):
        window = (bins >= first) & (bins < first + _WINDOW_BINS)
        if _is_double(across_m[window], bins[window] - first, scan[window]):
            double[first : first + _WINDOW_BINS] = True
    return double


def _is_double(across_m: FloatArray, bins: NDArray[np.int64], scan: NDArray[np.int64]) -> bool:
    step_m = 0.01
    reach = round((_NEAR_M + _RIDGE_M) / step_m)
    place = np.clip(np.round(across_m / step_m).astype(np.int64) + reach, 0, 2 * reach)
    height = gaussian_filter1d(np.bincount(place, minlength=2 * reach + 1).astype(np.float64), 1.0)
    main = int(height.argmax())
    for other in np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])) + 1:
        low, high = sorted((main, int(other)))
        apart_m = (high - low) * step_m
        if not _DOUBLE_MIN_M <= apart_m <= _NEAR_M or height[other] < _DOUBLE_SHARE * height[main]:
            continue
        if height[low : high + 1].min() > _DOUBLE_VALLEY * height[other]:
            continue
        at_main, at_other = np.abs(place - main) <= 2, np.abs(place - other) <= 2
        goes_on = min(len(np.unique(bins[at_main])), len(np.unique(bins[at_other]))) >= _WINDOW_BINS - 1
        main_scans, other_scans = np.unique(scan[at_main]), np.unique(scan[at_other])
        together = np.isin(other_scans, main_scans).mean()
        if goes_on and len(other_scans) >= _DOUBLE_SCANS and together <= _SEEN_TOGETHER:
            return True
    return False
