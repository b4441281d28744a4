"""Kernels of matching on a particle's map: look-ups of surfels, least squares, exhaustive search."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from station_gui.mapping.slam2d.matching._kernels import (
    add_line_term,
    add_point_term,
    mirror,
    prior_information,
    solve3,
)
from station_gui.mapping.slam2d.particle.blocks._kernels import (
    CODE_ROW,
    MAX_REACH,
    NONE_NEAR,
    SIDE,
    SIDE_BITS,
    UNIT,
    Blocks,
    block_at,
    counts_in,
    distance2,
)

FloatArray = NDArray[np.float64]


@njit(nogil=True, cache=True)
def associate(
    blocks: Blocks,
    particle: int,
    points: FloatArray,
    normals: FloatArray,
    pose: FloatArray,
    cell_m: float,
    surfels: FloatArray,
) -> None:
    """`surfels` (N, 5): for every point the kind (0 none, 1 line, 2 point), mean and normal of its nearest surfel.

    The other side of a thin wall is none. Neighbouring points mostly lie in one block, which is looked up once.
    """
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    block = -1
    block_row = 1 << 60
    block_column = 1 << 60
    for i in range(points.shape[0]):
        surfels[i, 0] = 0.0
        column = math.floor((pose[0] + c * points[i, 0] - s * points[i, 1]) / cell_m)
        row = math.floor((pose[1] + s * points[i, 0] + c * points[i, 1]) / cell_m)
        if row >> SIDE_BITS != block_row or column >> SIDE_BITS != block_column:
            block_row = row >> SIDE_BITS
            block_column = column >> SIDE_BITS
            block = block_at(blocks, particle, row, column)
        if block < 0:
            continue
        code = blocks.nearest[block, row & (SIDE - 1), column & (SIDE - 1)]
        if code == NONE_NEAR:
            continue
        row += code // CODE_ROW - MAX_REACH
        column += code % CODE_ROW - MAX_REACH
        holder = block
        if row >> SIDE_BITS != block_row or column >> SIDE_BITS != block_column:
            holder = block_at(blocks, particle, row, column)
            if holder < 0:
                continue
        r = row & (SIDE - 1)
        q = column & (SIDE - 1)
        if blocks.surfels[holder, r, q, 0] == 0:  # the room for blocks had run out
            continue
        if blocks.joined[blocks.surfels[holder, r, q, 5]] == 0:
            continue
        surfels[i, 1] = (column + blocks.surfels[holder, r, q, 1] / UNIT) * cell_m
        surfels[i, 2] = (row + blocks.surfels[holder, r, q, 2] / UNIT) * cell_m
        nx = blocks.surfels[holder, r, q, 3] / UNIT
        ny = blocks.surfels[holder, r, q, 4] / UNIT
        length = math.hypot(nx, ny)
        if length <= 0.5:
            surfels[i, 0] = 2.0
            continue
        surfels[i, 3] = nx / length
        surfels[i, 4] = ny / length
        facing = nx * (c * normals[i, 0] - s * normals[i, 1]) + ny * (s * normals[i, 0] + c * normals[i, 1])
        surfels[i, 0] = 0.0 if facing < 0.0 else 1.0


@njit(nogil=True, cache=True)
def cost(points: FloatArray, surfels: FloatArray, pose: FloatArray, kernel_m: float) -> float:
    """Sum over all points of r² k² / (r² + k²), Geman and McClure's; k² where there is nothing near."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    k2 = kernel_m * kernel_m
    total = 0.0
    for i in range(points.shape[0]):
        if surfels[i, 0] == 0.0:
            total += k2
            continue
        dx = pose[0] + c * points[i, 0] - s * points[i, 1] - surfels[i, 1]
        dy = pose[1] + s * points[i, 0] + c * points[i, 1] - surfels[i, 2]
        r2 = dx * dx + dy * dy
        if surfels[i, 0] == 1.0:
            r2 = (surfels[i, 3] * dx + surfels[i, 4] * dy) ** 2
        total += k2 * r2 / (k2 + r2)
    return total


@njit(nogil=True, cache=True)
def cost_on_map(
    blocks: Blocks,
    particle: int,
    points: FloatArray,
    normals: FloatArray,
    pose: FloatArray,
    kernel_m: float,
    cell_m: float,
) -> float:
    """`cost` against the surfels nearest to the points at `pose`."""
    surfels = np.zeros((points.shape[0], 5))
    associate(blocks, particle, points, normals, pose, cell_m, surfels)
    return float(cost(points, surfels, pose, kernel_m))


@njit(nogil=True, cache=True)
def linearise(
    points: FloatArray,
    surfels: FloatArray,
    pose: FloatArray,
    kernel_m: float,
    inlier_m: float,
    point_weight: float,
    hessian: FloatArray,
    gradient: FloatArray,
) -> float:
    """Normal equations for an increment (dx, dy) in the map frame and a turn about the robot; returns the inliers."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    k2 = kernel_m * kernel_m
    inliers = 0.0
    for a in range(3):
        gradient[a] = 0.0
        for b in range(3):
            hessian[a, b] = 0.0
    for i in range(points.shape[0]):
        if surfels[i, 0] == 0.0:
            continue
        rx = c * points[i, 0] - s * points[i, 1]
        ry = s * points[i, 0] + c * points[i, 1]
        dx = pose[0] + rx - surfels[i, 1]
        dy = pose[1] + ry - surfels[i, 2]
        if surfels[i, 0] == 1.0:
            nx = surfels[i, 3]
            ny = surfels[i, 4]
            r = nx * dx + ny * dy
            r2 = r * r
            w = k2 / (k2 + r2)
            w *= w
            add_line_term(w, r, nx, ny, rx, ry, hessian, gradient)
        else:
            r2 = dx * dx + dy * dy
            w = k2 / (k2 + r2)
            w *= w * point_weight
            add_point_term(w, dx, dy, rx, ry, hessian, gradient)
        if r2 < inlier_m * inlier_m:
            inliers += 1.0
    mirror(hessian)
    return inliers


@njit(nogil=True, cache=True)
def refine(
    blocks: Blocks,
    particle: int,
    points: FloatArray,
    normals: FloatArray,
    pose: FloatArray,
    prior_pose: FloatArray,
    prior_weight: FloatArray,
    weak_points: float,
    weak_weight: float,
    wide_kernel_m: float,
    fine_kernel_m: float,
    inlier_m: float,
    point_weight: float,
    max_iterations: int,
    cell_m: float,
    system: FloatArray,
    prior: FloatArray,
) -> float:
    """Gauss–Newton with a prior; `pose` is moved in place; returns the share of points that fit.

    The kernel is halved from wide to fine, each time the pose has settled. `system`: the last normal matrix with
    the prior, `prior`: what of it the prior is; both in units of one residual's information.
    """
    surfels = np.zeros((points.shape[0], 5))
    gradient = np.zeros(3)
    step = np.zeros(3)
    difference = np.zeros(3)
    kernel_m = wide_kernel_m
    inliers = 0.0
    for _ in range(max_iterations):
        associate(blocks, particle, points, normals, pose, cell_m, surfels)
        inliers = linearise(points, surfels, pose, kernel_m, inlier_m, point_weight, system, gradient)
        prior_information(system, prior_weight, weak_points, weak_weight, prior)
        offset(pose, prior_pose, difference)
        for a in range(3):
            for b in range(3):
                gradient[a] += prior[a, b] * difference[b]
                system[a, b] += prior[a, b]
        if not solve3(system, gradient, step):
            break
        for a in range(3):
            pose[a] += step[a]
        moved_m = abs(step[0]) + abs(step[1])
        if kernel_m > fine_kernel_m:
            if moved_m < 5e-3 and abs(step[2]) < 1e-3:
                kernel_m = max(fine_kernel_m, 0.5 * kernel_m)
        elif moved_m < 5e-4 and abs(step[2]) < 1e-4:
            break
    return float(inliers / max(points.shape[0], 1))


@njit(nogil=True, cache=True)
def offset(pose: FloatArray, other: FloatArray, difference: FloatArray) -> None:
    """`pose` less `other`, the turn by the shorter way."""
    difference[0] = pose[0] - other[0]
    difference[1] = pose[1] - other[1]
    turn = pose[2] - other[2]
    difference[2] = turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)


@njit(nogil=True, cache=True)
def correlate(
    blocks: Blocks,
    particle: int,
    points: FloatArray,
    centre: FloatArray,
    shifts: int,
    shift_m: float,
    turns: int,
    turn_rad: float,
    likelihood: FloatArray,
    cell_m: float,
    best: FloatArray,
) -> None:
    """Exhaustive search round `centre` (Olson 2009); `likelihood`: by squared distance in cells."""
    best_sum = -1.0
    for k in range(-turns, turns + 1):
        c = math.cos(centre[2] + k * turn_rad)
        s = math.sin(centre[2] + k * turn_rad)
        for j in range(-shifts, shifts + 1):
            for i in range(-shifts, shifts + 1):
                total = 0.0
                for p in range(points.shape[0]):
                    x = centre[0] + i * shift_m + c * points[p, 0] - s * points[p, 1]
                    y = centre[1] + j * shift_m + s * points[p, 0] + c * points[p, 1]
                    row = math.floor(y / cell_m)
                    column = math.floor(x / cell_m)
                    block = block_at(blocks, particle, row, column)
                    if block >= 0:
                        d2 = distance2(blocks.nearest[block, row & (SIDE - 1), column & (SIDE - 1)])
                        if d2 < likelihood.shape[0] and counts_in(blocks, particle, block, row, column):
                            total += likelihood[d2]
                if total > best_sum:
                    best_sum = total
                    best[0] = centre[0] + i * shift_m
                    best[1] = centre[1] + j * shift_m
                    best[2] = centre[2] + k * turn_rad
