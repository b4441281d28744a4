"""Kernels of the proposal that is sampled round a match."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from station_gui.mapping.slam2d.particle.blocks._kernels import Blocks
from station_gui.mapping.slam2d.particle.matching._kernels import associate, cost, offset

FloatArray = NDArray[np.float64]


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
def lattice(k: int, spacing: float, z: FloatArray) -> None:
    z[0] = spacing * (k % 3 - 1)
    z[1] = spacing * (k // 3 % 3 - 1)
    z[2] = spacing * (k // 9 - 1)


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
