"""Kernels of the clustering. Lines are rows of `ends_m` (N, 2, 2), from above; one without length has no direction."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


@njit(nogil=True, cache=True)
def turn_rad(a: F64, b: F64) -> float:
    """The angle between two undirected lines, (2, 2) each (eq 36 for both); 0 where one has no length."""
    ux, uy = a[1, 0] - a[0, 0], a[1, 1] - a[0, 1]
    vx, vy = b[1, 0] - b[0, 0], b[1, 1] - b[0, 1]
    cross, dot = ux * vy - uy * vx, ux * vx + uy * vy
    return math.atan2(abs(cross), abs(dot)) if cross != 0.0 or dot != 0.0 else 0.0


@njit(nogil=True, cache=True)
def point_from_line(x: float, y: float, line: F64, offset_weight: float) -> float:
    """How far a point is from a segment (eq 37); beside it the way across counts `offset_weight` times."""
    dx, dy = line[1, 0] - line[0, 0], line[1, 1] - line[0, 1]
    length = math.hypot(dx, dy)
    if length == 0.0:
        return math.hypot(x - line[0, 0], y - line[0, 1])
    along = ((x - line[0, 0]) * dx + (y - line[0, 1]) * dy) / length
    across = abs((x - line[0, 0]) * dy - (y - line[0, 1]) * dx) / length
    return math.hypot(max(-along, along - length, 0.0), offset_weight * across)


@njit(nogil=True, cache=True)
def line_distance(a: F64, b: F64, offset_weight: float) -> float:
    """Of the ends and the middle of the shorter line from the longer one, the nearest."""
    if math.hypot(a[1, 0] - a[0, 0], a[1, 1] - a[0, 1]) > math.hypot(b[1, 0] - b[0, 0], b[1, 1] - b[0, 1]):
        a, b = b, a
    nearest = math.inf
    for k in range(3):
        t = 0.5 * k
        x, y = a[0, 0] + t * (a[1, 0] - a[0, 0]), a[0, 1] + t * (a[1, 1] - a[0, 1])
        nearest = min(nearest, point_from_line(x, y, b, offset_weight))
    return nearest


@njit(nogil=True, cache=True)
def dbscan(
    ends_m: F64, objects: I64, order: I64, theta_th: float, eps_m: float, min_objects: int, offset_weight: float,
    members: I64, labels: I64,
) -> int:  # fmt: skip
    """Write the cluster of each line into `labels`, -1 for noise; returns how many clusters there are.

    `objects`: (N,) for how many objects each line stands. `order`: (N,) by the least x. `members`: (N,) room to work
    in. The paper draws the first line of a cluster at random; here it is the first that is left, which changes the
    numbers of the clusters only.
    """
    count = len(ends_m)
    for i in range(count):
        labels[i] = -2
    longest = 0.0
    for i in range(count):
        longest = max(longest, abs(ends_m[i, 1, 0] - ends_m[i, 0, 0]))
    clusters = 0
    for seed in range(count):
        if labels[seed] != -2:
            continue
        members[0] = seed
        labels[seed] = clusters
        size, core, weight = 1, 0, objects[seed]
        while core < size:
            size, added = _expand(ends_m, objects, order, members, core, size, labels, clusters, theta_th, eps_m,
                                  offset_weight, longest)  # fmt: skip
            weight += added
            core += 1
        if weight >= min_objects:
            clusters += 1
        else:
            for k in range(size):
                labels[members[k]] = -1
    return clusters


@njit(nogil=True, cache=True)
def _expand(
    ends_m: F64, objects: I64, order: I64, members: I64, core: int, size: int, labels: I64, label: int,
    theta_th: float, eps_m: float, offset_weight: float, longest: float,
) -> tuple[int, int]:  # fmt: skip
    """Add all lines that a core reaches; returns the new size and the objects that came."""
    at = members[core]
    first = min(ends_m[at, 0, 0], ends_m[at, 1, 0]) - eps_m
    high = max(ends_m[at, 0, 0], ends_m[at, 1, 0]) + eps_m
    below = min(ends_m[at, 0, 1], ends_m[at, 1, 1]) - eps_m
    above = max(ends_m[at, 0, 1], ends_m[at, 1, 1]) + eps_m
    added = 0
    for k in range(_first_from(ends_m, order, first - longest), len(order)):
        j = order[k]
        if min(ends_m[j, 0, 0], ends_m[j, 1, 0]) > high:
            break
        if labels[j] != -2 or max(ends_m[j, 0, 0], ends_m[j, 1, 0]) < first:
            continue
        if min(ends_m[j, 0, 1], ends_m[j, 1, 1]) > above or max(ends_m[j, 0, 1], ends_m[j, 1, 1]) < below:
            continue
        if turn_rad(ends_m[j], ends_m[at]) > theta_th:
            continue
        if line_distance(ends_m[j], ends_m[at], offset_weight) <= eps_m:
            labels[j] = label
            members[size] = j
            size += 1
            added += objects[j]
    return size, added


@njit(nogil=True, cache=True)
def _first_from(ends_m: F64, order: I64, low: float) -> int:
    """The first place in `order` whose line's least x is not below `low`."""
    first, last = 0, len(order)
    while first < last:
        middle = (first + last) // 2
        j = order[middle]
        if min(ends_m[j, 0, 0], ends_m[j, 1, 0]) < low:
            first = middle + 1
        else:
            last = middle
    return first


@njit(nogil=True, cache=True)
def nearest_cluster(
    points_m: F64, order: I64, ends_m: F64, labels: I64, reach_m: float, nearest_m: F64, owner: I64
) -> None:
    """Write into `owner` (M,) the cluster of the line nearest to each point, -1 where none is within `reach_m`.

    `order`: (M,) of the points by y. `nearest_m`: (M,) room to work in.
    """
    owner[:] = -1
    nearest_m[:] = reach_m
    for j in range(len(ends_m)):
        if labels[j] < 0:
            continue
        low_x = min(ends_m[j, 0, 0], ends_m[j, 1, 0]) - reach_m
        high_x = max(ends_m[j, 0, 0], ends_m[j, 1, 0]) + reach_m
        high_y = max(ends_m[j, 0, 1], ends_m[j, 1, 1]) + reach_m
        for k in range(_first_above(points_m, order, min(ends_m[j, 0, 1], ends_m[j, 1, 1]) - reach_m), len(order)):
            i = order[k]
            if points_m[i, 1] > high_y:
                break
            if points_m[i, 0] < low_x or points_m[i, 0] > high_x:
                continue
            distance = point_from_line(points_m[i, 0], points_m[i, 1], ends_m[j], 1.0)
            if distance <= nearest_m[i]:
                nearest_m[i] = distance
                owner[i] = labels[j]


@njit(nogil=True, cache=True)
def _first_above(points_m: F64, order: I64, low: float) -> int:
    """The first place in `order` whose point's y is not below `low`."""
    first, last = 0, len(order)
    while first < last:
        middle = (first + last) // 2
        if points_m[order[middle], 1] < low:
            first = middle + 1
        else:
            last = middle
    return first
