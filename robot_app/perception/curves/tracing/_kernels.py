"""Kernels that thread edge points onto curves.

Shared arguments, besides those of `perception._kernels`
point_m: (E, 3) float32, the edge points that are no doubles, row by row of the image. point_uv: (E, 2) float32, where
they are seen, in cells. point_at: (R, C) int32, which of them lies in a cell, -1 for none.
beside: (E, 2) int32, the points before and after each on its curve, -1 for none, in no order.
order: (E,) int32, the points curve by curve. start: (K + 1,) int32, where each curve begins in `order`.
closed: (K,) uint8, 1 where the last point of a curve is followed by the first.
cell_width: the width of a cell at 1 m, m.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robot_app.perception._kernels import UNCOUNTED

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]

DOUBLE_CELLS = 0.6  # two edge points so near each other are one
NEAR_CELLS = 2  # how far the next point of a curve may be
END_CELLS = 4  # and how far the next piece of an edge that has a gap
MEET_CELLS = 6  # how far ahead of its end a curve may meet another
STEEPEST = 8.0  # how far the next point may lie for each cell in the image, on an edge that runs into the depth,
LEVEL = 1.0  # and by how many cells a cell the way there and the way back may differ in depth
SHARPEST = 0.35  # cosine between the ways on from a point of a curve; sharper bends end it


@njit(nogil=True, cache=True, **UNCOUNTED)
def list_points(
    edge_m: F32, edge_at: I32, lens: F64, stride: int, cell_width: float, point_m: F32, point_uv: F32, point_at: I32
) -> int:
    """Fill `point_m`, `point_uv` and `point_at`; returns how many points there are."""
    count = 0
    rows, columns = edge_at.shape
    for i in range(rows):
        for j in range(columns):
            point_at[i, j] = -1
            index = edge_at[i, j]
            if index < 0:
                continue
            x, y, z = edge_m[index, 0], edge_m[index, 1], edge_m[index, 2]
            u = (x / z * lens[0] + lens[2]) / stride
            v = (y / z * lens[1] + lens[3]) / stride
            double = False
            for k in range(4):
                ki, kj = (i, j - 1) if k == 0 else (i - 1, j - 2 + k)
                if ki < 0 or kj < 0 or kj >= columns or point_at[ki, kj] < 0:
                    continue
                other = point_at[ki, kj]
                du, dv = point_uv[other, 0] - u, point_uv[other, 1] - v
                if du * du + dv * dv < DOUBLE_CELLS**2 and abs(point_m[other, 2] - z) < 2.0 * cell_width * z:
                    double = True
            if double:
                continue
            point_at[i, j] = count
            point_m[count, 0], point_m[count, 1], point_m[count, 2] = x, y, z
            point_uv[count, 0], point_uv[count, 1] = u, v
            count += 1
    return count


@njit(nogil=True, cache=True, **UNCOUNTED)
def _gap_cells(point_m: F32, a: int, b: int, cell_width: float) -> float:
    """Distance of two points in widths of a cell at the nearer one."""
    dx, dy, dz = point_m[a, 0] - point_m[b, 0], point_m[a, 1] - point_m[b, 1], point_m[a, 2] - point_m[b, 2]
    gap: float = math.sqrt(dx * dx + dy * dy + dz * dz) / (cell_width * min(point_m[a, 2], point_m[b, 2]))
    return gap


@njit(nogil=True, cache=True, **UNCOUNTED)
def _turn(uv: F32, a: int, v: int, b: int) -> float:
    """1 + the cosine of the angle at v between a and b in the image: 0 is straight, 1 a right angle, 2 a way back."""
    ax, ay = uv[a, 0] - uv[v, 0], uv[a, 1] - uv[v, 1]
    bx, by = uv[b, 0] - uv[v, 0], uv[b, 1] - uv[v, 1]
    norm = math.sqrt((ax * ax + ay * ay) * (bx * bx + by * by))
    turn: float = 1.0 + (ax * bx + ay * by) / norm if norm > 0.0 else 2.0
    return turn


@njit(nogil=True, cache=True, **UNCOUNTED)
def _list_near(
    point_m: F32,
    point_uv: F32,
    point_at: I32,
    a: int,
    i: int,
    j: int,
    reach: int,
    cell_width: float,
    near: I32,
    way: F32,
) -> int:
    """The points up to `reach` cells round point a of cell (i, j) that may be on its curve; returns how many.

    `way`: its direction in the image, how far it is, how much deeper (the inverse depth, for that is linear along a
    straight edge), in cells, and 1 if it is as near as it looks: else it is on an edge that runs into the depth, or on
    another edge, which this one hides.
    """
    rows, columns = point_at.shape
    u, v = point_uv[a, 0], point_uv[a, 1]
    count = 0
    for k in range(max(i - reach, 0), min(i + reach + 1, rows)):
        for m in range(max(j - reach, 0), min(j + reach + 1, columns)):
            b = point_at[k, m]
            if b < 0 or b == a:
                continue
            du, dv = point_uv[b, 0] - u, point_uv[b, 1] - v
            square = du * du + dv * dv
            if square >= (NEAR_CELLS + 0.5) ** 2 or square == 0.0:
                continue
            cells = math.sqrt(square)
            gap = _gap_cells(point_m, a, b, cell_width)
            if gap < 1.0 + STEEPEST * cells:
                near[count] = b
                way[count, 0], way[count, 1], way[count, 2] = du / cells, dv / cells, gap
                way[count, 3] = (point_m[a, 2] / point_m[b, 2] - 1.0) / (cell_width * cells)
                way[count, 4] = 1.0 if gap < 1.0 + 1.5 * cells else 0.0
                count += 1
    return count


@njit(nogil=True, cache=True, **UNCOUNTED)
def choose_neighbours(
    point_m: F32, point_uv: F32, point_at: I32, cell_width: float, near: I32, way: F32, beside: I32
) -> None:
    """For each point the two others that it most likely lies between: near it, and in opposite directions.

    `near`: (24,), `way`: (24, 5) room to work in: the points round one, and the direction and distance to each.
    """
    for i in range(point_at.shape[0]):
        for j in range(point_at.shape[1]):
            a = point_at[i, j]
            if a < 0:
                continue
            beside[a, 0] = beside[a, 1] = -1
            for reach in range(1, NEAR_CELLS + 1):
                count = _list_near(point_m, point_uv, point_at, a, i, j, reach, cell_width, near, way)
                best, alone_gap = 1e9, 1e9
                for p in range(count):
                    if beside[a, 1] < 0 and way[p, 2] < alone_gap:
                        beside[a, 0], alone_gap = near[p], way[p, 2]
                    for q in range(p):
                        cosine = way[p, 0] * way[q, 0] + way[p, 1] * way[q, 1]
                        cost = way[p, 2] + way[q, 2] + 1.5 * cosine
                        level = way[p, 4] + way[q, 4] == 2.0 or abs(way[p, 3] + way[q, 3]) < LEVEL
                        if cosine < SHARPEST and cost < best and level:
                            beside[a, 0], beside[a, 1], best = near[p], near[q], cost
                if beside[a, 1] >= 0:
                    break


@njit(nogil=True, cache=True, **UNCOUNTED)
def keep_mutual(points: int, wanted: I32, beside: I32) -> None:
    """Two points are beside each other when both want it."""
    for a in range(points):
        beside[a, 0] = beside[a, 1] = -1
        slot = 0
        for k in range(2):
            b = wanted[a, k]
            if b >= 0 and (wanted[b, 0] == a or wanted[b, 1] == a):
                beside[a, slot] = b
                slot += 1


@njit(nogil=True, cache=True, **UNCOUNTED)
def _inner(beside: I32, a: int, steps: int) -> int:
    """The point some steps along the curve from its end a."""
    before, here = -1, a
    for _ in range(steps):
        ahead = beside[here, 0] if beside[here, 0] != before else beside[here, 1]
        if ahead < 0 or ahead == a:
            break
        before, here = here, ahead
    return here


@njit(nogil=True, cache=True, **UNCOUNTED)
def list_ends(beside: I32, points: int, ends: I32, tail: I32) -> int:
    """`ends`: (E,) the points with less than two beside them, `tail`: (E,) for those the one a few steps further in.

    Returns how many ends there are.
    """
    count = 0
    for a in range(points):
        tail[a] = -1
        if beside[a, 1] < 0:
            ends[count] = a
            count += 1
            tail[a] = _inner(beside, a, 4)
    return count


@njit(nogil=True, cache=True, **UNCOUNTED)
def join_ends(
    point_m: F32,
    point_uv: F32,
    point_at: I32,
    cell_width: float,
    ends: I32,
    count: int,
    tail: I32,
    wanted: I32,
    beside: I32,
) -> None:
    """Connects ends of curves with ends near them that lie ahead, the farther the straighter; more may lie between
    these in depth than elsewhere.

    An edge that another one hides ends there too, but the other one does not: so what touches in the image only is
    not joined. `wanted`: (E, 2) room to work in.
    """
    rows, columns = point_at.shape
    for e in range(count):
        a = ends[e]
        wanted[a, 0] = -1
        i, j = int(point_uv[a, 1]), int(point_uv[a, 0])
        best = 1e9
        for k in range(max(i - END_CELLS, 0), min(i + END_CELLS + 1, rows)):
            for m in range(max(j - END_CELLS, 0), min(j + END_CELLS + 1, columns)):
                b = point_at[k, m]
                if b < 0 or b == a or tail[b] < 0 or beside[a, 0] == b or tail[b] == a:
                    continue
                du, dv = point_uv[a, 0] - point_uv[b, 0], point_uv[a, 1] - point_uv[b, 1]
                gap = _gap_cells(point_m, a, b, cell_width)
                cells = math.sqrt(du * du + dv * dv)
                if gap >= best or gap > 3.0 + cells:
                    continue
                turn = 0.0 if tail[a] == a else _turn(point_uv, tail[a], a, b)
                turn = turn if tail[b] == b else max(turn, _turn(point_uv, tail[b], b, a))
                if turn < 0.4 or (turn < 1.2 and cells < 3.2):
                    best, wanted[a, 0] = gap, b
    for e in range(count):
        a = ends[e]
        b = wanted[a, 0]
        if b > a and wanted[b, 0] == a:
            beside[a, 0 if beside[a, 0] < 0 else 1] = b
            beside[b, 0 if beside[b, 0] < 0 else 1] = a


@njit(nogil=True, cache=True, **UNCOUNTED)
def trace(points: int, beside: I32, curve: I32, order: I32, start: I32, closed: U8) -> int:
    """Fill `order`, `start` and `closed`, and `curve`: (E,) the curve of each point; returns how many curves there are.

    Open curves come first.
    """
    for a in range(points):
        curve[a] = -1
    curves, filled = 0, 0
    for loops in range(2):
        for a in range(points):
            if curve[a] >= 0 or (loops == 0 and beside[a, 1] >= 0):
                continue
            start[curves], closed[curves] = filled, loops
            before, here = -1, a
            while here >= 0 and curve[here] < 0:
                curve[here] = curves
                order[filled] = here
                filled += 1
                ahead = beside[here, 0] if beside[here, 0] != before else beside[here, 1]
                before, here = here, ahead
            curves += 1
    start[curves] = filled
    return curves


@njit(nogil=True, cache=True, **UNCOUNTED)
def _root(parent: I32, a: int) -> int:
    while parent[a] != a:
        parent[a] = parent[parent[a]]
        a = parent[a]
    return a


@njit(nogil=True, cache=True, **UNCOUNTED)
def _cell_of(edge_m: F32, edge_at: I32, index: int, lens: F64, stride: int, axis: int) -> int:
    """The row (axis 1) or column (axis 0) of the cell that an edge point is seen in."""
    cell = int((edge_m[index, axis] / edge_m[index, 2] * lens[axis] + lens[2 + axis]) / stride)
    last: int = edge_at.shape[1 - axis] - 1
    return min(max(cell, 0), last)


@njit(nogil=True, cache=True, **UNCOUNTED)
def drop_short(
    edge_m: F32,
    edge_at: I32,
    first: int,
    end: int,
    lens: F64,
    stride: int,
    cell_width: float,
    min_extent_m: float,
    parent: I32,
    box_m: F32,
) -> None:
    """Takes pieces of less than `min_extent_m` that the edge points `first` to `end` make out of `edge_at`.

    `parent`: (E,), `box_m`: (E, 6) room to work in.
    """
    rows, columns = edge_at.shape
    for a in range(first, end):
        parent[a] = a
        for axis in range(3):
            box_m[a, axis] = box_m[a, 3 + axis] = edge_m[a, axis]
    for a in range(first, end):
        i, j = _cell_of(edge_m, edge_at, a, lens, stride, 1), _cell_of(edge_m, edge_at, a, lens, stride, 0)
        for k in range(max(i - 2, 0), min(i + 3, rows)):
            for m in range(max(j - 2, 0), min(j + 3, columns)):
                b = edge_at[k, m]
                if b > a and b < end and _gap_cells(edge_m, a, b, cell_width) < 4.0:
                    ra, rb = _root(parent, a), _root(parent, b)
                    parent[max(ra, rb)] = min(ra, rb)
    for a in range(first, end):
        r = _root(parent, a)
        for axis in range(3):
            box_m[r, axis] = min(box_m[r, axis], edge_m[a, axis])
            box_m[r, 3 + axis] = max(box_m[r, 3 + axis], edge_m[a, axis])
    for a in range(first, end):
        r, square = _root(parent, a), 0.0
        for axis in range(3):
            square += (box_m[r, 3 + axis] - box_m[r, axis]) ** 2
        if square >= min_extent_m * min_extent_m:
            continue
        i, j = _cell_of(edge_m, edge_at, a, lens, stride, 1), _cell_of(edge_m, edge_at, a, lens, stride, 0)
        for k in range(max(i - 1, 0), min(i + 2, rows)):
            for m in range(max(j - 1, 0), min(j + 2, columns)):
                if edge_at[k, m] == a:
                    edge_at[k, m] = -1


@njit(nogil=True, cache=True, **UNCOUNTED)
def group_curves(
    point_m: F32,
    point_uv: F32,
    point_at: I32,
    order: I32,
    start: I32,
    closed: U8,
    curve: I32,
    curves: int,
    extent_m: F32,
    cell_width: float,
    group: I32,
) -> None:
    """`group`: (K,) the same number for curves of which one ends on the other, as where three edges of a box meet."""
    rows, columns = point_at.shape
    for k in range(curves):
        group[k] = k
    for k in range(curves):
        if closed[k] == 1 or extent_m[k] == 0.0:
            continue
        for side in range(2):
            a = order[start[k]] if side == 0 else order[start[k + 1] - 1]
            inner = min(4, start[k + 1] - start[k] - 1)
            tail = order[start[k] + inner] if side == 0 else order[start[k + 1] - 1 - inner]
            i, j = int(point_uv[a, 1]), int(point_uv[a, 0])
            for ki in range(max(i - MEET_CELLS, 0), min(i + MEET_CELLS + 1, rows)):
                for kj in range(max(j - MEET_CELLS, 0), min(j + MEET_CELLS + 1, columns)):
                    b = point_at[ki, kj]
                    if b < 0 or curve[b] == k or extent_m[curve[b]] == 0.0:
                        continue
                    gap = _gap_cells(point_m, a, b, cell_width)
                    if gap < 3.0 or (gap < MEET_CELLS and _turn(point_uv, tail, a, b) < 0.3):
                        ra, rb = _root(group, k), _root(group, curve[b])
                        group[max(ra, rb)] = min(ra, rb)
    for k in range(curves):
        group[k] = _root(group, k)
