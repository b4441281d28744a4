"""Kernel that judges beams against a map: plain arrays and scalars."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from station_gui.mapping.slam2d.matching._kernels import NONE_NEAR

FloatArray = NDArray[np.float64]
FITS, UNKNOWN, IN_FREE_SPACE, THROUGH_WALL = 0, 1, 2, 3
_DIAGONAL = 1.4143  # of a cell, in cells, and no less


@njit(nogil=True, cache=True)
def judge(
    points: FloatArray,
    normals: FloatArray,
    scanners: FloatArray,
    pose: FloatArray,
    inlier_m: float,
    margin_m: float,
    min_cosine: float,
    free_below: float,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    nearest: NDArray[np.int32],
    distance2: NDArray[np.uint8],
    reach_cells: int,
    surfels: FloatArray,
    probability: NDArray[np.float32],
    grid_x: float,
    grid_y: float,
    grid_cell_m: float,
    verdicts: NDArray[np.uint8],
) -> None:
    """What the map says to each beam from `scanners` (N, 2) to `points` (N, 2), placed by `pose` (3,).

    A beam that crosses a known surface steeper than `min_cosine` more than `margin_m` before its end goes through a
    wall; one that ends on a surface that faces it fits; one that ends where the grid is free cannot be either.
    """
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    for i in range(points.shape[0]):
        x = pose[0] + c * points[i, 0] - s * points[i, 1]
        y = pose[1] + s * points[i, 0] + c * points[i, 1]
        from_x = pose[0] + c * scanners[i, 0] - s * scanners[i, 1]
        from_y = pose[1] + s * scanners[i, 0] + c * scanners[i, 1]
        if _crosses(
            from_x, from_y, x, y, margin_m, min_cosine, origin_x, origin_y, cell_m, nearest, distance2,
            reach_cells, surfels, probability, grid_x, grid_y, grid_cell_m,
        ):  # fmt: skip
            verdicts[i] = THROUGH_WALL
            continue
        nx = c * normals[i, 0] - s * normals[i, 1]
        ny = s * normals[i, 0] + c * normals[i, 1]
        if _fits(x, y, nx, ny, inlier_m, origin_x, origin_y, cell_m, nearest, surfels):
            verdicts[i] = FITS
        elif _probability(x, y, probability, grid_x, grid_y, grid_cell_m) < free_below:
            verdicts[i] = IN_FREE_SPACE
        else:
            verdicts[i] = UNKNOWN


@njit(nogil=True, cache=True)
def _probability(
    x: float, y: float, probability: NDArray[np.float32], grid_x: float, grid_y: float, grid_cell_m: float
) -> float:
    column = math.floor((x - grid_x) / grid_cell_m)
    row = math.floor((y - grid_y) / grid_cell_m)
    if 0 <= column < probability.shape[1] and 0 <= row < probability.shape[0]:
        return float(probability[row, column])
    return 0.5


@njit(nogil=True, cache=True)
def _fits(
    x: float,
    y: float,
    nx: float,
    ny: float,
    inlier_m: float,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    nearest: NDArray[np.int32],
    surfels: FloatArray,
) -> bool:
    """Distance along the surfel's normal, or to it where it has none; never its other side."""
    column = math.floor((x - origin_x) / cell_m)
    row = math.floor((y - origin_y) / cell_m)
    if column < 0 or row < 0 or column >= nearest.shape[1] or row >= nearest.shape[0]:
        return False
    index = nearest[row, column]
    if index < 0:
        return False
    count = surfels[index, 0]
    dx = x - surfels[index, 1] / count
    dy = y - surfels[index, 2] / count
    mx = surfels[index, 3]
    my = surfels[index, 4]
    length = math.hypot(mx, my)
    if math.hypot(dx, dy) > inlier_m + cell_m:
        return False
    if length <= 0.5 * count:
        return math.hypot(dx, dy) <= inlier_m
    if nx * mx + ny * my < 0.0:
        return False
    return bool(abs(dx * mx + dy * my) / length <= inlier_m)


@njit(nogil=True, cache=True)
def _crosses(
    from_x: float,
    from_y: float,
    x: float,
    y: float,
    margin_m: float,
    min_cosine: float,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    nearest: NDArray[np.int32],
    distance2: NDArray[np.uint8],
    reach_cells: int,
    surfels: FloatArray,
    probability: NDArray[np.float32],
    grid_x: float,
    grid_y: float,
    grid_cell_m: float,
) -> bool:
    length = math.hypot(x - from_x, y - from_y)
    if length <= margin_m:
        return False
    ux = (x - from_x) / length
    uy = (y - from_y) / length
    steps = math.floor((length - margin_m) / (0.5 * cell_m))
    far_steps = max(0, math.floor(2.0 * (reach_cells - _DIAGONAL)) - 1)
    k = -1
    skipped = 0
    while k + 1 + skipped < steps:
        k += 1 + skipped
        skipped = 0
        along = 0.5 * cell_m * (k + 0.5)
        column = math.floor((from_x + along * ux - origin_x) / cell_m)
        row = math.floor((from_y + along * uy - origin_y) / cell_m)
        if column < 0 or row < 0 or column >= nearest.shape[1] or row >= nearest.shape[0]:
            continue
        if distance2[row, column] != 0:
            if distance2[row, column] == NONE_NEAR:  # nor is there a surfel in any of the next half cells
                skipped = far_steps
            continue
        index = nearest[row, column]
        count = surfels[index, 0]
        mean_x = surfels[index, 1] / count
        mean_y = surfels[index, 2] / count
        aside = abs((mean_x - from_x) * uy - (mean_y - from_y) * ux)
        before = (mean_x - from_x) * ux + (mean_y - from_y) * uy
        if aside > 0.5 * cell_m or before > length - margin_m:
            continue
        facing = math.sqrt(surfels[index, 3] * surfels[index, 3] + surfels[index, 4] * surfels[index, 4])
        if facing <= 0.5 * count or abs(surfels[index, 3] * ux + surfels[index, 4] * uy) < min_cosine * facing:
            continue
        if _probability(mean_x, mean_y, probability, grid_x, grid_y, grid_cell_m) > 0.75:
            return True
    return False
