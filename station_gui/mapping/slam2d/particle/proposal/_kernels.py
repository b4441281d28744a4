"""Kernels of matching on a particle's map and of the proposal that is sampled round the match."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from station_gui.mapping.slam2d.matching._kernels import prior_information, solve3
from station_gui.mapping.slam2d.particle.blocks._kernels import (
    CODE_ROW,
    MAX_REACH,
    NONE_NEAR,
    SIDE,
    SIDE_BITS,
    Blocks,
    block_at,
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
        if blocks.surfels[holder, r, q, 0] == 0.0:  # the room for blocks had run out
            continue
        nx = float(blocks.surfels[holder, r, q, 3])
        ny = float(blocks.surfels[holder, r, q, 4])
        surfels[i, 1] = blocks.surfels[holder, r, q, 1]
        surfels[i, 2] = blocks.surfels[holder, r, q, 2]
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
            turn = ny * rx - nx * ry
            hessian[0, 0] += w * nx * nx
            hessian[0, 1] += w * nx * ny
            hessian[0, 2] += w * nx * turn
            hessian[1, 1] += w * ny * ny
            hessian[1, 2] += w * ny * turn
            hessian[2, 2] += w * turn * turn
            gradient[0] += w * r * nx
            gradient[1] += w * r * ny
            gradient[2] += w * r * turn
        else:
            r2 = dx * dx + dy * dy
            w = k2 / (k2 + r2)
            w *= w * point_weight
            hessian[0, 0] += w
            hessian[1, 1] += w
            hessian[0, 2] -= w * ry
            hessian[1, 2] += w * rx
            hessian[2, 2] += w * (rx * rx + ry * ry)
            gradient[0] += w * dx
            gradient[1] += w * dy
            gradient[2] += w * (dy * rx - dx * ry)
        if r2 < inlier_m * inlier_m:
            inliers += 1.0
    hessian[1, 0] = hessian[0, 1]
    hessian[2, 0] = hessian[0, 2]
    hessian[2, 1] = hessian[1, 2]
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
def lower_root(a: FloatArray, root: FloatArray) -> bool:
    """Cholesky's factor of a symmetric (3, 3); False where it is not positive definite."""
    for row in range(3):
        for column in range(row + 1):
            rest = a[row, column]
            for k in range(column):
                rest -= root[row, k] * root[column, k]
            if row == column:
                if not rest > 0.0:
                    return False
                root[row, row] = math.sqrt(rest)
            else:
                root[row, column] = rest / root[column, column]
    return True


@njit(nogil=True, cache=True)
def unwhiten(root: FloatArray, z: FloatArray, x: FloatArray) -> None:
    """x = rootᵀ⁻¹ z: has the covariance (root rootᵀ)⁻¹ when z has the identity."""
    x[2] = z[2] / root[2, 2]
    x[1] = (z[1] - root[2, 1] * x[2]) / root[1, 1]
    x[0] = (z[0] - root[1, 0] * x[1] - root[2, 0] * x[2]) / root[0, 0]


@njit(nogil=True, cache=True)
def sample_proposal(
    blocks: Blocks,
    particle: int,
    points: FloatArray,
    normals: FloatArray,
    prior_pose: FloatArray,
    system: FloatArray,
    prior: FloatArray,
    noise_m: float,
    spacing: float,
    kernel_m: float,
    cell_m: float,
    deviates: FloatArray,
    pose: FloatArray,
) -> float:
    """Draw from the Gaussian of the likelihoods round a match (Grisetti et al. 2007, eqs. 13 to 19, algorithm 1).

    The likelihood times the prior is evaluated on 3 × 3 × 3 poses, `spacing` standard deviations of the match apart,
    those within half a cell with the surfels that the match found. `pose` is the match and becomes the sample.
    Returns the logarithm of the integral (eq. 19), NaN where the match has no covariance; `pose` then stays.
    """
    surfels = np.zeros((points.shape[0], 5))
    elsewhere = np.zeros((points.shape[0], 5))
    information = np.zeros((3, 3))
    root = np.zeros((3, 3))
    spread = np.zeros((3, 3))
    z = np.zeros(3)
    x = np.zeros(3)
    trial = np.zeros(3)
    mean = np.zeros(3)
    logs = np.zeros(27)
    precision = 1.0 / (noise_m * noise_m)
    for a in range(3):
        for b in range(3):
            information[a, b] = system[a, b] * precision
    if not lower_root(information, root):
        return math.nan
    best = -math.inf
    far_m = 0.0
    for i in range(points.shape[0]):
        far_m = max(far_m, math.hypot(points[i, 0], points[i, 1]))
    associate(blocks, particle, points, normals, pose, cell_m, surfels)
    for k in range(27):
        lattice(k, spacing, z)
        unwhiten(root, z, x)
        for a in range(3):
            trial[a] = pose[a] + x[a]
        wide = abs(x[0]) + abs(x[1]) + abs(x[2]) * far_m > 0.5 * cell_m
        if wide:
            associate(blocks, particle, points, normals, trial, cell_m, elsewhere)
        offset(trial, prior_pose, x)
        twice = cost(points, elsewhere if wide else surfels, trial, kernel_m)
        for a in range(3):
            for b in range(3):
                twice += x[a] * prior[a, b] * x[b]
        logs[k] = -0.5 * precision * twice
        best = max(best, logs[k])
    total = 0.0
    for k in range(27):
        logs[k] = math.exp(logs[k] - best)
        total += logs[k]
    for k in range(27):
        lattice(k, spacing, z)
        for a in range(3):
            mean[a] += logs[k] / total * z[a]
    for k in range(27):
        lattice(k, spacing, z)
        for a in range(3):
            for b in range(3):
                spread[a, b] += logs[k] / total * (z[a] - mean[a]) * (z[b] - mean[b])
    for a in range(3):
        spread[a, a] += 1e-3
    if not lower_root(spread, information):
        return math.nan
    for a in range(3):
        z[a] = mean[a]
        for b in range(a + 1):
            z[a] += information[a, b] * deviates[b]
    unwhiten(root, z, x)
    for a in range(3):
        pose[a] += x[a]
    return best + math.log(total) - math.log(root[0, 0] * root[1, 1] * root[2, 2])


@njit(nogil=True, cache=True)
def lattice(k: int, spacing: float, z: FloatArray) -> None:
    z[0] = spacing * (k % 3 - 1)
    z[1] = spacing * (k // 3 % 3 - 1)
    z[2] = spacing * (k // 9 - 1)


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
                        if d2 < likelihood.shape[0]:
                            total += likelihood[d2]
                if total > best_sum:
                    best_sum = total
                    best[0] = centre[0] + i * shift_m
                    best[1] = centre[1] + j * shift_m
                    best[2] = centre[2] + k * turn_rad


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
