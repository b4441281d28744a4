"""Kernels on creases: where surfaces bend.

Shared arguments are those of `perception._kernels`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robot_app.perception._kernels import UNCOUNTED

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]

FEWEST_CELLS, MOST_CELLS = 6, 10  # of an arm of a crease


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _fit_arm(flat: F32, at: int, step: int, cells: int) -> tuple[float, float]:
    """A line through the inverse depth of `cells` cells from `at` on: its value there and its slope a cell; the value
    is 0 where a cell is empty."""
    mean_k = 0.5 * (cells + 1)
    total, moment = 0.0, 0.0
    least = np.float32(1.0)
    for k in range(1, cells + 1):
        q = flat[at + step * k]
        least = min(least, q)
        total += q
        moment += (k - mean_k) * q
    slope = moment * 12.0 / (cells * (cells * cells - 1.0))
    return (total / cells - slope * mean_k if least > 0.0 else 0.0), slope


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _is_straight(flat: F32, at: int, step: int, cells: int, value: float, slope: float, slack: float) -> bool:
    """Whether no cell is further than `slack` from the line of `_fit_arm`."""
    worst = 0.0
    for k in range(1, cells + 1):
        worst = max(worst, abs(flat[at + step * k] - value - slope * k))
    return worst <= slack


@njit(nogil=True, cache=True, **UNCOUNTED)
def mark_bends(flat: F32, offset: int, arm_cells_m: float, least: float, marks: U8) -> None:
    """`marks`: (R * C,), 0 where `measure_creases` would find at the first glance that the surface goes straight on.

    Many cells are asked at once, for one length of the arm after the other. `offset`: 1 along the rows, the number of
    columns along the columns; `arm_cells_m`: the length of the arm in cells at 1 m; `least`: the bend of a cell.
    `flat`: the inverse depth, row after row.
    """
    marks[:] = 0
    for cells in range(FEWEST_CELLS, MOST_CELLS + 1):
        reach = cells * offset
        if 2 * reach >= flat.size:
            return
        middle, out = flat[reach : flat.size - reach], marks[reach : flat.size - reach]
        before, after = flat[: flat.size - 2 * reach], flat[2 * reach :]
        # A little more than the exact test lets through, which comes later: this one rounds otherwise.
        low = np.float32(0.0 if cells == FEWEST_CELLS else (cells - 0.01) / arm_cells_m)
        high = np.float32(1e9 if cells == MOST_CELLS else (cells + 1.01) / arm_cells_m)
        limit = np.float32(0.999 * least * cells)
        for k in range(out.size):
            q = middle[k]
            bend = abs(before[k] + after[k] - q - q) >= limit * q
            known = min(before[k], after[k], q) > np.float32(0.0)
            out[k] |= np.uint8(bend & known & (q >= low) & (q <= high))


@njit(nogil=True, cache=True, **UNCOUNTED)
def measure_creases(
    inverse: F32,
    flat: F32,
    slopes: F32,
    stride: int,
    cell_slope: float,
    vertical: int,
    arm_m: float,
    min_angle_rad: float,
    noise: float,
    mark: U8,
    marks: U8,
    angle: F32,
    shift: F32,
) -> None:
    """How sharply the surface bends at each cell along a row (or, `vertical` = 1, a column).

    `angle`: (R, C) rad, 0 where there is no crease. `shift`: (R, C) where the two sides meet, cells from the cell.
    A plane's inverse depth is linear in the image, whatever its slant: a crease is where two straight pieces meet.
    `inverse`: (R, C) 1/m, 0 where there is nothing to look at. `slopes`: of the columns or rows; `cell_slope`: the
    step of a cell in them. `noise`: of the depth at 1 m, m. `mark`: (R, C) room to work in. `flat`, `marks`: `inverse`
    and `mark`, row after row.
    """
    rows, columns = inverse.shape
    half = stride // 2
    least = 2.0 * math.tan(0.5 * min_angle_rad)
    tangent = math.tan(min_angle_rad)
    step = columns if vertical == 1 else 1
    angle[:] = 0.0
    mark_bends(flat, step, arm_m / cell_slope, 0.6 * least * cell_slope, marks)
    for i in range(rows):
        for j in range(columns):
            if mark[i, j] == 0:
                continue
            q = float(inverse[i, j])
            z0 = 1.0 / q
            cells = min(max(int(arm_m / (cell_slope * z0)), FEWEST_CELLS), MOST_CELLS)
            di, dj = (cells, 0) if vertical == 1 else (0, cells)
            if i < di or j < dj or i + di >= rows or j + dj >= columns:
                continue
            qa, qb = inverse[i - di, j - dj], inverse[i + di, j + dj]
            if qa == 0.0 or qb == 0.0 or abs(qa + qb - 2.0 * q) < 0.6 * least * cells * cell_slope * q:
                continue
            at = i * columns + j
            qa, slope_a = _fit_arm(flat, at, -step, cells)
            qb, slope_b = _fit_arm(flat, at, step, cells)
            if qa == 0.0 or qb == 0.0 or slope_a + slope_b == 0.0:
                continue
            where = (qb - qa) / (-slope_a - slope_b)
            if abs(where) > 1.5:
                continue
            # The angle by its tangent, which asks most cells no more than this.
            s0 = slopes[half + (i if vertical == 1 else j) * stride]
            run_a, run_b = cell_slope * q + s0 * slope_a, cell_slope * q - s0 * slope_b
            along = run_a * run_b - slope_a * slope_b
            if along > 0.0 and abs(cell_slope * q * (slope_a + slope_b)) < 0.999 * tangent * along:
                continue
            sigma_m = noise * z0 * z0
            slack_q = (3.5 * sigma_m + 0.15 * cell_slope * z0) * q * q
            if not _is_straight(flat, at, -step, cells, qa, slope_a, slack_q):
                continue
            if not _is_straight(flat, at, step, cells, qb, slope_b, slack_q):
                continue
            ahead, behind = math.atan2(-slope_b, run_b), math.atan2(slope_a, run_a)
            bend = abs(ahead - behind)
            sigma_rad = 1.5 * sigma_m * math.sqrt(12.0 / cells**3) / (cell_slope * z0)
            if bend > max(min_angle_rad, 4.0 * sigma_rad):
                angle[i, j] = bend
                shift[i, j] = where


@njit(nogil=True, cache=True, **UNCOUNTED)
def find_creases(
    z: F32,
    slope_x: F32,
    slope_y: F32,
    stride: int,
    vertical: int,
    angle: F32,
    shift: F32,
    edge_m: F32,
    edge_at: I32,
    count: int,
) -> int:
    """Edge points where the bend is the sharpest of its neighbourhood, while there is room; returns the new count."""
    rows, columns = z.shape
    half = stride // 2
    for i in range(rows):
        for j in range(columns):
            bend = angle[i, j]
            if bend == 0.0:
                continue
            sharpest = True
            for k in range(-3, 4):
                ci, cj = (i + k, j) if vertical == 1 else (i, j + k)
                if 0 <= ci < rows and 0 <= cj < columns and (angle[ci, cj] > bend or (k < 0 and angle[ci, cj] == bend)):
                    sharpest = False
                    break
            if not sharpest or edge_at[i, j] >= 0 or count == edge_m.shape[0]:
                continue
            x, y = float(slope_x[half + j * stride]), float(slope_y[half + i * stride])
            if vertical == 1:
                y += shift[i, j] * (slope_y[1] - slope_y[0]) * stride
            else:
                x += shift[i, j] * (slope_x[1] - slope_x[0]) * stride
            edge_at[i, j] = count
            edge_m[count, 0], edge_m[count, 1], edge_m[count, 2] = x * z[i, j], y * z[i, j], z[i, j]
            count += 1
    return count
