"""Kernels of RANSAC. `points_m`: (N, 2)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_STEEP = math.tan(math.radians(45.0))
_REFITS = 3


@njit(nogil=True, cache=True)
def _support(points_m: F64, x1: float, y1: float, x2: float, y2: float, inlier_m: float, soft: bool) -> float:
    """How many points lie near a line; measured along y for flat lines and along x for steep ones.

    `soft`: a point counts the less the farther it is (MSAC, Torr and Zisserman 2000), so that no line slants through
    two fronts that stand close behind one another.
    """
    support = 0.0
    dx, dy = x2 - x1, y2 - y1
    flat = abs(dy) <= _STEEP * abs(dx)
    for j in range(len(points_m)):
        if flat:
            distance = abs(dy / dx * (points_m[j, 0] - x1) + y1 - points_m[j, 1])
        else:
            distance = abs(dx / dy * (points_m[j, 1] - y1) + x1 - points_m[j, 0])
        if distance <= inlier_m:
            support += 1.0 - (distance / inlier_m) ** 2 if soft else 1.0
    return support


@njit(nogil=True, cache=True)
def ransac_line(points_m: F64, draws: F64, iterations: int, inlier_m: float, soft: bool, line: F64) -> float:
    """Algorithm 2: the best line through two of the points, into `line` (2, 2); returns its support.

    `draws`: (I, 2) uniform in [0, 1), the random numbers. A slope and an intercept (eqs 38 and 39) have no upright
    lines, so a line is two points here.
    """
    count, most = len(points_m), -1.0
    for i in range(min(iterations, len(draws))):
        first = int(draws[i, 0] * count)
        second = int(draws[i, 1] * (count - 1))
        second += 1 if second >= first else 0
        x1, y1 = points_m[first, 0], points_m[first, 1]
        x2, y2 = points_m[second, 0], points_m[second, 1]
        if x1 == x2 and y1 == y2:
            continue
        found = _support(points_m, x1, y1, x2, y2, inlier_m, soft)
        if found > most:
            most = found
            line[0, 0], line[0, 1], line[1, 0], line[1, 1] = x1, y1, x2, y2
    return most


@njit(nogil=True, cache=True)
def near_line(points_m: F64, line: F64, reach_m: float, picked: F64) -> int:
    """Write the points within `reach_m` of a line into `picked`; returns how many there are."""
    ux, uy = line[1, 0] - line[0, 0], line[1, 1] - line[0, 1]
    length = math.hypot(ux, uy)
    count = 0
    for j in range(len(points_m)):
        across = ux * (points_m[j, 1] - line[0, 1]) - uy * (points_m[j, 0] - line[0, 0])
        if abs(across) <= reach_m * length:
            picked[count, 0], picked[count, 1] = points_m[j, 0], points_m[j, 1]
            count += 1
    return count


@njit(nogil=True, cache=True)
def longest_run(points_m: F64, line: F64, reach_m: float, gap_m: float, run: F64) -> int:
    """Write into `run` the points near a line that follow one another without a longer gap: most of them.

    Returns how many there are.
    """
    near = near_line(points_m, line, reach_m, run)
    ux, uy = line[1, 0] - line[0, 0], line[1, 1] - line[0, 1]
    length = math.hypot(ux, uy)
    along = (run[:near, 0] * ux + run[:near, 1] * uy) / length
    order = np.argsort(along, kind="mergesort")
    first, best, begin = 0, 0, 0
    for k in range(1, near + 1):
        if k == near or along[order[k]] - along[order[k - 1]] > gap_m:
            if k - begin > best:
                first, best = begin, k - begin
            begin = k
    sorted_run = run[:near][order[first : first + best]]
    run[:best] = sorted_run
    return best


@njit(nogil=True, cache=True)
def drop_along(points_m: F64, line: F64, reach_m: float) -> int:
    """Keep the points that do not lie along a segment, in front and in their order; returns how many there are."""
    ux, uy = line[1, 0] - line[0, 0], line[1, 1] - line[0, 1]
    length = math.hypot(ux, uy)
    count = 0
    for j in range(len(points_m)):
        dx, dy = points_m[j, 0] - line[0, 0], points_m[j, 1] - line[0, 1]
        along, across = (ux * dx + uy * dy) / length, (ux * dy - uy * dx) / length
        if abs(across) > reach_m or along < -reach_m or along > length + reach_m:
            points_m[count, 0], points_m[count, 1] = points_m[j, 0], points_m[j, 1]
            count += 1
    return count


@njit(nogil=True, cache=True)
def fit_lines(
    points_m: F64, draws: F64, iterations_per_point: float, coarse_m: float, fine_m: float, gap_m: float, least: int,
    left_m: F64, near_m: F64, run_m: F64, lines: F64,
) -> int:  # fmt: skip
    """The lines through the points of a cluster, one after the other, into `lines` (L, 2, 2); returns how many.

    RANSAC with the coarse threshold finds a wall, RANSAC among its inliers with the fine one the front of it that most
    points lie on, least squares its place. A line ends where its points leave a gap. `left_m`, `near_m`, `run_m`:
    (N, 2) room to work in.
    """
    found, left = 0, len(points_m)
    left_m[:left] = points_m
    while found < len(lines) and left >= least:
        line = lines[found]
        if ransac_line(left_m[:left], draws, math.ceil(iterations_per_point * left), coarse_m, False, line) < least:
            break
        near = near_line(left_m[:left], line, coarse_m, near_m)
        ransac_line(near_m[:near], draws, math.ceil(iterations_per_point * near), fine_m, True, line)
        run = longest_run(near_m[:near], line, fine_m, gap_m, run_m)
        if run < least:
            break
        for _ in range(_REFITS):
            _refit(run_m[:run], fine_m, line)
            run = longest_run(near_m[:near], line, fine_m, gap_m, run_m)
            if run < 2:
                break
        if run < least:
            break
        left = drop_along(left_m[:left], line, 2.0 * fine_m)
        found += 1
    return found


@njit(nogil=True, cache=True)
def _refit(points_m: F64, reach_m: float, line: F64) -> int:
    ux, uy = line[1, 0] - line[0, 0], line[1, 1] - line[0, 1]
    length = math.hypot(ux, uy)
    if length == 0.0:
        return 0
    ux, uy = ux / length, uy / length
    count, mx, my = 0, 0.0, 0.0
    for j in range(len(points_m)):
        if abs(ux * (points_m[j, 1] - line[0, 1]) - uy * (points_m[j, 0] - line[0, 0])) <= reach_m:
            count += 1
            mx += points_m[j, 0]
            my += points_m[j, 1]
    if count < 2:
        return 0
    mx, my = mx / count, my / count
    xx, xy, yy = 0.0, 0.0, 0.0
    for j in range(len(points_m)):
        dx, dy = points_m[j, 0] - line[0, 0], points_m[j, 1] - line[0, 1]
        if abs(ux * dy - uy * dx) <= reach_m:
            dx, dy = points_m[j, 0] - mx, points_m[j, 1] - my
            xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    vx, vy = math.cos(angle), math.sin(angle)
    low, high = math.inf, -math.inf
    for j in range(len(points_m)):
        dx, dy = points_m[j, 0] - line[0, 0], points_m[j, 1] - line[0, 1]
        if abs(ux * dy - uy * dx) <= reach_m:
            along = vx * (points_m[j, 0] - mx) + vy * (points_m[j, 1] - my)
            low, high = min(low, along), max(high, along)
    line[0, 0], line[0, 1] = mx + low * vx, my + low * vy
    line[1, 0], line[1, 1] = mx + high * vx, my + high * vy
    return count
