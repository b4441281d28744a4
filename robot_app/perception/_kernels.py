"""Kernels of the object extraction: plain arrays and scalars in the camera's optical frame.

Shared arguments
depth: (H, W) uint16, image. z: (R, C) float32, m, every stride-th pixel of it, 0 where none.
slope_x: (W,), slope_y: (H,) float32: x/z and y/z of a pixel. lens: (4,) float64: fx, fy, cx, cy.
up: (4,) float64: a point's height over the floor is up[:3] . point + up[3].
edge_m: (E, 3) float32, edge points. edge_at: (R, C) int32, which edge point lies in a cell, -1 for none.
node_m: (N, 3) float32. linked: (N, N) uint8, symmetric, 1 where two nodes are connected.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]

# Without numba's memory management a kernel that would allocate does not compile, and an array that is handed to a
# helper is not counted, atomically, at each call: a quarter of the time of learning. Numba has the option for its own
# use; both lock files name the release that this is tested with.
UNCOUNTED: dict[str, Any] = {"_nrt": False}

MISSING = -1.0  # no neighbour is known: the image ends there, or an unexplained hole
OPEN = 1e6  # nothing is there up to the end of the range, m
TILE_CELLS = 4  # the side of the squares in which edge points are counted; nine of them are a neighbourhood
SMOOTH_CELLS = 8  # so many cells on a line are a surface, and no speckle
FAR_CELLS = 3  # how far from a speckle's edge such a surface may begin


@njit(nogil=True, cache=True, **UNCOUNTED)
def decimate(depth: U16, unit_m: float, stride: int, near_m: float, far_m: float, z: F32) -> int:
    """Fill `z` with every stride-th pixel in range; returns how many there are."""
    count = 0
    start = stride // 2
    for i in range(z.shape[0]):
        for j in range(z.shape[1]):
            value_m = depth[start + i * stride, start + j * stride] * unit_m
            if near_m <= value_m <= far_m:
                z[i, j] = value_m
                count += 1
            else:
                z[i, j] = 0.0
    return count


@njit(nogil=True, cache=True, **UNCOUNTED)
def find_open(depth: U16, z: F32, stride: int, near_depth: float, min_cells: int, open_rows: I32) -> None:
    """`open_rows`: (C,) how many cells from the top of a column look into open space.

    A column without any return says nothing: something too near for the camera may fill it. Nor is space open where a
    value below `near_depth`, in the unit of `depth`, says that something is.
    """
    half = stride // 2
    for j in range(z.shape[1]):
        run = 0
        while run < z.shape[0] and z[run, j] == 0.0:
            if 0 < depth[half + run * stride, half + j * stride] < near_depth:
                break
            run += 1
        open_rows[j] = run if min_cells <= run < z.shape[0] else 0


@njit(nogil=True, cache=True, **UNCOUNTED)
def edge_measure(inner_m: float, outer_m: float, alpha: float) -> float:
    """P_edge of one axis (eqs 8 and 9): positive where one neighbour is 1 + alpha times as far as the other."""
    difference = abs(inner_m - outer_m)
    measure: float = max(difference - inner_m * alpha, difference - outer_m * alpha)
    return measure


@njit(nogil=True, cache=True, **UNCOUNTED)
def _between(z: F32, sx: F32, sy: F32, stride: int, i: int, j: int, k: int, m: int) -> float:
    """Distance of the points of cells (i, j) and (k, m), m (eqs 10 and 11)."""
    half = stride // 2
    za, zb = z[i, j], z[k, m]
    dx = sx[half + j * stride] * za - sx[half + m * stride] * zb
    dy = sy[half + i * stride] * za - sy[half + k * stride] * zb
    return math.sqrt(dx * dx + dy * dy + (za - zb) ** 2)


@njit(nogil=True, cache=True, **UNCOUNTED)
def _outer_distance(
    z: F32, sx: F32, sy: F32, stride: int, open_rows: I32, max_hole: int, i: int, j: int, di: int, dj: int, inner: float
) -> tuple[float, float]:
    """Distance to the neighbour in a direction, and how much deeper that neighbour is.

    Looks past one cell, which may be a flying pixel, and across holes; each cell that is passed takes one inner
    step off, so that a surface that goes on behind measures the same as without the gap.
    """
    rows, columns = z.shape
    best, deeper = MISSING, 0.0
    for step in range(1, max_hole + 2):
        k, m = i + di * step, j + dj * step
        if k < 0 or m < 0 or k >= rows or m >= columns:
            return best, deeper
        if z[k, m] > 0.0:
            distance = _between(z, sx, sy, stride, i, j, k, m) - (step - 1) * inner
            if distance > best:
                best, deeper = distance, z[k, m] - z[i, j]
            if step >= 2:
                return best, deeper
        elif k < open_rows[m]:
            return OPEN, OPEN
    return best, deeper


@njit(nogil=True, cache=True, **UNCOUNTED)
def _surface_slope(z: F32, i: int, j: int, di: int, dj: int, slack_m: float) -> float:
    """Change of inverse depth with a cell towards (di, dj), over up to four cells of the surface behind (i, j)."""
    q = 1.0 / z[i, j]
    slope: float = q - 1.0 / z[i - di, j - dj]
    for back in range(2, 5):
        k, m = i - di * back, j - dj * back
        if k < 0 or m < 0 or k >= z.shape[0] or m >= z.shape[1] or z[k, m] == 0.0:
            break
        if abs(z[k, m] * (q - slope * back) - 1.0) * z[k, m] > slack_m:
            break
        slope = (q - 1.0 / z[k, m]) / back
    return slope


@njit(nogil=True, cache=True, **UNCOUNTED)
def _last_of_surface(
    depth: U16, unit_m: float, i: int, j: int, di: int, dj: int, steps: int, q: float, slope: float, tolerance: float
) -> int:
    """How many pixels the surface goes on from pixel (i, j); a plane's inverse depth is linear in the image.

    One pixel that is off is noise, two are the end.
    """
    last = 0
    for step in range(1, steps + 1):
        k, m = i + di * step, j + dj * step
        if k < 0 or m < 0 or k >= depth.shape[0] or m >= depth.shape[1]:
            break
        value_m = depth[k, m] * unit_m
        if value_m > 0.0 and abs(value_m * (q + slope * step) - 1.0) * value_m <= tolerance:
            last = step
        elif step > last + 1:
            break
    return last


@njit(nogil=True, cache=True, **UNCOUNTED)
def _put(edge_m: F32, edge_at: I32, count: int, i: int, j: int, x: float, y: float, z: float) -> int:
    """Keep an edge point in cell (i, j), the nearest one of several, while there is room; returns the new count."""
    index = edge_at[i, j]
    if index < 0:
        if count == edge_m.shape[0]:
            return count
        index = count
        edge_at[i, j] = index
        count += 1
    elif edge_m[index, 2] <= z:
        return count
    edge_m[index, 0], edge_m[index, 1], edge_m[index, 2] = x, y, z
    return count


@njit(nogil=True, cache=True, **UNCOUNTED)
def mark_steps(flat: F32, columns: int, cell_width: float, alpha: float, step: U8) -> None:
    """`step`: (R * C,), 0 where the two neighbours in each of the four directions are known and not much further away.

    Most of an image is so, and many cells are asked at once; the two rows and columns along the border are not asked.
    `flat`: z, row after row.
    """
    size = flat.size
    out = step[2 * columns : size - 2 * columns]
    middle = flat[2 * columns : size - 2 * columns]
    left, left2 = flat[2 * columns - 1 : size - 2 * columns - 1], flat[2 * columns - 2 : size - 2 * columns - 2]
    right, right2 = flat[2 * columns + 1 : size - 2 * columns + 1], flat[2 * columns + 2 : size - 2 * columns + 2]
    above, above2 = flat[columns : size - 3 * columns], flat[: size - 4 * columns]
    below, below2 = flat[3 * columns : size - columns], flat[4 * columns :]
    ratio = np.float32((1.0 + 0.8 * alpha * cell_width) * 0.999999)
    for k in range(out.size):
        limit = middle[k] * ratio
        far = max(left[k], left2[k], right[k], right2[k], above[k], above2[k], below[k], below2[k])
        near = min(left[k], left2[k], right[k], right2[k], above[k], above2[k], below[k], below2[k])
        out[k] = np.uint8(far >= limit) | np.uint8(near <= np.float32(0.0))


@njit(nogil=True, cache=True, **UNCOUNTED)
def find_occluding(
    depth: U16,
    unit_m: float,
    z: F32,
    slope_x: F32,
    slope_y: F32,
    stride: int,
    cell_width: float,
    open_rows: I32,
    floor: U8,
    near_m: float,
    alpha: float,
    max_step_widths: float,
    max_hole: int,
    step: U8,
    edge_m: F32,
    edge_at: I32,
    count: int,
) -> int:
    """Edges of near surfaces against what lies behind them (step 1); appends to `edge_m`, returns the new count.

    `cell_width`: the width of a cell at 1 m. `near_m`: nearer surfaces end at the sensor's limit, not in open space.
    `step`: (R, C) as `mark_steps` fills it.
    """
    rows, columns = z.shape
    half = stride // 2
    for i in range(rows):
        inside = 2 <= i < rows - 2
        for j in range(columns):
            if inside and step[i, j] == 0 and 2 <= j < columns - 2:
                continue
            z0 = z[i, j]
            if z0 == 0.0 or floor[i, j] == 1:
                continue
            width = cell_width * z0
            for axis in range(4):
                di = (axis == 2) * 1 - (axis == 3) * 1
                dj = (axis == 0) * 1 - (axis == 1) * 1
                k1, m1, k2, m2 = i + di, j + dj, i + 2 * di, j + 2 * dj
                if k2 < 0 or m2 < 0 or k2 >= rows or m2 >= columns:
                    k2, m2 = k1, m1
                    if k1 < 0 or m1 < 0 or k1 >= rows or m1 >= columns:
                        continue
                limit = z0 + 0.8 * alpha * width
                if z[k1, m1] > 0.0 and z[k1, m1] < limit and z[k2, m2] > 0.0 and z[k2, m2] < limit:
                    continue
                kb, mb = i - di, j - dj
                if kb < 0 or mb < 0 or kb >= rows or mb >= columns or z[kb, mb] == 0.0:
                    continue
                inner = _between(z, slope_x, slope_y, stride, i, j, kb, mb)
                if inner > max_step_widths * width:
                    continue
                outer, deeper = _outer_distance(z, slope_x, slope_y, stride, open_rows, max_hole, i, j, di, dj, inner)
                if outer == MISSING or deeper < 0.8 * alpha * width or edge_measure(inner, outer, alpha) <= 0.0:
                    continue
                if outer == OPEN and z0 < near_m:
                    continue
                q = 1.0 / z0
                slope = _surface_slope(z, i, j, di, dj, inner) / stride
                row, column = half + i * stride, half + j * stride
                steps = _last_of_surface(
                    depth, unit_m, row, column, di, dj, 3 * stride, q, slope, max(0.5 * inner, 1.5 * width)
                )
                row, column = row + di * steps, column + dj * steps
                ze = depth[row, column] * unit_m
                ci, cj = min(row // stride, rows - 1), min(column // stride, columns - 1)
                count = _put(edge_m, edge_at, count, ci, cj, slope_x[column] * ze, slope_y[row] * ze, ze)
    return count


@njit(nogil=True, cache=True, **UNCOUNTED)
def mark_floor(
    z: F32,
    slope_x: F32,
    slope_y: F32,
    stride: int,
    cell_width: float,
    up: F64,
    height_m: float,
    per_m: float,
    noise: float,
    floor: U8,
    inverse: F32,
) -> None:
    """`floor`: (R, C) uint8, 1 where a point is lower than `height_m` plus `per_m` for each metre of depth.

    In the upper three quarters of that height a point is none of the floor when the one above it is as near: the
    floor falls back from row to row, the foot of an object does not. That is asked where the floor falls back by
    more than the noise, `noise` of the depth at 1 m. `inverse`: (R, C) 1/m, of what is no floor, 0 elsewhere.
    """
    half = stride // 2
    for i in range(z.shape[0]):
        across = up[1] * slope_y[half + i * stride] + up[2]
        for j in range(z.shape[1]):
            floor[i, j] = 0
            inverse[i, j] = 0.0
            z0 = z[i, j]
            if z0 == 0.0:
                continue
            inverse[i, j] = 1.0 / z0
            fall = up[0] * slope_x[half + j * stride] + across
            height = fall * z0 + up[3]
            limit = height_m + per_m * z0
            if height >= limit:
                continue
            floor[i, j] = 1
            inverse[i, j] = 0.0
            if i == 0 or z[i - 1, j] == 0.0 or height < 0.25 * limit:
                continue
            fall_above = fall - up[1] * (slope_y[half + i * stride] - slope_y[half + (i - 1) * stride])
            back = OPEN if fall_above >= 0.0 or fall >= 0.0 else up[3] / -fall_above - up[3] / -fall
            if back > 8.0 * noise * z0 * z0 and z[i - 1, j] - z0 < min(0.4 * back, cell_width * z0):
                floor[i, j] = 0
                inverse[i, j] = 1.0 / z0


@njit(nogil=True, cache=True, **UNCOUNTED)
def find_contact(
    z: F32,
    slope_x: F32,
    slope_y: F32,
    stride: int,
    cell_width: float,
    lens: F64,
    up: F64,
    height_m: float,
    per_m: float,
    floor: U8,
    max_hole: int,
    edge_m: F32,
    edge_at: I32,
    count: int,
) -> int:
    """Lines where objects stand on the floor: the lowest point that is no floor, taken down to it.

    What rises gently is the floor itself, seen while the car pitches.
    P_edge finds these lines too, as a low camera sees the floor at a grazing angle, but on either side by chance.
    """
    half = stride // 2
    rows = z.shape[0]
    for i in range(rows - 1):
        for j in range(z.shape[1]):
            z0 = z[i, j]
            if z0 == 0.0 or floor[i, j] == 1:
                continue
            below = 1
            while i + below < rows - 1 and below <= max_hole and z[i + below, j] == 0.0:
                below += 1
            zb = z[i + below, j]
            if zb == 0.0 or floor[i + below, j] == 0 or zb > z0 + 2.0 * cell_width * z0:
                continue
            x, y = slope_x[half + j * stride] * z0, slope_y[half + i * stride] * z0
            height = up[0] * x + up[1] * y + up[2] * z0 + up[3]
            if height > height_m + per_m * z0 + (below + 1.0) * cell_width * z0:
                continue
            if i < 2 or z[i - 2, j] == 0.0:
                continue
            za = z[i - 2, j]
            xa, ya = slope_x[half + j * stride] * za, slope_y[half + (i - 2) * stride] * za
            rise = up[0] * (xa - x) + up[1] * (ya - y) + up[2] * (za - z0)
            if rise < 0.45 * math.sqrt((xa - x) ** 2 + (ya - y) ** 2 + (za - z0) ** 2):
                continue
            x, y, z0 = x - height * up[0], y - height * up[1], z0 - height * up[2]
            ci = int((y / z0 * lens[1] + lens[3]) / stride)
            cj = int((x / z0 * lens[0] + lens[2]) / stride)
            if 0 <= ci < rows and 0 <= cj < z.shape[1]:
                count = _put(edge_m, edge_at, count, ci, cj, x, y, z0)
    return count


@njit(nogil=True, cache=True, **UNCOUNTED)
def count_crowd(edge_at: I32, crowd: I32) -> None:
    """`crowd`: (R // TILE_CELLS + 3, C // TILE_CELLS + 3), how many edge points lie in each square of cells; the first
    row and column and the last ones are margin."""
    crowd[:] = 0
    for i in range(edge_at.shape[0]):
        for j in range(edge_at.shape[1]):
            crowd[i // TILE_CELLS + 1, j // TILE_CELLS + 1] += edge_at[i, j] >= 0


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def crowd_share(crowd: I32, i: int, j: int) -> float:
    """How much of the neighbourhood of cell (i, j) edge points cover, 0 to 1."""
    row, column, total = i // TILE_CELLS, j // TILE_CELLS, 0
    for k in range(3):
        for m in range(3):
            total += crowd[row + k, column + m]
    return total / (9.0 * TILE_CELLS * TILE_CELLS)


@njit(nogil=True, cache=True, **UNCOUNTED)
def is_smooth(inverse: F32, i: int, j: int, di: int, dj: int, noise: float) -> bool:
    """Whether SMOOTH_CELLS cells from (i, j) on lie on a line in inverse depth; a plane's is linear in the image."""
    last = SMOOTH_CELLS - 1
    k, m = i + di * last, j + dj * last
    if min(i, j, k, m) < 0 or max(i, k) >= inverse.shape[0] or max(j, m) >= inverse.shape[1]:
        return False
    first = inverse[i, j]
    slope = (inverse[k, m] - first) / last
    for step in range(SMOOTH_CELLS):
        q = inverse[i + di * step, j + dj * step]
        if q == 0.0 or abs(q - first - slope * step) > 4.0 * noise:
            return False
    return True


@njit(nogil=True, cache=True, **UNCOUNTED)
def _is_smooth_area(inverse: F32, i: int, j: int, di: int, dj: int, noise: float) -> bool:
    """Whether a surface from (i, j) on is smooth across too: no slot."""
    reach = SMOOTH_CELLS // 2
    across_i, across_j = i + reach * (di - abs(dj)), j + reach * (dj - abs(di))
    smooth: bool = is_smooth(inverse, i, j, di, dj, noise) and is_smooth(
        inverse, across_i, across_j, abs(dj), abs(di), noise
    )
    return smooth


@njit(nogil=True, cache=True, **UNCOUNTED)
def _is_speckle(inverse: F32, i: int, j: int, di: int, dj: int, noise: float) -> bool:
    """Whether nothing smooth goes from (i, j) on away from (di, dj), nor to either side of that way."""
    smooth: bool = is_smooth(inverse, i, j, -di, -dj, noise) or is_smooth(inverse, i, j, dj, di, noise)
    return not (smooth or is_smooth(inverse, i, j, -dj, -di, noise))


@njit(nogil=True, cache=True, **UNCOUNTED)
def hand_to_smooth(
    inverse: F32,
    slope_x: F32,
    slope_y: F32,
    stride: int,
    cell_width: float,
    lens: F64,
    noise: float,
    crowd: I32,
    min_share: float,
    edge_m: F32,
    edge_at: I32,
    count: int,
) -> None:
    """Where a smooth surface ends at nearer speckle, the edge is its own and not the speckle's.

    Only where `crowd_share` is `min_share` or more. `inverse`: (R, C) as
    `mark_floor` fills it; `noise`: its, 1/m.
    """
    rows, columns = inverse.shape
    half = stride // 2
    for index in range(count):
        near_m = edge_m[index, 2]
        i = int((edge_m[index, 1] / near_m * lens[1] + lens[3]) / stride)
        j = int((edge_m[index, 0] / near_m * lens[0] + lens[2]) / stride)
        if not (0 <= i < rows and 0 <= j < columns) or edge_at[i, j] != index:
            continue
        if crowd_share(crowd, i, j) < min_share:
            continue
        limit = 1.0 / (near_m + 2.0 * cell_width * near_m)
        for axis in range(4):
            if edge_at[i, j] != index:
                break
            di, dj = (axis == 2) * 1 - (axis == 3) * 1, (axis == 0) * 1 - (axis == 1) * 1
            if not _is_speckle(inverse, i - di, j - dj, di, dj, noise):
                continue
            for step in range(1, FAR_CELLS + 1):
                k, m = i + di * step, j + dj * step
                if k < 0 or m < 0 or k >= rows or m >= columns:
                    break
                if inverse[k, m] < limit and _is_smooth_area(inverse, k, m, di, dj, noise):
                    if edge_at[k, m] < 0:
                        edge_at[i, j], edge_at[k, m] = -1, index
                        row, column = half + k * stride, half + m * stride
                        far_m = 1.0 / inverse[k, m]
                        edge_m[index, 0], edge_m[index, 1] = slope_x[column] * far_m, slope_y[row] * far_m
                        edge_m[index, 2] = far_m
                    break
