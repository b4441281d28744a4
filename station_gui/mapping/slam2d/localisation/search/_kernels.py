"""Kernel of the search over a whole map for all places that fit: plain arrays and scalars."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_ROWS_PER_SUM = 128  # that are gone through in the time of one sum


@njit(nogil=True, cache=True)
def _score(levels: NDArray[np.uint8], h: int, at: int, offsets: NDArray[np.int64]) -> int:
    """Sum over all points, `offsets` (P,) from the cell `at`, of level `h` of (L, cells): none may lie outside."""
    total = 0
    for p in range(offsets.shape[0]):
        total += levels[h, at + offsets[p]]
    return total


@njit(nogil=True, cache=True)
def search_turns(
    points: NDArray[np.float64],
    levels: NDArray[np.uint8],
    free: NDArray[np.uint8],
    first: int,
    turns: int,
    stride: int,
    cell_m: float,
    keep_level: int,
    least: int,
    behind_best: int,
    budget: int,
    offsets: NDArray[np.int64],
    found: NDArray[np.int64],
    state: NDArray[np.int64],
) -> int:
    """Branch and bound (Hess et al. 2016, algorithm 3) that keeps the best of every square, not of the map alone.

    `points`: (P, 2) round the scanner; turn k is 2πk/`turns`, and turns `stride` apart follow each other. `levels`,
    `free`: (L, H, W) pyramids of likelihood and of where a scanner may be; from there, and from 2**(L - 1) cells before
    it, no point may lie outside. A leaf counts when it has `least` and is not more than `behind_best` below the best;
    of each square of 2**`keep_level` cells and each turn the best leaf goes to `found`: rows of turn, column, row, sum.
    `offsets`: (P,), room. `state`: how many there are, the best sum so far, and sums computed, or as much work. Returns
    how many turns are done, `first` of them before, once about `budget` sums have been computed.
    """
    depth = levels.shape[0] - 1
    sums = levels.reshape(depth + 1, levels.shape[1] * levels.shape[2])
    height = levels.shape[1]
    width = levels.shape[2]
    side = 1 << depth
    stack = np.zeros((4 * depth + 8, 4), np.int64)  # level, column, row, sum
    began = state[2]
    at_turn = first
    while at_turn < turns and state[2] - began < budget:
        turn = at_turn * stride % turns
        c = math.cos(2.0 * math.pi * turn / turns) / cell_m
        s = math.sin(2.0 * math.pi * turn / turns) / cell_m
        for p in range(points.shape[0]):
            offsets[p] = width * math.floor(s * points[p, 0] + c * points[p, 1] + 0.5)
            offsets[p] += math.floor(c * points[p, 0] - s * points[p, 1] + 0.5)
        for root in range(((height + side - 1) // side) * ((width + side - 1) // side)):
            across = (width + side - 1) // side
            row = side * (root // across)
            column = side * (root % across)
            if free[depth, row, column] == 0:
                continue
            state[2] += 1
            stack[0, 0] = depth
            stack[0, 1] = column
            stack[0, 2] = row
            stack[0, 3] = _score(sums, depth, row * width + column, offsets)
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
                    value = _score(sums, h - 1, y * width + x, offsets)
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
        at_turn += 1
    return at_turn


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
        state[2] += found.shape[0] // _ROWS_PER_SUM
        if found[at, 3] >= total:
            return
    else:
        state[0] += 1
    found[at, 0] = turn
    found[at, 1] = column
    found[at, 2] = row
    found[at, 3] = total


@njit(nogil=True, cache=True)
def pick_distinct(poses: NDArray[np.float64], apart_m: float, apart_rad: float, kept: NDArray[np.int64]) -> int:
    """Of `poses` (N, 3), best first: the numbers of those not next to a better one go to `kept` (M,), up to M."""
    count = 0
    for i in range(poses.shape[0]):
        if count == kept.shape[0]:
            break
        alone = True
        for k in range(count):
            dx = poses[i, 0] - poses[kept[k], 0]
            dy = poses[i, 1] - poses[kept[k], 1]
            if dx * dx + dy * dy <= apart_m * apart_m:
                turn = poses[i, 2] - poses[kept[k], 2]
                turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
                if abs(turn) <= apart_rad:
                    alone = False
                    break
        if alone:
            kept[count] = i
            count += 1
    return count
