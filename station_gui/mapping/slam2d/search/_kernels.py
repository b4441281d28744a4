"""Kernels of searches over many poses: plain arrays and scalars."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@njit(nogil=True, cache=True)
def fill_likelihood(
    distance2: NDArray[np.uint8],
    table: NDArray[np.uint8],
    factor: int,
    likelihood: NDArray[np.uint8],
    first: int,
    last: int,
) -> None:
    """Each cell of the rows `first` to `last` is the maximum over `factor` × `factor` cells of `table[distance2]`."""
    for row in range(first, last):
        for column in range(likelihood.shape[1]):
            least = 255
            for r in range(row * factor, (row + 1) * factor):
                for q in range(column * factor, (column + 1) * factor):
                    least = min(least, distance2[r, q])
            likelihood[row, column] = table[least]


@njit(nogil=True, cache=True)
def fill_level(levels: NDArray[np.uint8], h: int, first: int, last: int) -> None:
    """A cell of level h is the maximum over the square of 2**h cells that begins there; rows `first` to `last`."""
    height = levels.shape[1]
    width = levels.shape[2]
    half = 1 << (h - 1)
    below = levels[h - 1]
    for row in range(first, last):
        low = min(row + half, height - 1)
        for column in range(width - half):
            value = max(below[row, column], below[low, column])
            value = max(value, below[row, column + half], below[low, column + half])
            levels[h, row, column] = value
        for column in range(max(0, width - half), width):
            value = max(below[row, column], below[low, column])
            levels[h, row, column] = max(value, below[row, width - 1], below[low, width - 1])


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


# Of the state of a search:
ANGLE = 0  # the next whose roots are to be scored
WAITING = 1  # roots in the heap
TOP = 2  # entries of the stack
BEST = 3  # sum that must be surpassed
FOUND = 4
BRANCHES = 5
DONE = 6

_POINTS_PER_UNIT = 8


@njit(nogil=True, cache=True)
def score_roots(
    points: FloatArray,
    levels: NDArray[np.uint8],
    origin_x: float,
    origin_y: float,
    cell_m: float,
    centre: FloatArray,
    shifts: int,
    turns: int,
    turn_rad: float,
    columns: NDArray[np.int32],
    rows: NDArray[np.int32],
    heap: NDArray[np.int64],
    state: NDArray[np.int64],
    budget: int,
) -> int:
    """Score the coarsest squares, angle after angle from `state[ANGLE]`; those that may hold the best are kept.

    `columns` and `rows` (angles, points) get each point's cell at each angle; `heap` (roots, 2): score and number.
    Returns the work taken, in units of `_POINTS_PER_UNIT` look-ups.
    """
    count = points.shape[0]
    depth = levels.shape[0] - 1
    stride = 1 << depth
    along = 2 * shifts // stride + 1
    work = 0
    while state[ANGLE] < 2 * turns + 1 and work < budget:
        a = state[ANGLE]
        c = math.cos(centre[2] + (a - turns) * turn_rad)
        s = math.sin(centre[2] + (a - turns) * turn_rad)
        for p in range(count):
            columns[a, p] = math.floor((centre[0] + c * points[p, 0] - s * points[p, 1] - origin_x) / cell_m)
            rows[a, p] = math.floor((centre[1] + s * points[p, 0] + c * points[p, 1] - origin_y) / cell_m)
        for k in range(along * along):
            dy = -shifts + stride * (k // along)
            dx = -shifts + stride * (k % along)
            total = score(columns[a], rows[a], levels, depth, dx, dy)
            if total > state[BEST]:
                _push_root(heap, state[WAITING], total, a * along * along + k)
                state[WAITING] += 1
        state[ANGLE] += 1
        work += 1 + count * (along * along + 1) // _POINTS_PER_UNIT
    return work


@njit(nogil=True, cache=True)
def _before(score_a: int, number_a: int, score_b: int, number_b: int) -> bool:
    return score_a > score_b or (score_a == score_b and number_a < number_b)


@njit(nogil=True, cache=True)
def _push_root(heap: NDArray[np.int64], size: int, total: int, number: int) -> None:
    at = size
    while at > 0 and _before(total, number, heap[(at - 1) // 2, 0], heap[(at - 1) // 2, 1]):
        heap[at, 0] = heap[(at - 1) // 2, 0]
        heap[at, 1] = heap[(at - 1) // 2, 1]
        at = (at - 1) // 2
    heap[at, 0] = total
    heap[at, 1] = number


@njit(nogil=True, cache=True)
def _pop_root(heap: NDArray[np.int64], size: int) -> None:
    """Remove the first; `size` counts it."""
    total = heap[size - 1, 0]
    number = heap[size - 1, 1]
    at = 0
    while True:
        child = 2 * at + 1
        if child >= size - 1:
            break
        if child + 1 < size - 1 and _before(heap[child + 1, 0], heap[child + 1, 1], heap[child, 0], heap[child, 1]):
            child += 1
        if _before(total, number, heap[child, 0], heap[child, 1]):
            break
        heap[at, 0] = heap[child, 0]
        heap[at, 1] = heap[child, 1]
        at = child
    heap[at, 0] = total
    heap[at, 1] = number


@njit(nogil=True, cache=True)
def descend(
    levels: NDArray[np.uint8],
    shifts: int,
    max_branches: int,
    columns: NDArray[np.int32],
    rows: NDArray[np.int32],
    heap: NDArray[np.int64],
    stack: NDArray[np.int64],
    best: NDArray[np.int64],
    state: NDArray[np.int64],
    budget: int,
) -> int:
    """Depth first, most promising first, until nothing can surpass `best` (3,): angle and shifts in cells.

    `stack` (4 depth + 4, 5): level, angle, dx, dy, score. Returns the work taken as `score_roots` does.
    """
    depth = levels.shape[0] - 1
    stride = 1 << depth
    along = 2 * shifts // stride + 1
    cost = 1 + columns.shape[1] // _POINTS_PER_UNIT
    work = 0
    while work < budget and state[DONE] == 0:
        if state[TOP] == 0:
            if state[WAITING] == 0 or heap[0, 0] <= state[BEST] or state[BRANCHES] > max_branches:
                state[DONE] = 1
                break
            number = heap[0, 1]
            stack[0, 0] = depth
            stack[0, 1] = number // (along * along)
            stack[0, 2] = -shifts + stride * (number % along)
            stack[0, 3] = -shifts + stride * (number // along % along)
            stack[0, 4] = heap[0, 0]
            state[TOP] = 1
            _pop_root(heap, state[WAITING])
            state[WAITING] -= 1
        state[TOP] -= 1
        top = state[TOP]
        h = stack[top, 0]
        a = stack[top, 1]
        dx = stack[top, 2]
        dy = stack[top, 3]
        work += 1
        if stack[top, 4] <= state[BEST]:
            continue
        if h == 0:
            state[BEST] = stack[top, 4]
            state[FOUND] = 1
            best[0] = a
            best[1] = dx
            best[2] = dy
            continue
        half = 1 << (h - 1)
        for child in range(4):
            cx = dx + half * (child & 1)
            cy = dy + half * (child >> 1)
            if cx > shifts or cy > shifts:
                continue
            state[BRANCHES] += 1
            work += cost
            value = score(columns[a], rows[a], levels, h - 1, cx, cy)
            if value > state[BEST]:
                _stack_child(stack, top, state, h - 1, a, cx, cy, value)
        if state[BRANCHES] > max_branches:
            state[TOP] = 0
    return work


@njit(nogil=True, cache=True)
def _stack_child(
    stack: NDArray[np.int64], first: int, state: NDArray[np.int64], h: int, a: int, dx: int, dy: int, value: int
) -> None:
    """Among its brothers from `first` on, so that the best lies on top."""
    at = state[TOP]
    while at > first and stack[at - 1, 4] > value:
        for f in range(5):
            stack[at, f] = stack[at - 1, f]
        at -= 1
    stack[at, 0] = h
    stack[at, 1] = a
    stack[at, 2] = dx
    stack[at, 3] = dy
    stack[at, 4] = value
    state[TOP] += 1


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
