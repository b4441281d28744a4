"""Kernels of the pose graph: plain arrays and scalars."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int32]


@njit(nogil=True, cache=True)
def edge_error(poses: FloatArray, i: int, j: int, measured: FloatArray, error: FloatArray) -> None:
    """inv(pose i) @ pose j minus `measured`, in the frame of node i; the angle wrapped."""
    c = math.cos(poses[i, 2])
    s = math.sin(poses[i, 2])
    dx = poses[j, 0] - poses[i, 0]
    dy = poses[j, 1] - poses[i, 1]
    error[0] = c * dx + s * dy - measured[0]
    error[1] = -s * dx + c * dy - measured[1]
    turn = poses[j, 2] - poses[i, 2] - measured[2]
    error[2] = turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)


@njit(nogil=True, cache=True)
def chi2_of(error: FloatArray, information: FloatArray) -> float:
    total = 0.0
    for a in range(3):
        for b in range(3):
            total += error[a] * information[a, b] * error[b]
    return total


@njit(nogil=True, cache=True)
def all_chi2(
    poses: FloatArray, ends: IndexArray, measured: FloatArray, information: FloatArray, chi2: FloatArray
) -> None:
    error = np.zeros(3)
    for e in range(ends.shape[0]):
        edge_error(poses, ends[e, 0], ends[e, 1], measured[e], error)
        chi2[e] = chi2_of(error, information[e])


@njit(nogil=True, cache=True)
def assemble(
    poses: FloatArray,
    ends: IndexArray,
    measured: FloatArray,
    information: FloatArray,
    robust: NDArray[np.bool_],
    switch_chi2: float,
    rows: IndexArray,
    columns: IndexArray,
    values: FloatArray,
    gradient: FloatArray,
) -> float:
    """Gauss–Newton system of all edges in triplets, 36 per edge, node 0 left out (row -1 means unused).

    A robust edge is scaled by s = min(1, 2 phi / (phi + chi2)), dynamic covariance scaling (Agarwal et al. 2013,
    eq. 15). Returns the sum of the scaled errors.
    """
    error = np.zeros(3)
    jacobian = np.zeros((3, 6))
    weighted = np.zeros((3, 6))
    for k in range(gradient.shape[0]):
        gradient[k] = 0.0
    total = 0.0
    slot = 0
    for e in range(ends.shape[0]):
        i = ends[e, 0]
        j = ends[e, 1]
        edge_error(poses, i, j, measured[e], error)
        chi2 = chi2_of(error, information[e])
        scale = 1.0
        if robust[e]:
            scale = min(1.0, 2.0 * switch_chi2 / (switch_chi2 + chi2))
            scale *= scale
        total += scale * chi2
        _jacobian(poses, i, j, jacobian)
        for a in range(3):
            for b in range(6):
                value = 0.0
                for k in range(3):
                    value += information[e, a, k] * jacobian[k, b]
                weighted[a, b] = scale * value
        for a in range(6):
            row = 3 * (i - 1) + a if a < 3 else 3 * (j - 1) + a - 3
            if row >= 0:
                for k in range(3):
                    gradient[row] += weighted[k, a] * error[k]
            for b in range(6):
                column = 3 * (i - 1) + b if b < 3 else 3 * (j - 1) + b - 3
                if row < 0 or column < 0:
                    rows[slot] = 0
                    columns[slot] = 0
                    values[slot] = 0.0
                else:
                    value = 0.0
                    for k in range(3):
                        value += jacobian[k, a] * weighted[k, b]
                    rows[slot] = row
                    columns[slot] = column
                    values[slot] = value
                slot += 1
    return total


@njit(nogil=True, cache=True)
def _jacobian(poses: FloatArray, i: int, j: int, jacobian: FloatArray) -> None:
    """Of the edge error by (x, y, theta) of node i and of node j."""
    c = math.cos(poses[i, 2])
    s = math.sin(poses[i, 2])
    dx = poses[j, 0] - poses[i, 0]
    dy = poses[j, 1] - poses[i, 1]
    jacobian[0, 0] = -c
    jacobian[0, 1] = -s
    jacobian[0, 2] = -s * dx + c * dy
    jacobian[1, 0] = s
    jacobian[1, 1] = -c
    jacobian[1, 2] = -c * dx - s * dy
    jacobian[2, 0] = 0.0
    jacobian[2, 1] = 0.0
    jacobian[2, 2] = -1.0
    jacobian[0, 3] = c
    jacobian[0, 4] = s
    jacobian[0, 5] = 0.0
    jacobian[1, 3] = -s
    jacobian[1, 4] = c
    jacobian[1, 5] = 0.0
    jacobian[2, 3] = 0.0
    jacobian[2, 4] = 0.0
    jacobian[2, 5] = 1.0
