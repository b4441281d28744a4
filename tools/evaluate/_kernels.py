"""Distances to and visibility of line segments in the plane."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_F64 = NDArray[np.float64]


@njit(nogil=True, cache=True)
def nearest_on_segments(points: _F64, segments: _F64, foot: _F64, distance: _F64) -> None:
    """For each of `points` (N, 2) the nearest point `foot` (N, 2) of `segments` (S, 2, 2) and its `distance` (N,)."""
    for i in range(points.shape[0]):
        px, py = points[i, 0], points[i, 1]
        best = math.inf
        for s in range(segments.shape[0]):
            ax, ay = segments[s, 0, 0], segments[s, 0, 1]
            dx, dy = segments[s, 1, 0] - ax, segments[s, 1, 1] - ay
            length2 = dx * dx + dy * dy
            t = ((px - ax) * dx + (py - ay) * dy) / length2 if length2 > 0.0 else 0.0
            t = min(1.0, max(0.0, t))
            fx, fy = ax + t * dx, ay + t * dy
            d2 = (px - fx) * (px - fx) + (py - fy) * (py - fy)
            if d2 < best:
                best = d2
                foot[i, 0] = fx
                foot[i, 1] = fy
        distance[i] = math.sqrt(best)


@njit(nogil=True, cache=True)
def blocked(ax: float, ay: float, bx: float, by: float, segments: _F64) -> bool:
    """Whether any of `segments` (S, 2, 2) crosses the way from a to b."""
    dx, dy = bx - ax, by - ay
    for s in range(segments.shape[0]):
        ux, uy = segments[s, 0, 0] - ax, segments[s, 0, 1] - ay
        vx, vy = segments[s, 1, 0] - ax, segments[s, 1, 1] - ay
        side_u = dx * uy - dy * ux
        side_v = dx * vy - dy * vx
        if (side_u > 0.0) == (side_v > 0.0):
            continue
        ex, ey = vx - ux, vy - uy
        side_a = ex * -uy + ey * ux
        side_b = ex * (dy - uy) - ey * (dx - ux)
        if (side_a > 0.0) != (side_b > 0.0):
            return True
    return False


@njit(nogil=True, cache=True)
def seen_from_any(
    points: _F64,
    normals: _F64,
    viewpoints: _F64,
    segments: _F64,
    range_min: float,
    range_max: float,
    min_cosine: float,
    seen: NDArray[np.bool_],
) -> None:
    """Which of `points` (N, 2) on surfaces with outward `normals` (N, 2) one of `viewpoints` (V, 2) sees."""
    count = viewpoints.shape[0]
    lucky = 0  # neighbours are mostly seen from the same place
    for i in range(points.shape[0]):
        seen[i] = False
        x = points[i, 0] + 1e-4 * normals[i, 0]
        y = points[i, 1] + 1e-4 * normals[i, 1]
        for k in range(count):
            v = (lucky + k) % count
            dx, dy = viewpoints[v, 0] - x, viewpoints[v, 1] - y
            range_m = math.sqrt(dx * dx + dy * dy)
            if range_m < range_min or range_m > range_max:
                continue
            if dx * normals[i, 0] + dy * normals[i, 1] < min_cosine * range_m:
                continue
            if not blocked(x, y, viewpoints[v, 0], viewpoints[v, 1], segments):
                seen[i] = True
                lucky = v
                break
