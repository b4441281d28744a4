"""Kernel of the search over a whole map for all places that fit: plain arrays and scalars."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from station_gui.mapping.slam2d.search._kernels import score


@njit(nogil=True, cache=True)
def search_turns(
    points: NDArray[np.float64],
    levels: NDArray[np.uint8],
    free: NDArray[np.uint8],
    first_turn: int,
    turns: int,
    cell_m: float,
    keep_level: int,
    least: int,
    behind_best: int,
    budget: int,
    columns: NDArray[np.int32],
    rows: NDArray[np.int32],
    found: NDArray[np.int64],
    state: NDArray[np.int64],
) -> int:
    """Branch and bound (Hess et al. 2016, algorithm 3) that keeps the best of every square, not of the map alone.

    `points`: (P, 2) round the scanner; turn k is 2πk/`turns`. `levels`, `free`: (L, H, W) pyramids of likelihood and
    of where a scanner may be. A leaf counts when it has `least` and is no more than `behind_best` below the best one;
    of each square of 2**`keep_level` cells and each turn the best leaf goes to `found`: rows of turn, column, row,
    sum. `state`: how many there are, the best sum so far, and sums computed. Returns the turn to go on with, once
    about `budget` sums have been computed.
    """
    depth = levels.shape[0] - 1
    height = levels.shape[1]
    width = levels.shape[2]
    stride = 1 << depth
    stack = np.zeros((4 * depth + 8, 4), np.int64)  # level, column, row, sum
    began = state[2]
    turn = first_turn
    while turn < turns and state[2] - began < budget:
        c = math.cos(2.0 * math.pi * turn / turns) / cell_m
        s = math.sin(2.0 * math.pi * turn / turns) / cell_m
        for p in range(points.shape[0]):
            columns[p] = math.floor(c * points[p, 0] - s * points[p, 1] + 0.5)
            rows[p] = math.floor(s * points[p, 0] + c * points[p, 1] + 0.5)
        for root in range(((height + stride - 1) // stride) * ((width + stride - 1) // stride)):
            across = (width + stride - 1) // stride
            row = stride * (root // across)
            column = stride * (root % across)
            if free[depth, row, column] == 0:
                continue
            state[2] += 1
            stack[0, 0] = depth
            stack[0, 1] = column
            stack[0, 2] = row
            stack[0, 3] = score(columns, rows, levels, depth, column, row)
            top = 1
            block_best = 0
            block_column = 0
            block_row = 0
            while top > 0:
                top -= 1
                h = stack[top, 0]
                column = stack[top, 1]
                row = stack[top, 2]
                total = stack[top, 3]
                if h >= keep_level:
                    _keep(found, state, turn, block_column, block_row, block_best)
                    block_best = 0
                if total < max(least, state[1] - behind_best, block_best + 1):
                    continue
                if h == 0:
                    block_best = total
                    block_column = column
                    block_row = row
                    state[1] = max(state[1], total)
                    continue
                half = 1 << (h - 1)
                bottom = top
                for child in range(4):
                    x = column + half * (child & 1)
                    y = row + half * (child >> 1)
                    if x >= width or y >= height or free[h - 1, y, x] == 0:
                        continue
                    state[2] += 1
                    value = score(columns, rows, levels, h - 1, x, y)
                    if value < max(least, state[1] - behind_best, block_best + 1):
                        continue
                    at = top
                    while at > bottom and stack[at - 1, 3] > value:  # the best lies on top
                        for f in range(4):
                            stack[at, f] = stack[at - 1, f]
                        at -= 1
                    stack[at, 0] = h - 1
                    stack[at, 1] = x
                    stack[at, 2] = y
                    stack[at, 3] = value
                    top += 1
            _keep(found, state, turn, block_column, block_row, block_best)
        turn += 1
    return turn


@njit(nogil=True, cache=True)
def _keep(found: NDArray[np.int64], state: NDArray[np.int64], turn: int, column: int, row: int, total: int) -> None:
    """When all rows are taken the worst gives way."""
    if total == 0:
        return
    at = state[0]
    if at == found.shape[0]:
        at = 0
        for k in range(1, found.shape[0]):
            if found[k, 3] < found[at, 3]:
                at = k
        if found[at, 3] >= total:
            return
    else:
        state[0] += 1
    found[at, 0] = turn
    found[at, 1] = column
    found[at, 2] = row
    found[at, 3] = total
