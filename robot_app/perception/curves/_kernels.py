"""Kernels on creases and curves: where surfaces bend, and which edge points belong together.

Shared arguments are those of `perception._kernels`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]


@njit(nogil=True, cache=True)
def _fit_arm(inverse: F32, i: int, j: int, di: int, dj: int, cells: int) -> tuple[float, float, float]:
    """A line through the inverse depth of `cells` cells from (i, j) on: its value there, its slope a cell, and the
    largest deviation; the value is 0 where a cell is empty."""
    mean_k = 0.5 * (cells + 1)
    total, moment = 0.0, 0.0
    for k in range(1, cells + 1):
        q = inverse[i + di * k, j + dj * k]
        if q == 0.0:
            return 0.0, 0.0, 0.0
        total += q
        moment += (k - mean_k) * q
    slope = moment * 12.0 / (cells * (cells * cells - 1.0))
    value = total / cells - slope * mean_k
    worst = 0.0
    for k in range(1, cells + 1):
        worst = max(worst, abs(inverse[i + di * k, j + dj * k] - value - slope * k))
    return value, slope, worst


@njit(nogil=True, cache=True)
def measure_creases(
    inverse: F32,
    slopes: F32,
    stride: int,
    cell_slope: float,
    vertical: int,
    arm_m: float,
    min_angle_rad: float,
    noise: float,
    angle: F32,
    shift: F32,
) -> None:
    """How sharply the surface bends at each cell along a row (or, `vertical` = 1, a column).

    `angle`: (R, C) rad, 0 where there is no crease. `shift`: (R, C) where the two sides meet, cells from the cell.
    A plane's inverse depth is linear in the image, whatever its slant: a crease is where two straight pieces meet.
    `inverse`: (R, C) 1/m, 0 where there is nothing to look at. `slopes`: of the columns or rows; `cell_slope`: the
    step of a cell in them. `noise`: of the depth at 1 m, m.
    """
    rows, columns = inverse.shape
    half = stride // 2
    least = 2.0 * math.tan(0.5 * min_angle_rad)
    for i in range(rows):
        for j in range(columns):
            angle[i, j] = 0.0
            q = float(inverse[i, j])
            if q == 0.0:
                continue
            z0 = 1.0 / q
            cells = min(max(int(arm_m / (cell_slope * z0)), 6), 10)
            di, dj = (cells, 0) if vertical == 1 else (0, cells)
            if i < di or j < dj or i + di >= rows or j + dj >= columns:
                continue
            qa, qb = inverse[i - di, j - dj], inverse[i + di, j + dj]
            if qa == 0.0 or qb == 0.0 or abs(qa + qb - 2.0 * q) < 0.6 * least * cells * cell_slope * q:
                continue
            step_i, step_j = (1, 0) if vertical == 1 else (0, 1)
            qa, slope_a, off_a = _fit_arm(inverse, i, j, -step_i, -step_j, cells)
            qb, slope_b, off_b = _fit_arm(inverse, i, j, step_i, step_j, cells)
            if qa == 0.0 or qb == 0.0:
                continue
            sigma_m = noise * z0 * z0
            slack_q = (3.5 * sigma_m + 0.15 * cell_slope * z0) * q * q
            if off_a > slack_q or off_b > slack_q or slope_a + slope_b == 0.0:
                continue
            where = (qb - qa) / (-slope_a - slope_b)
            if abs(where) > 1.5:
                continue
            s0 = slopes[half + (i if vertical == 1 else j) * stride]
            ahead = math.atan2(-slope_b, cell_slope * q - s0 * slope_b)
            behind = math.atan2(slope_a, cell_slope * q + s0 * slope_a)
            bend = abs(ahead - behind)
            sigma_rad = 1.5 * sigma_m * math.sqrt(12.0 / cells**3) / (cell_slope * z0)
            if bend > max(min_angle_rad, 4.0 * sigma_rad):
                angle[i, j] = bend
                shift[i, j] = where


@njit(nogil=True, cache=True)
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
    """Edge points where the bend is the sharpest of its neighbourhood; returns the new count."""
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
            if not sharpest or edge_at[i, j] >= 0:
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


@njit(nogil=True, cache=True)
def _root(label: I32, a: int) -> int:
    while label[a] != a:
        label[a] = label[label[a]]
        a = label[a]
    return a


@njit(nogil=True, cache=True)
def label_curves(
    edge_m: F32, edge_at: I32, count: int, cell_width: float, label: I32, box_m: F32, extent_m: F32
) -> None:
    """Joins edge points to curves: those with at most two empty cells between them and near each other in depth.

    `label`: (E,) one number for all points of a curve. `extent_m`: (E,) the diagonal of the curve's box, for each of
    its points. `box_m`: (E, 6) room to work in.
    """
    rows, columns = edge_at.shape
    for a in range(count):
        label[a] = a
        for k in range(3):
            box_m[a, k] = box_m[a, 3 + k] = edge_m[a, k]
    for i in range(rows):
        for j in range(columns):
            a = edge_at[i, j]
            if a < 0:
                continue
            for k in range(i, min(i + 4, rows)):
                for m in range(max(j - 3, 0), min(j + 4, columns)):
                    b = edge_at[k, m]
                    if b < 0 or (k == i and m <= j):
                        continue
                    dx, dy = edge_m[a, 0] - edge_m[b, 0], edge_m[a, 1] - edge_m[b, 1]
                    dz = edge_m[a, 2] - edge_m[b, 2]
                    limit = (4.0 + max(k - i, abs(m - j))) * cell_width * min(edge_m[a, 2], edge_m[b, 2])
                    if dx * dx + dy * dy + dz * dz < limit * limit:
                        ra, rb = _root(label, a), _root(label, b)
                        label[max(ra, rb)] = min(ra, rb)
    for a in range(count):
        label[a] = _root(label, a)
        for k in range(3):
            box_m[label[a], k] = min(box_m[label[a], k], edge_m[a, k])
            box_m[label[a], 3 + k] = max(box_m[label[a], 3 + k], edge_m[a, k])
    for a in range(count):
        b = label[a]
        extent_m[a] = math.sqrt(
            (box_m[b, 3] - box_m[b, 0]) ** 2 + (box_m[b, 4] - box_m[b, 1]) ** 2 + (box_m[b, 5] - box_m[b, 2]) ** 2
        )


@njit(nogil=True, cache=True)
def corner_scores(
    edge_m: F32, edge_at: I32, extent_m: F32, min_extent_m: float, cell_width: float, score: F32, smooth_m: F32
) -> None:
    """`score`: (E,) 0 in the middle of a straight edge, 1 at its end and at a right angle,
    up to 4/3 where three edges meet.

    An end is seen by how far the centre of the neighbouring edge points lies off, as a share of their mean distance;
    a corner by their spreading in more than one direction, from the invariants of their second moments.
    `smooth_m`: (E, 3) that centre for points in the middle, which has less noise; the point itself for corners.
    The score is -1 for noise: points of curves below `min_extent_m`, and those with less than two others within two
    cells.
    """
    rows, columns = edge_at.shape
    reach = 5
    for i in range(rows):
        for j in range(columns):
            index = edge_at[i, j]
            if index < 0:
                continue
            if extent_m[index] < min_extent_m:
                score[index] = -1.0
                continue
            x, y, z = edge_m[index, 0], edge_m[index, 1], edge_m[index, 2]
            limit = (1.1 * reach * cell_width * z) ** 2
            sx, sy, sz, total, n, close = 0.0, 0.0, 0.0, 0.0, 0, 0
            xx, yy, zz, xy, yz, zx = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for k in range(max(i - reach, 0), min(i + reach + 1, rows)):
                for m in range(max(j - reach, 0), min(j + reach + 1, columns)):
                    other = edge_at[k, m]
                    if other < 0 or other == index:
                        continue
                    dx, dy, dz = edge_m[other, 0] - x, edge_m[other, 1] - y, edge_m[other, 2] - z
                    square = dx * dx + dy * dy + dz * dz
                    if square < limit:
                        sx, sy, sz, total, n = sx + dx, sy + dy, sz + dz, total + math.sqrt(square), n + 1
                        xx, yy, zz = xx + dx * dx, yy + dy * dy, zz + dz * dz
                        xy, yz, zx = xy + dx * dy, yz + dy * dz, zx + dz * dx
                        close += abs(k - i) <= 2 and abs(m - j) <= 2
            if close < 2 or total == 0.0:
                score[index] = -1.0
                continue
            end = math.sqrt(sx * sx + sy * sy + sz * sz) / total
            spread = xx * yy + yy * zz + zz * xx - xy * xy - yz * yz - zx * zx
            score[index] = max(end, 4.0 * spread / (xx + yy + zz) ** 2)
            share = 1.0 / (n + 1) if score[index] < 0.35 else 0.0
            smooth_m[index, 0] = x + sx * share
            smooth_m[index, 1] = y + sy * share
            smooth_m[index, 2] = z + sz * share


@njit(nogil=True, cache=True)
def choose_samples(
    edge_at: I32,
    rank: F32,
    smooth_m: F32,
    score: F32,
    label: I32,
    extent_m: F32,
    full_extent_m: float,
    corner_gain: float,
    share_per_m: float,
    limit: int,
    sample_m: F32,
    sample_weight: F32,
    sample_curve: I32,
) -> int:
    """The sample nodes A: edge points, thinned to equal spacing along the edges except at corners; returns how many.

    `rank`: (R, C) a fixed number in [0, 1) for each cell: which points go does not depend on other points' noise.
    `share_per_m`: the share of points to keep at 1 m depth. `sample_weight`: corners weigh more than the middle of an
    edge, and large curves more than small ones. Points with a negative score are noise.
    """
    corner = 0.5
    kept = 0.0
    for i in range(edge_at.shape[0]):
        for j in range(edge_at.shape[1]):
            index = edge_at[i, j]
            if index >= 0 and score[index] >= 0.0:
                kept += 1.0 if score[index] > corner else min(1.0, share_per_m * smooth_m[index, 2])
    squeeze = min(1.0, 0.95 * limit / max(kept, 1.0))
    count = 0
    for i in range(edge_at.shape[0]):
        for j in range(edge_at.shape[1]):
            index = edge_at[i, j]
            if index < 0 or score[index] < 0.0 or count >= limit:
                continue
            share = 1.0 if score[index] > corner else min(1.0, share_per_m * smooth_m[index, 2])
            if rank[i, j] < squeeze * share:
                sample_m[count] = smooth_m[index]
                size = min(1.0, extent_m[index] / full_extent_m)
                sample_weight[count] = (1.0 + corner_gain * score[index]) * max(size * size * size, 0.02)
                sample_curve[count] = label[index]
                count += 1
    return count
