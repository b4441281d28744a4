"""Kernels on bends: where surfaces meet, and where one stands a little before the other.

Shared arguments are those of `perception._kernels`.
inverse: (R, C) float32, 1/m, 0 where there is nothing to look at. A plane's inverse depth is linear in the image,
whatever its slant, so an edge is where two straight pieces meet (a crease) or miss one another (a step).
bend: (R, C) float32, rad, the angle of a crease, plus WIDE_RAD where both faces are wide; negative for a step, how deep
it is, m; 0 for neither.
shift: (R, C) float32, where the edge is, cells from the middle of the cell. edge_q: (R, C) float32, 1/m, its depth.
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

FEWEST_CELLS, FULL_CELLS, MOST_CELLS = 4, 6, 10  # of an arm: the least, what is enough for any angle, the most
MOST_OFF_CELLS = 0.6  # standard deviation of where a crease is found
WIDE_RAD = 4.0  # more than any angle: a crease of two wide faces is told better than those beside it
UNKNOWN = 1e6  # further than any cell is from a line, 1/m
GLANCE_CELLS = 4  # between the pairs of cells that the first glance compares


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _fit_arm(flat: F32, at: int, step: int, cells: int) -> tuple[float, float]:
    """A line through the inverse depth of `cells` cells from `at` on: its value there and its slope a cell."""
    mean_k = 0.5 * (cells + 1)
    total, moment = 0.0, 0.0
    for k in range(1, cells + 1):
        q = flat[at + step * k]
        total += q
        moment += (k - mean_k) * q
    slope = moment * 12.0 / (cells * (cells * cells - 1.0))
    return total / cells - slope * mean_k, slope


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _most_off(flat: F32, at: int, step: int, cells: int, value: float, slope: float) -> float:
    """How far the cell that is furthest from the line of `_fit_arm` is from it."""
    worst = 0.0
    for k in range(1, cells + 1):
        worst = max(worst, abs(flat[at + step * k] - value - slope * k))
    return worst


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _straight_arm(flat: F32, at: int, step: int, room: int, slack: float) -> tuple[int, float, float]:
    """The longest arm of up to `room` cells that is straight, of three that are tried: its cells and the line through
    it. No cell of it is empty or further than `slack` from the line; the first FEWEST_CELLS are known to be so."""
    cells = FEWEST_CELLS
    while cells < room and flat[at + step * (cells + 1)] > 0.0:
        cells += 1
    if cells == MOST_CELLS:  # most are: with the number written out the loops are unrolled
        value, slope = _fit_arm(flat, at, step, MOST_CELLS)
        if _most_off(flat, at, step, MOST_CELLS, value, slope) <= slack:
            return MOST_CELLS, value, slope
        cells = FULL_CELLS
    while cells > FEWEST_CELLS:
        value, slope = _fit_arm(flat, at, step, cells)
        if _most_off(flat, at, step, cells, value, slope) <= slack:
            return cells, value, slope
        cells = FULL_CELLS if cells > FULL_CELLS else FEWEST_CELLS
    value, slope = _fit_arm(flat, at, step, FEWEST_CELLS)
    return FEWEST_CELLS, value, slope


@njit(nogil=True, cache=True, **UNCOUNTED)
def mark_bends(flat: F32, step: int, crease: float, depth_m: float, noise: float, pair: F32, marks: U8) -> None:
    """`marks`: (R * C,), 0 where neither a cell nor the next one is worth a closer look, by pairs of cells.

    Many cells are asked at once. `step`: 1 along the rows, the number of columns along the columns. `crease`: how far
    the surface bends there, in parts of the inverse depth, or `depth_m`: how deep a step is; what lies within `noise`,
    1/m, is neither. `flat`: the inverse depth, row after row; `pair`: (R * C,) room to work in.
    """
    marks[:] = 0
    reach = GLANCE_CELLS * step
    if flat.size <= 2 * reach + step:
        return
    first, second, both = flat[:-step], flat[step:], pair[: flat.size - step]
    for k in range(both.size):
        both[k] = (first[k] + second[k]) * np.float32((first[k] > np.float32(0.0)) & (second[k] > np.float32(0.0)))
    before, middle, after = both[: both.size - 2 * reach], both[reach : both.size - reach], both[2 * reach :]
    out = marks[reach : reach + middle.size]
    of_crease, of_step, least = np.float32(crease), np.float32(0.5 * depth_m), np.float32(2.0 * noise)
    for k in range(middle.size):
        q = middle[k]
        bends = abs(before[k] + after[k] - q - q) >= max(min(of_crease * q, of_step * q * q), least)
        out[k] = np.uint8(bends & (min(before[k], after[k], q) > np.float32(0.0)))


@njit(nogil=True, cache=True, **UNCOUNTED)
def keep_between_straight(
    flat: F32, step: int, slack: float, slack_per_q: float, rest: F32, marks: U8, worth: U8
) -> None:
    """`worth`: (R * C,), 1 for the cells of the pairs that `mark_bends` marks if on either side of the cell
    FEWEST_CELLS cells are known and lie on a line, within `slack` and `slack_per_q` times the cell's own value.

    Many cells are asked at once. `rest`: (R * C,) room to work in: how far the cells from here on are from a line.
    """
    worth[:] = 0
    size, margin = flat.size, FEWEST_CELLS * step
    if size <= 2 * margin:
        return
    q1, q2, q3 = flat[: size - 3 * step], flat[step : size - 2 * step], flat[2 * step : size - step]
    q4 = flat[3 * step :]
    for k in range(q1.size):
        slope = np.float32(0.3) * (q4[k] - q1[k]) + np.float32(0.1) * (q3[k] - q2[k])
        middle = np.float32(0.25) * (q1[k] + q2[k] + q3[k] + q4[k])
        far, near = np.float32(1.5) * slope, np.float32(0.5) * slope
        outer = max(abs(q1[k] - middle + far), abs(q4[k] - middle - far))
        inner = max(abs(q2[k] - middle + near), abs(q3[k] - middle - near))
        empty = np.float32(min(q1[k], q2[k], q3[k], q4[k]) <= np.float32(0.0))
        rest[k] = max(outer, inner) + np.float32(UNKNOWN) * empty
    end = size - margin
    before, after = rest[: end - margin], rest[margin + step : end + step]
    marked, marked_before = marks[margin:end], marks[margin - step : end - step]
    here, out = flat[margin:end], worth[margin:end]
    offset, per_q = np.float32(slack), np.float32(slack_per_q)
    for k in range(out.size):
        straight = max(before[k], after[k]) <= offset + per_q * here[k]
        out[k] = (marked[k] | marked_before[k]) & np.uint8(straight & (here[k] > np.float32(0.0)))


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _spread(cells: int) -> float:
    """The variance of a line through so many cells, one cell before the first, in parts of that of a cell."""
    return 1.0 / cells + 3.0 * (cells + 1) / (cells * (cells - 1.0))


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _crease_angle(q: float, s0: float, cell_slope: float, slope_a: float, slope_b: float) -> float:
    """The angle between two pieces of surface that meet in a cell at slope `s0` with inverse depth `q`, rad."""
    run_a, run_b = cell_slope * q + s0 * slope_a, cell_slope * q - s0 * slope_b
    return abs(math.atan2(-slope_b, run_b) - math.atan2(slope_a, run_a))


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _is_flatter(q: float, s0: float, cell_slope: float, slope_a: float, slope_b: float, tangent: float) -> bool:
    """Whether `_crease_angle` is surely below the angle of this tangent, which is less than a right angle: by the
    products of the two pieces, for arcs are dear."""
    run_a, run_b = cell_slope * q + s0 * slope_a, cell_slope * q - s0 * slope_b
    inner = run_a * run_b - slope_a * slope_b
    flatter: bool = inner > 0.0 and abs(cell_slope * q * (slope_a + slope_b)) < 0.999 * tangent * inner
    return flatter


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _is_creased(
    flat: F32, at: int, step: int, cells: int, qa: float, slope_a: float, qb: float, slope_b: float
) -> bool:
    """Whether two lines fit the inverse depth of `cells` cells to either side better than a parabola does: what is
    round has no edge."""
    middle = flat[at]
    zeroth, first, second, squares, rest = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(1, cells + 1):
        low, high = flat[at - step * k] - middle, flat[at + step * k] - middle
        zeroth += low + high
        first += k * (high - low)
        second += k * k * (low + high)
        squares += low * low + high * high
        rest += (low + middle - qa - slope_a * k) ** 2 + (high + middle - qb - slope_b * k) ** 2
    count = 2.0 * cells + 1.0
    mean_square = cells * (cells + 1.0) / 3.0  # of k
    around = second - mean_square * zeroth  # times q: k² less its mean
    of_around = count * mean_square * (3.0 * cells * (cells + 1.0) - 1.0) / 5.0 - count * mean_square * mean_square
    round_rest = squares - zeroth * zeroth / count - first * first / (count * mean_square) - around * around / of_around
    return rest < 0.8 * round_rest


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _crease_of(
    flat: F32,
    at: int,
    step: int,
    s0: float,
    cell_slope: float,
    cells_a: int,
    qa: float,
    slope_a: float,
    cells_b: int,
    qb: float,
    slope_b: float,
    min_angle_rad: float,
    short_angle_rad: float,
    noise: float,
) -> float:
    """What `bend` is to be where two lines meet: the angle if it is sharp and sure enough, 0 otherwise."""
    q = float(flat[at])
    shorter = min(cells_a, cells_b)
    angle: float = _crease_angle(q, s0, cell_slope, slope_a, slope_b)
    sigma_rad = 1.5 * noise * math.sqrt(6.0 * (1.0 / cells_a**3 + 1.0 / cells_b**3)) / (cell_slope * q)
    off_cells = noise * math.sqrt(_spread(cells_a) + _spread(cells_b)) / abs(slope_a + slope_b)
    if angle <= max(min_angle_rad if shorter >= FULL_CELLS else short_angle_rad, 4.0 * sigma_rad):
        return 0.0
    if off_cells > MOST_OFF_CELLS or not _is_creased(flat, at, step, shorter, qa, slope_a, qb, slope_b):
        return 0.0
    return angle if shorter < FULL_CELLS else angle + WIDE_RAD


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _step_of(
    flat: F32,
    at: int,
    step: int,
    cells_a: int,
    qa: float,
    slope_a: float,
    cells_b: int,
    qb: float,
    slope_b: float,
    min_step_m: float,
    noise: float,
) -> float:
    """How much deeper the one line is than the other where they miss one another, 1/m, if this is the last cell of the
    nearer one; 0 otherwise. The cells on either side have to follow their lines better than the step is deep."""
    q, jump, near = float(flat[at]), abs(qa - qb), max(qa, qb)
    rise, beyond = (slope_a, flat[at + step]) if qa > qb else (slope_b, flat[at - step])
    if jump < min_step_m * q * q or jump < 4.5 * noise * math.sqrt(_spread(cells_a) + _spread(cells_b)):
        return 0.0
    if abs(q - near) > 0.4 * jump or near - rise - beyond < 0.6 * jump:
        return 0.0
    off_a = _most_off(flat, at, -step, cells_a, qa, slope_a)
    off_b = _most_off(flat, at, step, cells_b, qb, slope_b)
    return jump if max(off_a, off_b) <= 0.4 * jump else 0.0


@njit(nogil=True, cache=True, **UNCOUNTED)
def measure_bends(
    inverse: F32,
    flat: F32,
    slopes: F32,
    stride: int,
    cell_slope: float,
    vertical: int,
    min_angle_rad: float,
    short_angle_rad: float,
    min_step_m: float,
    noise: float,
    pair: F32,
    marks: U8,
    worth: U8,
    bend: F32,
    shift: F32,
    edge_q: F32,
) -> None:
    """How sharply the surface bends, or how deep it steps, at each cell along a row (or, `vertical` = 1, a column).

    Fills `bend`, `shift` and `edge_q`. `flat`: `inverse`, row after row; `slopes`: of the columns or rows;
    `cell_slope`: the step of a cell in them. `min_angle_rad`: of a crease; where a face is too narrow for an arm of
    FULL_CELLS, `short_angle_rad`. `noise`: of the inverse depth, 1/m. `pair`, `marks`, `worth`: (R * C,) to work in.
    """
    rows, columns = inverse.shape
    half = stride // 2
    step = columns if vertical == 1 else 1
    glance = 0.9 * 2.0 * math.tan(0.5 * min_angle_rad) * GLANCE_CELLS * cell_slope
    mark_bends(flat, step, glance, 0.8 * min_step_m, 5.0 * noise, pair, marks)
    keep_between_straight(flat, step, 3.5 * noise, 0.15 * cell_slope, pair, marks, worth)
    tangent = math.tan(min(min_angle_rad, short_angle_rad))
    bend[:] = 0.0
    for i in range(rows):
        for j in range(columns):
            at = i * columns + j
            before, after = (i, rows - 1 - i) if vertical == 1 else (j, columns - 1 - j)
            if worth[at] == 0 or min(before, after) < FEWEST_CELLS:
                continue
            q = float(flat[at])
            slack = 3.5 * noise + 0.15 * cell_slope * q
            cells_a, qa, slope_a = _straight_arm(flat, at, -step, min(MOST_CELLS, before), slack)
            cells_b, qb, slope_b = _straight_arm(flat, at, step, min(MOST_CELLS, after), slack)
            turn = slope_a + slope_b
            where = (qa - qb) / turn if turn != 0.0 else math.inf
            if abs(where) <= 1.5:
                s0 = slopes[half + (i if vertical == 1 else j) * stride]
                if _is_flatter(q, s0, cell_slope, slope_a, slope_b, tangent):
                    continue
                bend[i, j] = _crease_of(
                    flat, at, step, s0, cell_slope, cells_a, qa, slope_a, cells_b, qb, slope_b,
                    min_angle_rad, short_angle_rad, noise,
                )  # fmt: skip
                shift[i, j] = where
                edge_q[i, j] = 0.5 * (qa + qb + (slope_b - slope_a) * where)
            else:
                jump = _step_of(flat, at, step, cells_a, qa, slope_a, cells_b, qb, slope_b, min_step_m, noise)
                bend[i, j] = -jump / (q * q)
                shift[i, j] = 0.5 if qa > qb else -0.5
                edge_q[i, j] = max(qa, qb) - 0.5 * (slope_a if qa > qb else slope_b)


@njit(nogil=True, cache=True, **UNCOUNTED)
def _is_sharpest(bend: F32, across: F32, i: int, j: int, vertical: int) -> bool:
    """Whether no crease (or no step, where this is one) within three cells along the row or column is sharper, nor one
    within two that was measured `across` it: an edge is found where it is crossed at the steepest."""
    here = bend[i, j]
    sign = 1.0 if here > 0.0 else -1.0
    size = here * sign
    for k in range(-FULL_CELLS, FULL_CELLS + 1):
        ci, cj = (i + k, j) if vertical == 1 else (i, j + k)
        if k == 0 or ci < 0 or cj < 0 or ci >= bend.shape[0] or cj >= bend.shape[1]:
            continue
        other = bend[ci, cj] * sign
        if abs(k) > 3:
            if size < WIDE_RAD and other > WIDE_RAD:
                return False
        else:
            first = other < size or (k > 0 and other == size)
            if abs(k) <= 2:
                first = first and not (other < 0.0 < here) and across[ci, cj] * sign <= size
            if not first:
                return False
    return True


@njit(nogil=True, cache=True, **UNCOUNTED)
def find_bends(
    slope_x: F32,
    slope_y: F32,
    stride: int,
    vertical: int,
    bend: F32,
    across: F32,
    shift: F32,
    edge_q: F32,
    edge_m: F32,
    edge_at: I32,
    count: int,
) -> int:
    """Edge points where the bend is the sharpest of its neighbourhood, while there is room; returns the new count.

    `across`: (R, C) the `bend` of the other direction.
    """
    rows, columns = bend.shape
    half = stride // 2
    for i in range(rows):
        for j in range(columns):
            if bend[i, j] == 0.0 or edge_at[i, j] >= 0 or not _is_sharpest(bend, across, i, j, vertical):
                continue
            if count == edge_m.shape[0]:
                return count
            x, y = float(slope_x[half + j * stride]), float(slope_y[half + i * stride])
            if vertical == 1:
                y += shift[i, j] * (slope_y[1] - slope_y[0]) * stride
            else:
                x += shift[i, j] * (slope_x[1] - slope_x[0]) * stride
            edge_at[i, j] = count
            z = 1.0 / edge_q[i, j]
            edge_m[count, 0], edge_m[count, 1], edge_m[count, 2] = x * z, y * z, z
            count += 1
    return count
