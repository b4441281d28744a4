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
def _surround(segment_m: F64, start: I32, objects: int, box_m: F64) -> None:
    """`box_m`: (K, 2, 3) the least and the greatest coordinates of each object."""
    for k in range(objects):
        for axis in range(3):
            low, high = math.inf, -math.inf
            for s in range(start[k], start[k + 1]):
                for end in range(2):
                    low, high = min(low, segment_m[s, end, axis]), max(high, segment_m[s, end, axis])
            box_m[k, 0, axis], box_m[k, 1, axis] = low, high


@njit(nogil=True, cache=True, **UNCOUNTED)
def _is_near(x: float, y: float, z: float, segment_m: F64, first: int, end: int, box_m: F64, reach_m: float) -> bool:
    """Whether a point lies within `reach_m` of one of the segments, which lie in `box_m` (2, 3)."""
    if (
        x < box_m[0, 0] - reach_m
        or x > box_m[1, 0] + reach_m
        or y < box_m[0, 1] - reach_m
        or y > box_m[1, 1] + reach_m
        or z < box_m[0, 2] - reach_m
        or z > box_m[1, 2] + reach_m
    ):
        return False
    found = False
    k = first
    while k < end and not found:
        found = _near_segment(x, y, z, segment_m, k, reach_m)
        k += 1
    return found


@njit(nogil=True, cache=True, **UNCOUNTED)
def count_overlap(
    segment_m: F64,
    start: I32,
    objects: int,
    other_m: F64,
    other_start: I32,
    others: int,
    reach_m: F64,
    step_m: float,
    box_m: F64,
    total: I32,
    hits: I32,
) -> None:
    """`total`: (K,) the points every `step_m` along each object; `hits`: (K, L) how many lie near each of the others.

    `reach_m`: (L,) what is near. `box_m`: (L, 2, 3) room to work in.
    """
    _surround(other_m, other_start, others, box_m)
    for k in range(objects):
        total[k] = 0
        for o in range(others):
            hits[k, o] = 0
        for s in range(start[k], start[k + 1]):
            x, y, z = segment_m[s, 0, 0], segment_m[s, 0, 1], segment_m[s, 0, 2]
            dx, dy, dz = segment_m[s, 1, 0] - x, segment_m[s, 1, 1] - y, segment_m[s, 1, 2] - z
            parts = max(1, math.ceil(math.sqrt(dx * dx + dy * dy + dz * dz) / step_m))
            for part in range(parts):
                t = (part + 0.5) / parts
                px, py, pz = x + t * dx, y + t * dy, z + t * dz
                total[k] += 1
                for o in range(others):
                    first, end = other_start[o], other_start[o + 1]
                    hits[k, o] += _is_near(px, py, pz, other_m, first, end, box_m[o], reach_m[o])
