"""Kernels that compare outlines. segment_m: (S, 2, 3) float64, the connections, object by object; start: (K + 1,)
int32, where each object begins."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robot_app.perception._kernels import UNCOUNTED

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]


@njit(nogil=True, cache=True, **UNCOUNTED)
def _near_segment(x: float, y: float, z: float, segment_m: F64, k: int, reach_m: float) -> bool:
    ax, ay, az = segment_m[k, 0, 0], segment_m[k, 0, 1], segment_m[k, 0, 2]
    dx, dy, dz = segment_m[k, 1, 0] - ax, segment_m[k, 1, 1] - ay, segment_m[k, 1, 2] - az
    square = dx * dx + dy * dy + dz * dz
    t = ((x - ax) * dx + (y - ay) * dy + (z - az) * dz) / square if square > 0.0 else 0.0
    t = min(1.0, max(0.0, t))
    ex, ey, ez = ax + t * dx - x, ay + t * dy - y, az + t * dz - z
    near: bool = ex * ex + ey * ey + ez * ez <= reach_m * reach_m
    return near


@njit(nogil=True, cache=True, **UNCOUNTED)
def _surround(segment_m: F64, first: int, end: int, box_m: F64) -> None:
    """`box_m`: (2, 3) the least and the greatest coordinates of segments `first` to `end`."""
    for axis in range(3):
        low, high = math.inf, -math.inf
        for s in range(first, end):
            for side in range(2):
                low, high = min(low, segment_m[s, side, axis]), max(high, segment_m[s, side, axis])
        box_m[0, axis], box_m[1, axis] = low, high


@njit(nogil=True, cache=True, **UNCOUNTED)
def _count_near(
    segment_m: F64, first: int, end: int, other_m: F64, other_first: int, other_end: int, reach_m: float, step_m: float
) -> tuple[int, int]:
    """How many points every `step_m` along the first segments lie within `reach_m` of the other ones, and how many
    points there are."""
    hits, total = 0, 0
    for s in range(first, end):
        x, y, z = segment_m[s, 0, 0], segment_m[s, 0, 1], segment_m[s, 0, 2]
        dx, dy, dz = segment_m[s, 1, 0] - x, segment_m[s, 1, 1] - y, segment_m[s, 1, 2] - z
        parts = max(1, math.ceil(math.sqrt(dx * dx + dy * dy + dz * dz) / step_m))
        total += parts
        for part in range(parts):
            t = (part + 0.5) / parts
            for k in range(other_first, other_end):
                if _near_segment(x + t * dx, y + t * dy, z + t * dz, other_m, k, reach_m):
                    hits += 1
                    break
    return hits, total


@njit(nogil=True, cache=True, **UNCOUNTED)
def _share_near(
    segment_m: F64,
    start: I32,
    box_m: F64,
    k: int,
    other_m: F64,
    other_start: I32,
    other_box_m: F64,
    o: int,
    reach_m: float,
    step_m: float,
) -> float:
    """Of the points every `step_m` along object k, which part lies near the other object o."""
    for axis in range(3):
        if box_m[k, 0, axis] > other_box_m[o, 1, axis] + reach_m:
            return 0.0
        if box_m[k, 1, axis] < other_box_m[o, 0, axis] - reach_m:
            return 0.0
    hits, total = _count_near(
        segment_m, start[k], start[k + 1], other_m, other_start[o], other_start[o + 1], reach_m, step_m
    )
    share: float = hits / total
    return share


@njit(nogil=True, cache=True, **UNCOUNTED)
def measure_overlap(
    segment_m: F64,
    start: I32,
    other_m: F64,
    other_start: I32,
    reach_m: F64,
    step_m: float,
    box_m: F64,
    other_box_m: F64,
    share: F64,
) -> None:
    """`share`: (K, L) of the points every `step_m` along each object, which part lies near each of the others.

    `reach_m`: (L,) what is near. `box_m`: (K, 2, 3), `other_box_m`: (L, 2, 3) room to work in.
    """
    for k in range(share.shape[0]):
        _surround(segment_m, start[k], start[k + 1], box_m[k])
    for o in range(share.shape[1]):
        _surround(other_m, other_start[o], other_start[o + 1], other_box_m[o])
    for k in range(share.shape[0]):
        for o in range(share.shape[1]):
            share[k, o] = _share_near(
                segment_m, start, box_m, k, other_m, other_start, other_box_m, o, reach_m[o], step_m
            )


@njit(nogil=True, cache=True, **UNCOUNTED)
def mark_whole(
    segment_m: F64, start: I32, reach_m: F64, keep_share: float, step_m: float, box_m: F64, whole: U8
) -> None:
    """`whole`: (K,) 0 for an object of which `keep_share` lies near one before it that is whole, else 1.

    `reach_m`: (K,) what is near. `box_m`: (K, 2, 3) room to work in.
    """
    for k in range(whole.size):
        _surround(segment_m, start[k], start[k + 1], box_m[k])
        whole[k] = 1
        for o in range(k):
            if whole[o] == 1 and whole[k] == 1:
                share = _share_near(segment_m, start, box_m, k, segment_m, start, box_m, o, reach_m[o], step_m)
                whole[k] = share < keep_share


@njit(nogil=True, cache=True, **UNCOUNTED)
def match_most_alike(alike: F64, least: float, owners: I32) -> None:
    """`owners`: (K,) for each row of `alike` (K, L) its column, the most alike pair first, none for two rows; as given
    where nothing is left of at least `least`. What is given away is set to -1 in `alike`."""
    rows, columns = alike.shape
    while True:
        best, row, column = least, -1, -1
        for k in range(rows):
            for o in range(columns):
                if alike[k, o] > best or (row < 0 and alike[k, o] >= best):
                    best, row, column = alike[k, o], k, o
        if row < 0:
            return
        owners[row] = column
        for o in range(columns):
            alike[row, o] = -1.0
        for k in range(rows):
            alike[k, column] = -1.0
