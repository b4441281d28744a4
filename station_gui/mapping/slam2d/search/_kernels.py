"""Kernels of searches over many poses: plain arrays and scalars."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@njit(nogil=True, cache=True)
def fill_likelihood(
    distance2: NDArray[np.uint8], table: NDArray[np.uint8], factor: int, likelihood: NDArray[np.uint8]
) -> None:
    """Each cell of `likelihood` is the maximum over `factor` × `factor` cells of `table[distance2]`."""
    for row in range(likelihood.shape[0]):
        for column in range(likelihood.shape[1]):
            least = 255
            for r in range(row * factor, (row + 1) * factor):
                for q in range(column * factor, (column + 1) * factor):
                    least = min(least, distance2[r, q])
            likelihood[row, column] = table[least]


@njit(nogil=True, cache=True)
def fill_pyramid(levels: NDArray[np.uint8]) -> None:
    """Level 0 is given; a cell of level h is the maximum over the square of 2**h cells that begins there."""
    depth, height, width = levels.shape
    for h in range(1, depth):
        half = 1 << (h - 1)
        for row in range(height):
            low = min(row + half, height - 1)
            for column in range(width):
                right = min(column + half, width - 1)
                value = levels[h - 1, row, column]
                value = max(value, levels[h - 1, low, column])
                value = max(value, levels[h - 1, row, right])
                value = max(value, levels[h - 1, low, right])
                levels[h, row, column] = value


@njit(nogil=True, cache=True)
def score(
    columns: NDArray[np.int32], rows: NDArray[np.int32], levels: NDArray[np.uint8], h: int, dx: int, dy: int
) -> int:
    """Sum over all points, moved by whole cells, of level `h`; a square that begins outside still counts inside."""
    height = levels.shape[1]
    width = levels.shape[2]
    reach = 1 << h
    total = 0
    for p in range(columns.shape[0]):
        column = columns[p] + dx
        row = rows[p] + dy
        if column <= -reach or row <= -reach or column >= width or row >= height:
            continue
        total += levels[h, max(row, 0), max(column, 0)]
    return total


@njit(nogil=True, cache=True)
def branch_and_bound(
    points: FloatArray,
    levels: NDArray[np.uint8],
    origin_x: float,
    origin_y: float,
    cell_m: float,
    centre: FloatArray,
    shifts: int,
    turns: int,
    turn_rad: float,
    min_score: float,
    max_branches: int,
    best: FloatArray,
) -> float:
    """Depth first, most promising first; returns the mean likelihood of `best`, -1 where nothing is good enough."""
    count = points.shape[0]
    depth = levels.shape[0] - 1
    angles = 2 * turns + 1
    columns = np.zeros((angles, count), np.int32)
    rows = np.zeros((angles, count), np.int32)
    for a in range(angles):
        c = math.cos(centre[2] + (a - turns) * turn_rad)
        s = math.sin(centre[2] + (a - turns) * turn_rad)
        for p in range(count):
            columns[a, p] = math.floor((centre[0] + c * points[p, 0] - s * points[p, 1] - origin_x) / cell_m)
            rows[a, p] = math.floor((centre[1] + s * points[p, 0] + c * points[p, 1] - origin_y) / cell_m)
    stride = 1 << depth
    along = 2 * shifts // stride + 1
    roots = angles * along * along
    root_scores = np.zeros(roots, np.int64)
    for k in range(roots):
        a = k // (along * along)
        dy = -shifts + stride * (k // along % along)
        dx = -shifts + stride * (k % along)
        root_scores[k] = -score(columns[a], rows[a], levels, depth, dx, dy)
    order = np.argsort(root_scores, kind="mergesort")
    stack = np.zeros((4 * depth + 4, 5), np.int64)  # level, angle, dx, dy, score
    best_total = math.ceil(min_score * 255.0 * count) - 1
    found = False
    branches = 0
    for n in range(roots):
        k = order[n]
        if -root_scores[k] <= best_total or branches > max_branches:
            break
        stack[0, 0] = depth
        stack[0, 1] = k // (along * along)
        stack[0, 2] = -shifts + stride * (k % along)
        stack[0, 3] = -shifts + stride * (k // along % along)
        stack[0, 4] = -root_scores[k]
        top = 1
        while top > 0 and branches <= max_branches:
            top -= 1
            h = stack[top, 0]
            a = stack[top, 1]
            dx = stack[top, 2]
            dy = stack[top, 3]
            total = stack[top, 4]
            if total <= best_total:
                continue
            if h == 0:
                best_total = total
                found = True
                best[0] = centre[0] + dx * cell_m
                best[1] = centre[1] + dy * cell_m
                best[2] = centre[2] + (a - turns) * turn_rad
                continue
            half = 1 << (h - 1)
            first = top
            for child in range(4):
                cx = dx + half * (child & 1)
                cy = dy + half * (child >> 1)
                if cx > shifts or cy > shifts:
                    continue
                branches += 1
                value = score(columns[a], rows[a], levels, h - 1, cx, cy)
                if value <= best_total:
                    continue
                at = top
                while at > first and stack[at - 1, 4] > value:  # the best lies on top
                    for f in range(5):
                        stack[at, f] = stack[at - 1, f]
                    at -= 1
                stack[at, 0] = h - 1
                stack[at, 1] = a
                stack[at, 2] = cx
                stack[at, 3] = cy
                stack[at, 4] = value
                top += 1
    return best_total / (255.0 * count) if found else -1.0


@njit(nogil=True, cache=True)
def correlate(
    points: FloatArray,
    centre: FloatArray,
    shifts: int,
    shift_m: float,
    turns: int,
    turn_rad: float,
    likelihood: FloatArray,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    distance2: NDArray[np.uint8],
    best: FloatArray,
) -> float:
    """Exhaustive search round `centre`; `best` becomes the pose of the highest mean likelihood, which is returned."""
    height, width = distance2.shape
    count = points.shape[0]
    best_sum = -1.0
    for k in range(-turns, turns + 1):
        angle = centre[2] + k * turn_rad
        c = math.cos(angle)
        s = math.sin(angle)
        for j in range(-shifts, shifts + 1):
            for i in range(-shifts, shifts + 1):
                tx = centre[0] + i * shift_m
                ty = centre[1] + j * shift_m
                total = 0.0
                for p in range(count):
                    x = tx + c * points[p, 0] - s * points[p, 1]
                    y = ty + s * points[p, 0] + c * points[p, 1]
                    column = math.floor((x - origin_x) / cell_m)
                    row = math.floor((y - origin_y) / cell_m)
                    if 0 <= column < width and 0 <= row < height:
                        total += likelihood[distance2[row, column]]
                if total > best_sum:
                    best_sum = total
                    best[0] = tx
                    best[1] = ty
                    best[2] = angle
    return float(best_sum / max(count, 1))
