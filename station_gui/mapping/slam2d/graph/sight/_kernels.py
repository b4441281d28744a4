"""Kernel of lines of sight: plain arrays and scalars."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_MOST_SPACINGS = 1.5  # that two beams next to each other are apart
_WIDEST_BEAM = math.sin(math.radians(5.0))


@njit(nogil=True, cache=True)
def mark_seen_through(
    points: FloatArray,
    place_from_query: FloatArray,
    place_from_view: FloatArray,
    scanner: FloatArray,
    nearest_m: FloatArray,
    margin_m: float,
    margin_ratio: float,
    through: NDArray[np.bool_],
) -> None:
    """Mark the `points` (N, 2) that a view, a scan from `scanner` (2,), has looked through.

    `nearest_m` (B,): as of `fill_sectors`. A point is marked where the view's nearest points in its sector and in both
    next to it all lie behind it by more than the margin.
    """
    sectors = nearest_m.shape[0]
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
        if math.sqrt(dx * dx + dy * dy) * (1.0 + margin_ratio) + margin_m < behind_m:
            through[i] = True


@njit(nogil=True, cache=True)
def fill_sectors(view_points: NDArray[np.float32], scanner: FloatArray, nearest_m: FloatArray) -> None:
    """A view's nearest point in each of B sectors round its scanner, (B,), 0 where it saw nothing.

    `view_points`: (M, 2) and `scanner`: (2,), robot frame. Between two beams next to each other nothing is missing, be
    they ever so far apart, up to `_WIDEST_BEAM`.
    """
    sectors = nearest_m.shape[0]
    nearest_m[:] = 0.0
    widest = min(_MOST_SPACINGS * _spacing(view_points, scanner), _WIDEST_BEAM)
    last, last_x, last_y, last_m = 0, 0.0, 0.0, 0.0
    for i in range(view_points.shape[0]):
        x = view_points[i, 0] - scanner[0]
        y = view_points[i, 1] - scanner[1]
        k = _sector(x, y, sectors)
        range_m = math.sqrt(x * x + y * y)
        _lower(nearest_m, k, range_m)
        if _sine(last_x, last_y, last_m, x, y, range_m) <= widest:
            between_m = min(range_m, last_m)
            ahead = (k - last) % sectors
            first, count = (last, ahead) if 2 * ahead < sectors else (k, sectors - ahead)
            for step in range(1, count):
                _lower(nearest_m, (first + step) % sectors, between_m)
        last, last_x, last_y, last_m = k, x, y, range_m


@njit(nogil=True, cache=True)
def _lower(nearest_m: FloatArray, k: int, range_m: float) -> None:
    if nearest_m[k] == 0.0 or range_m < nearest_m[k]:
        nearest_m[k] = range_m


@njit(nogil=True, cache=True)
def _spacing(view_points: NDArray[np.float32], scanner: FloatArray) -> float:
    """Sine of the smallest angle between two points in a row: that of two beams, of which some hit nothing."""
    smallest = 1.0
    last_x, last_y, last_m = 0.0, 0.0, 0.0
    for i in range(view_points.shape[0]):
        x = view_points[i, 0] - scanner[0]
        y = view_points[i, 1] - scanner[1]
        range_m = math.sqrt(x * x + y * y)
        smallest = min(smallest, _sine(last_x, last_y, last_m, x, y, range_m))
        last_x, last_y, last_m = x, y, range_m
    return smallest


@njit(nogil=True, cache=True)
def _sine(x: float, y: float, range_m: float, other_x: float, other_y: float, other_m: float) -> float:
    """Of the angle between two directions, 1 where it is a right one or more, or a range is 0."""
    if x * other_x + y * other_y <= 0.0:
        return 1.0
    return abs(x * other_y - y * other_x) / (range_m * other_m)


@njit(nogil=True, cache=True)
def _sector(dx: float, dy: float, sectors: int) -> int:
    return math.floor((math.atan2(dy, dx) + math.pi) / (2.0 * math.pi) * sectors) % sectors
