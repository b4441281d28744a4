"""How thick, how straight and how single the walls of a map are, without a ground truth.

A wall is a line that many points of many scans lie along, all facing the same side, for a metre or more. Drift shows
in three ways: the points spread more than the scanner does, the wall is no straight line, or it is there twice.
See `wall_bend` and `doubles` for the last two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.evaluate.urg.cloud import Cloud
from tools.evaluate.urg.doubles import double_bins, seen_through_bins
from tools.evaluate.urg.wall_bend import bend_m
from tools.evaluate.urg.wall_line import BIN_M, BIN_POINTS, WallLine, total_least_squares

FloatArray = NDArray[np.float64]

_ANGLE_BINS = 180  # of the direction a wall faces, full turn
_RHO_BIN_M = 0.03
_FACING_COS = math.cos(math.radians(15.0))
_RIDGE_M = 0.05  # half the width in which a wall's points are looked for
_BAND_M = 0.10  # in which its spread is measured
_TAKEN_M = 0.35  # what faces as a wall does and is no farther from it is no wall of its own
_SCAN_POINTS = 10
_MAX_GAP_BINS = 3
_MIN_LENGTH_M = 1.0
_MIN_VOTES = 150
_MAX_PEAKS = 400
_FIT_ITERATIONS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """`ends_m`: (2, 2), map frame. Spreads are across the wall.

    `thickness_m`: standard deviation of the points about the straight line; `p95_m`: of their distances from it;
    `scanner_m`: of the points of one scan about their own line, which is the scanner's part; `bend_m`: greatest
    distance of the wall's middle, followed as far as it goes, from its straight line; `double_m`: length of what is
    there twice; `double_spans_m`: from where to where along `line` that is.
    """

    line: WallLine
    ends_m: FloatArray
    points: int
    scans: int
    thickness_m: float
    p95_m: float
    scanner_m: float
    bend_m: float
    double_m: float
    double_spans_m: tuple[tuple[float, float], ...]

    @property
    def length_m(self) -> float:
        return float(np.hypot(*(self.ends_m[1] - self.ends_m[0])))


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
            near = inside & (np.abs(across_m) < _TAKEN_M)
            walls.append(_measured(left[near], line, cloud))
            used |= near
        left = left[~used]
    return walls


def _strongest(cloud: Cloud) -> WallLine | None:
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
        best = WallLine(directions[place // columns], low_m + (place % columns + 0.5) * _RHO_BIN_M)
    return best


def _fitted(cloud: Cloud, line: WallLine) -> WallLine:
    """Total least squares on the points of the ridge, from wide to narrow."""
    for step in range(_FIT_ITERATIONS):
        gate_m = _RIDGE_M * max(1.0, 2.0 - 0.25 * step)
        chosen = (cloud.normals @ line.normal > _FACING_COS) & (np.abs(line.across_m(cloud.points_m)) < gate_m)
        if chosen.sum() < BIN_POINTS:
            break
        line = total_least_squares(cloud.points_m[chosen], line.normal)
    return line


def _stretches(along_m: FloatArray) -> list[tuple[float, float]]:
    """From where to where the wall goes on for a metre and more, without a gap of 0.3 m."""
    if not len(along_m):
        return []
    bins = np.floor(along_m / BIN_M).astype(np.int64)
    first = int(bins.min())
    filled = np.flatnonzero(np.bincount(bins - first) >= BIN_POINTS)
    if not len(filled):
        return []
    cuts = np.flatnonzero(np.diff(filled) > _MAX_GAP_BINS) + 1
    runs = [(int(run[0]), int(run[-1]) + 1) for run in np.split(filled, cuts)]
    return [((a + first) * BIN_M, (b + first) * BIN_M) for a, b in runs if (b - a) * BIN_M >= _MIN_LENGTH_M]


def _measured(near: Cloud, line: WallLine, cloud: Cloud) -> Wall:
    """`near`: all points beside the wall that face as it does and are of no wall yet; `cloud`: all points."""
    for _ in range(3):
        ridge = np.abs(line.across_m(near.points_m)) < _RIDGE_M
        line = total_least_squares(near.points_m[ridge], line.normal)
    across_m, along_m = line.across_m(near.points_m), near.points_m @ line.along
    band = np.abs(across_m) < _BAND_M
    bins = np.floor((along_m - along_m.min()) / BIN_M).astype(np.int64)
    through = seen_through_bins(cloud, line, float(along_m.min()), int(bins.max()) + 1)
    double = double_bins(across_m, bins, near.scan) | through
    foot = line.normal * line.rho_m
    return Wall(
        line=line,
        ends_m=np.array([foot + along_m.min() * line.along, foot + along_m.max() * line.along]),
        points=int(band.sum()),
        scans=len(np.unique(near.scan[band])),
        thickness_m=float(across_m[band].std()),
        p95_m=float(np.percentile(np.abs(across_m[band]), 95)),
        scanner_m=_within_scans(across_m[band], along_m[band], near.scan[band]),
        bend_m=bend_m(cloud, line, float(along_m.min()), float(along_m.max())),
        double_m=BIN_M * float(double.sum()),
        double_spans_m=tuple(
            (float(along_m.min()) + BIN_M * a, float(along_m.min()) + BIN_M * b) for a, b in _runs(double)
        ),
    )


def _runs(double: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First bin of each run, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], double.astype(np.int64), [0]))))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


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
