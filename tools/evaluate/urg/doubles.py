"""Where a wall is in the map twice.

Two copies beside one another are two ridges that no scan sees together. Copies farther apart, or turned, betray
themselves by how they were seen: scans that show the hinder one from before the front one looked through a wall. A
surface of its own, as the wall of an aisle behind a partition, is seen from behind the partition.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from tools.evaluate.urg.cloud import Cloud
from tools.evaluate.urg.wall_line import BIN_M, BIN_POINTS, FloatArray, IntArray, WallLine

_WINDOW_BINS = 5  # half a metre in which a second wall must go on
_SCANS = 4  # that see it
_RIDGES_M = 0.30  # farthest apart as ridges
_BESIDE_M = 0.35  # in which they are looked for
_DOUBLE_MIN_M = 0.05  # nearer ridges are one thick wall
_DOUBLE_SHARE = 0.2  # of the points of the stronger ridge
_DOUBLE_VALLEY = 0.5  # between the ridges, of the weaker one's height
_SEEN_TOGETHER = 0.2  # scans that see both at once see two things

_RIDGE_M = 0.05  # half the width of a wall
_BEHIND_M = (0.25, 1.0)  # a wall, seen through it; a URG-04LX puts parts of far scans up to 0.2 m behind
_RIDGE_COS, _BEHIND_COS = math.cos(math.radians(15.0)), math.cos(math.radians(30.0))
_GRAZING_COS = 0.3  # flatter rays pass the end of a wall by
_BODY_M = 0.15  # a scanner this far behind a wall can be on its other side
_THROUGH_SHARE = 0.1  # of the points on the wall


def double_bins(across_m: FloatArray, bins: NDArray[np.int64], scan: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(bins,): where a second ridge stands beside the first for half a metre, seen by other scans.

    `across_m`, `bins`, `scan`: (N,), of the points near the wall's line that face as it does.
    """
    count = int(bins.max()) + 1
    double = np.zeros(count, np.bool_)
    for first in range(max(0, count - _WINDOW_BINS + 1)):
        window = (bins >= first) & (bins < first + _WINDOW_BINS)
        if _is_double(across_m[window], bins[window] - first, scan[window]):
            double[first : first + _WINDOW_BINS] = True
    return double


def _is_double(across_m: FloatArray, bins: NDArray[np.int64], scan: NDArray[np.int64]) -> bool:
    step_m = 0.01
    reach = round(_BESIDE_M / step_m)
    place = np.clip(np.round(across_m / step_m).astype(np.int64) + reach, 0, 2 * reach)
    height = gaussian_filter1d(np.bincount(place, minlength=2 * reach + 1).astype(np.float64), 1.0)
    main = int(height.argmax())
    for other in np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])) + 1:
        low, high = sorted((main, int(other)))
        apart_m = (high - low) * step_m
        if not _DOUBLE_MIN_M <= apart_m <= _RIDGES_M or height[other] < _DOUBLE_SHARE * height[main]:
            continue
        if height[low : high + 1].min() > _DOUBLE_VALLEY * height[other]:
            continue
        at_main, at_other = np.abs(place - main) <= 2, np.abs(place - other) <= 2
        goes_on = min(len(np.unique(bins[at_main])), len(np.unique(bins[at_other]))) >= _WINDOW_BINS - 1
        main_scans, other_scans = np.unique(scan[at_main]), np.unique(scan[at_other])
        together = np.isin(other_scans, main_scans).mean()
        if goes_on and len(other_scans) >= _SCANS and together <= _SEEN_TOGETHER:
            return True
    return False


def seen_through_bins(cloud: Cloud, line: WallLine, first_m: float, count: int) -> NDArray[np.bool_]:
    """(count,): which bins of a wall, from `first_m` along its line, are seen through for half a metre and more."""
    across_m, along_m = line.across_m(cloud.points_m), cloud.points_m @ line.along
    facing = cloud.normals @ line.normal
    ridge = (facing > _RIDGE_COS) & (np.abs(across_m) < _RIDGE_M)
    ridge_bin = _bins(along_m, first_m)
    ridge &= (ridge_bin >= 0) & (ridge_bin < count)
    behind = (facing > _BEHIND_COS) & (across_m < -_BEHIND_M[0]) & (across_m > -_BEHIND_M[1])
    scanner_m = line.across_m(cloud.origins_m)
    steep = scanner_m - across_m > _GRAZING_COS * np.hypot(*(cloud.origins_m - cloud.points_m).T)
    behind &= steep & (scanner_m > -_BODY_M)
    share = np.clip(-across_m[behind] / (scanner_m[behind] - across_m[behind]), 0.0, 1.0)
    start_m = cloud.origins_m[behind] @ line.along
    crossed = _bins(along_m[behind] + share * (start_m - along_m[behind]), first_m)
    on_wall = np.bincount(ridge_bin[ridge], minlength=count)
    seen = [
        on_wall[k] >= BIN_POINTS
        and _is_seen_through(
            cloud.scan[behind][crossed == k], cloud.scan[ridge & (np.abs(ridge_bin - k) <= 1)], on_wall[k]
        )
        for k in range(count)
    ]
    return _long_runs(np.array(seen, np.bool_))


def _bins(along_m: FloatArray, first_m: float) -> IntArray:
    return np.floor((along_m - first_m) / BIN_M).astype(np.int64)


def _is_seen_through(behind: IntArray, on_wall: IntArray, points: int) -> bool:
    """`behind`, `on_wall`: scan of each point; a scan that sees both sees two things."""
    alone = behind[~np.isin(behind, on_wall)]
    return bool(len(alone) >= _THROUGH_SHARE * points and len(np.unique(alone)) >= _SCANS)


def _long_runs(seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Those that stand in half a metre of them."""
    kept = np.zeros_like(seen)
    for first in range(len(seen) - _WINDOW_BINS + 1):
        if seen[first : first + _WINDOW_BINS].all():
            kept[first : first + _WINDOW_BINS] = True
    return kept
