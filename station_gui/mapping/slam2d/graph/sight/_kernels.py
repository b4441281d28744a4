"""Kernel of lines of sight: plain arrays and scalars."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@njit(nogil=True, cache=True)
def mark_seen_through(
    points: FloatArray,
    place_from_query: FloatArray,
    view_points: NDArray[np.float32],
    place_from_view: FloatArray,
    scanner: FloatArray,
    nearest_m: FloatArray,
    margin_m: float,
    margin_ratio: float,
    through: NDArray[np.bool_],
) -> None:
    """Mark the `points` (N, 2) that a view, a scan of `view_points` (M, 2) from `scanner` (2,), has looked through.

    `nearest_m` (B,) is room for the view's nearest point in each of B sectors. A point is marked where the view's
    nearest points in its sector and in both next to it all lie behind it by more than the margin.
    """
    sectors = nearest_m.shape[0]
    nearest_m[:] = 0.0
    for i in range(view_points.shape[0]):
        dx = view_points[i, 0] - scanner[0]
        dy = view_points[i, 1] - scanner[1]
        k = _sector(dx, dy, sectors)
        range_m = math.hypot(dx, dy)
        if nearest_m[k] == 0.0 or range_m < nearest_m[k]:
            nearest_m[k] = range_m
    cq = math.cos(place_from_query[2])
    sq = math.sin(place_from_query[2])
    cv = math.cos(place_from_view[2])
    sv = math.sin(place_from_view[2])
    for i in range(points.shape[0]):
        px = place_from_query[0] + cq * points[i, 0] - sq * points[i, 1] - place_from_view[0]
        py = place_from_query[1] + sq * points[i, 0] + cq * points[i, 1] - place_from_view[1]
        dx = cv * px + sv * py - scanner[0]
        dy = -sv * px + cv * py - scanner[1]
        k = _sector(dx, dy, sectors)
        before = nearest_m[k - 1 if k > 0 else sectors - 1]
        after = nearest_m[k + 1 if k + 1 < sectors else 0]
        behind_m = min(nearest_m[k], before, after)  # 0 where nothing was seen
        if math.hypot(dx, dy) * (1.0 + margin_ratio) + margin_m < behind_m:
            through[i] = True


@njit(nogil=True, cache=True)
def _sector(dx: float, dy: float, sectors: int) -> int:
    return math.floor((math.atan2(dy, dx) + math.pi) / (2.0 * math.pi) * sectors) % sectors
