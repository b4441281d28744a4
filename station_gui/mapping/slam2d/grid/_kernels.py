"""Kernels of the occupancy grid: plain arrays and scalars."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@njit(nogil=True, cache=True)
def widen_box(
    points: NDArray[np.float32], scanner: FloatArray, pose: FloatArray, low: FloatArray, high: FloatArray
) -> None:
    """The corners `low` and `high`, (2,), move so that the scanner and all hits of a scan at `pose` lie between them.

    `points`: (N, 2) and `scanner`: (2,), robot frame.
    """
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    for i in range(-1, points.shape[0]):
        px = scanner[0] if i < 0 else float(points[i, 0])
        py = scanner[1] if i < 0 else float(points[i, 1])
        x = pose[0] + c * px - s * py
        y = pose[1] + s * px + c * py
        low[0] = min(low[0], x)
        low[1] = min(low[1], y)
        high[0] = max(high[0], x)
        high[1] = max(high[1], y)


@njit(nogil=True, cache=True)
def trace_scan(
    points: NDArray[np.float32],
    scanner: FloatArray,
    pose: FloatArray,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    max_range_m: float,
    change: int,
    hits: NDArray[np.int32],
    passes: NDArray[np.int32],
) -> None:
    """Add `change` to the cell each beam ended in and to those it passed before (Amanatides and Woo 1987).

    `points`: (N, 2) and `scanner`: (2,), robot frame; all of it must lie inside the grid.
    """
    height, width = hits.shape
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    start_x = (pose[0] + c * scanner[0] - s * scanner[1] - origin_x) / cell_m
    start_y = (pose[1] + s * scanner[0] + c * scanner[1] - origin_y) / cell_m
    for i in range(points.shape[0]):
        px = float(points[i, 0])
        py = float(points[i, 1])
        if math.hypot(px - scanner[0], py - scanner[1]) > max_range_m:
            continue
        end_x = (pose[0] + c * px - s * py - origin_x) / cell_m
        end_y = (pose[1] + s * px + c * py - origin_y) / cell_m
        column = math.floor(start_x)
        row = math.floor(start_y)
        last_column = math.floor(end_x)
        last_row = math.floor(end_y)
        if min(column, row, last_column, last_row) < 0:
            continue
        if max(column, last_column) >= width or max(row, last_row) >= height:
            continue
        dx = end_x - start_x
        dy = end_y - start_y
        step_column = 1 if dx > 0 else -1
        step_row = 1 if dy > 0 else -1
        next_x = (column + (dx > 0) - start_x) / dx if dx != 0 else math.inf
        next_y = (row + (dy > 0) - start_y) / dy if dy != 0 else math.inf
        per_column = abs(1.0 / dx) if dx != 0 else math.inf
        per_row = abs(1.0 / dy) if dy != 0 else math.inf
        remaining = abs(last_column - column) + abs(last_row - row)
        while remaining > 0:
            passes[row, column] += change
            if next_x < next_y:
                column += step_column
                next_x += per_column
            else:
                row += step_row
                next_y += per_row
            if column < 0 or row < 0 or column >= width or row >= height:
                break
            remaining -= 1
        hits[last_row, last_column] += change


@njit(nogil=True, cache=True)
def fill_probability(
    hits: NDArray[np.int32],
    passes: NDArray[np.int32],
    first_row: int,
    last_row: int,
    first_column: int,
    last_column: int,
    hit_log_odds: float,
    miss_log_odds: float,
    limit_log_odds: float,
    thin_share: float,
    thin_reach: int,
    probability: NDArray[np.float32],
) -> None:
    """Probability of the cells in a rectangle, both ends included.

    A cell behind a surface is hit now and then and never passed, because the beam ends there: it is told from a
    surface by its far fewer hits than a cell near by, and counts as unknown.
    """
    height, width = hits.shape
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            here = hits[row, column]
            if here == 0 and passes[row, column] == 0:
                probability[row, column] = 0.5
                continue
            odds = hit_log_odds * here + miss_log_odds * passes[row, column]
            if odds > 0.0:
                most = 0
                for r in range(max(row - thin_reach, 0), min(row + thin_reach + 1, height)):
                    for q in range(max(column - thin_reach, 0), min(column + thin_reach + 1, width)):
                        most = max(most, hits[r, q])
                if here < thin_share * most:
                    odds = 0.0
            odds = min(max(odds, -limit_log_odds), limit_log_odds)
            probability[row, column] = 1.0 / (1.0 + math.exp(-odds))
