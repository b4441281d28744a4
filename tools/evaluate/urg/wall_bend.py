"""How far a wall's middle, followed from bin to bin, is from a straight line."""

from __future__ import annotations

import math

import numpy as np

from tools.evaluate.urg.cloud import Cloud
from tools.evaluate.urg.wall_line import BIN_M, BIN_POINTS, FloatArray, IntArray, WallLine, total_least_squares

_FACING_COS = math.cos(math.radians(30.0))  # of the wall's line: a bow's ends lie aslant
_REACH_M = 0.10  # about where the wall is expected to go on
_STEP_M = 0.04  # off that is something else: a cupboard, a door
_LOOK_BACK_BINS = 6  # of the middle that say where it goes on
_MAX_GAP_BINS = 3
_MAX_BINS = 500


def bend_m(cloud: Cloud, line: WallLine, low_m: float, high_m: float) -> float:
    """Greatest distance of the middle from its own straight line; the wall is known to lie from `low_m` to `high_m`.

    It is followed beyond both, where it goes on without a step.
    """
    facing = cloud.normals @ line.normal > _FACING_COS
    across_m, along_m = line.across_m(cloud.points_m[facing]), cloud.points_m[facing] @ line.along
    bins = _by_bin(across_m, np.floor((along_m - low_m) / BIN_M).astype(np.int64))
    on_line = {k: values[np.abs(values) < _REACH_M] for k, values in bins.items() if 0 <= k * BIN_M < high_m - low_m}
    first = max(on_line, key=lambda k: len(on_line[k]), default=None)
    if first is None or len(on_line[first]) < BIN_POINTS:
        return 0.0
    middle = {first: float(np.median(on_line[first]))}
    for side in (1, -1):
        _follow(bins, middle, first, side)
    points_m = np.array([(BIN_M * k, at_m) for k, at_m in sorted(middle.items())])
    if len(points_m) < _LOOK_BACK_BINS:
        return 0.0
    return float(np.abs(total_least_squares(points_m, np.array([0.0, 1.0])).across_m(points_m)).max())


def _by_bin(across_m: FloatArray, bins: IntArray) -> dict[int, FloatArray]:
    order = np.argsort(bins, kind="stable")
    numbers, starts = np.unique(bins[order], return_index=True)
    return dict(zip(numbers.tolist(), np.split(across_m[order], starts[1:]), strict=True))


def _follow(bins: dict[int, FloatArray], middle: dict[int, float], first: int, side: int) -> None:
    """Adds to `middle` from bin `first` on, in the direction of `side`."""
    gap = 0
    for k in range(first + side, first + side * _MAX_BINS, side):
        expected_m = _expected_m(middle, k, side)
        near = bins.get(k, np.zeros(0))
        near = near[np.abs(near - expected_m) < _REACH_M]
        if len(near) >= BIN_POINTS and abs(float(np.median(near)) - expected_m) > _STEP_M:
            return
        gap = 0 if len(near) >= BIN_POINTS else gap + 1
        if gap > _MAX_GAP_BINS:
            return
        if gap == 0:
            middle[k] = float(np.median(near))


def _expected_m(middle: dict[int, float], k: int, side: int) -> float:
    """Where the wall would go on straight."""
    last = sorted(middle, key=lambda known: -side * known)[:_LOOK_BACK_BINS]
    if len(last) < 3:
        return middle[last[0]]
    return float(np.polyval(np.polyfit(last, [middle[known] for known in last], 1), k))
