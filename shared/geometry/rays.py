"""Rays and distances among line segments in the plane.

Kernels: plain arrays and scalars. Segments are rows of an (S, 4) array: x0, y0, x1, y1 in m.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_PARALLEL = 1e-12


@njit(nogil=True, cache=True)
def cast_rays(
    x_m: float,
    y_m: float,
    directions_rad: NDArray[np.float64],
    segments_m: NDArray[np.float64],
    range_max_m: float,
    ranges_m: NDArray[np.float64],
) -> None:
    """Write into `ranges_m` (B,) the distance to the first segment in each direction, NaN beyond `range_max_m`."""
    for i in range(len(directions_rad)):
        ux = math.cos(directions_rad[i])
        uy = math.sin(directions_rad[i])
        nearest = math.inf
        for j in range(len(segments_m)):
            dx = segments_m[j, 2] - segments_m[j, 0]
            dy = segments_m[j, 3] - segments_m[j, 1]
            cross = ux * dy - uy * dx
            if abs(cross) < _PARALLEL:
                continue
            ox = segments_m[j, 0] - x_m
            oy = segments_m[j, 1] - y_m
            along = (ox * dy - oy * dx) / cross
            share = (ox * uy - oy * ux) / cross
            if 0.0 <= along < nearest and 0.0 <= share <= 1.0:
                nearest = along
        ranges_m[i] = nearest if nearest <= range_max_m else math.nan


@njit(nogil=True, cache=True)
def point_to_segment_m(px: float, py: float, x0: float, y0: float, x1: float, y1: float) -> float:
    """The distance of a point to a segment."""
    dx = x1 - x0
    dy = y1 - y0
    squared = dx * dx + dy * dy
    share = 0.0
    if squared > 0.0:
        share = max(0.0, min(1.0, ((px - x0) * dx + (py - y0) * dy) / squared))
    return math.hypot(px - x0 - share * dx, py - y0 - share * dy)


@njit(nogil=True, cache=True)
def _cross(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


@njit(nogil=True, cache=True)
def segments_gap_m(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """The distance between two segments, (4,) each; 0 where they cross."""
    d1 = _cross(a[0], a[1], a[2], a[3], b[0], b[1])
    d2 = _cross(a[0], a[1], a[2], a[3], b[2], b[3])
    d3 = _cross(b[0], b[1], b[2], b[3], a[0], a[1])
    d4 = _cross(b[0], b[1], b[2], b[3], a[2], a[3])
    if d1 * d2 < 0.0 and d3 * d4 < 0.0:
        return 0.0
    return min(
        point_to_segment_m(a[0], a[1], b[0], b[1], b[2], b[3]),
        point_to_segment_m(a[2], a[3], b[0], b[1], b[2], b[3]),
        point_to_segment_m(b[0], b[1], a[0], a[1], a[2], a[3]),
        point_to_segment_m(b[2], b[3], a[0], a[1], a[2], a[3]),
    )


@njit(nogil=True, cache=True)
def _inside(px: float, py: float, corners_m: NDArray[np.float64]) -> bool:
    count = len(corners_m)
    for i in range(count):
        j = (i + 1) % count
        if _cross(corners_m[i, 0], corners_m[i, 1], corners_m[j, 0], corners_m[j, 1], px, py) < 0.0:
            return False
    return True


@njit(nogil=True, cache=True)
def polygon_clearance_m(corners_m: NDArray[np.float64], segments_m: NDArray[np.float64]) -> float:
    """The distance of a convex counter-clockwise polygon, (K, 2), to the nearest segment; 0 where one touches it."""
    nearest = math.inf
    side = np.empty(4)
    count = len(corners_m)
    for j in range(len(segments_m)):
        if _inside(segments_m[j, 0], segments_m[j, 1], corners_m):
            return 0.0
        for i in range(count):
            k = (i + 1) % count
            side[0] = corners_m[i, 0]
            side[1] = corners_m[i, 1]
            side[2] = corners_m[k, 0]
            side[3] = corners_m[k, 1]
            nearest = min(nearest, segments_gap_m(side, segments_m[j]))
    return nearest
