"""Kernels of the pose graph: plain arrays and scalars.

Those with a `state` and a `budget` go on from `state[0]`, do about as much work as `budget` products of two 3 × 3
blocks are, and return what they took.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int32]
State = NDArray[np.int64]


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
def place_all(nodes: FloatArray, node: IndexArray, in_node: FloatArray, poses: FloatArray) -> None:
    """`poses` (K, 3) become those of `in_node` (K, 3) in the frames of their `node` (K,) among `nodes` (N, 3)."""
    last, c, s = -1, 1.0, 0.0
    for k in range(node.shape[0]):
        n = node[k]
        if n != last:  # they come node after node
            last, c, s = n, math.cos(nodes[n, 2]), math.sin(nodes[n, 2])
        poses[k, 0] = nodes[n, 0] + c * in_node[k, 0] - s * in_node[k, 1]
        poses[k, 1] = nodes[n, 1] + s * in_node[k, 0] + c * in_node[k, 1]
        turn = nodes[n, 2] + in_node[k, 2]
        poses[k, 2] = turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)


@njit(nogil=True, cache=True)
def copy_poses(poses: FloatArray, trial: FloatArray, nodes: int, state: State, budget: int) -> int:
    last = min(nodes, state[0] + 8 * budget)
    done = last - state[0]
    for k in range(state[0], last):
        for m in range(3):
            trial[k, m] = poses[k, m]
    state[0] = last
    return int(done // 8 + 1)


@njit(nogil=True, cache=True)
def worst_chi2(
    poses: FloatArray,
    ends: IndexArray,
    measured: FloatArray,
    information: FloatArray,
    robust: NDArray[np.bool_],
    edges: int,
    worst: FloatArray,
    state: State,
    budget: int,
) -> int:
    """`worst[0]` becomes the largest squared error of the robust edges from `state[0]` on."""
    error = np.zeros(3)
    work = 0
    while state[0] < edges and work < budget:
        e = state[0]
        if robust[e]:
            edge_error(poses, ends[e, 0], ends[e, 1], measured[e], error)
            worst[0] = max(worst[0], chi2_of(error, information[e]))
            work += 2
        state[0] += 1
        work += e & 1
    return work + 1


@njit(nogil=True, cache=True)
def assemble(
    poses: FloatArray,
    ends: IndexArray,
    measured: FloatArray,
    information: FloatArray,
    robust: NDArray[np.bool_],
    switch_chi2: float,
    edges: int,
    position: IndexArray,
    slots: IndexArray,
    diagonal: FloatArray,
    below: FloatArray,
    right: FloatArray,
    state: State,
    budget: int,
) -> int:
    """Add the edges from `state[0]` on to the Gauss–Newton system, node 0 left out.

    `diagonal`, `below` and `right` (minus the gradient) as in `BlockCholesky`; of the edge's own block the lower one
    by `position` is kept. A robust edge is scaled by s = min(1, 2 phi / (phi + chi2)), dynamic covariance scaling
    (Agarwal et al. 2013, eq. 15).
    """
    error = np.zeros(3)
    jacobian = np.zeros((3, 6))
    weighted = np.zeros((3, 6))
    work = 0
    while state[0] < edges and work < budget:
        e = state[0]
        i = ends[e, 0]
        j = ends[e, 1]
        edge_error(poses, i, j, measured[e], error)
        scale = 1.0
        if robust[e]:
            scale = min(1.0, 2.0 * switch_chi2 / (switch_chi2 + chi2_of(error, information[e])))
            scale *= scale
        _jacobian(poses, i, j, jacobian)
        for a in range(3):
            for b in range(6):
                value = 0.0
                for k in range(3):
                    value += information[e, a, k] * jacobian[k, b]
                weighted[a, b] = scale * value
        if i > 0:
            _add_end(position[i - 1], 0, jacobian, weighted, error, diagonal, right)
        if j > 0:
            _add_end(position[j - 1], 3, jacobian, weighted, error, diagonal, right)
        if slots[e] >= 0:
            i_is_row = position[i - 1] > position[j - 1]
            for a in range(3):
                for b in range(3):
                    value = 0.0
                    for k in range(3):
                        value += jacobian[k, a] * weighted[k, 3 + b]
                    below[slots[e], 3 * a + b if i_is_row else 3 * b + a] += value
        state[0] += 1
        work += 16
    return work


@njit(nogil=True, cache=True)
def _add_end(
    at: int,
    first: int,
    jacobian: FloatArray,
    weighted: FloatArray,
    error: FloatArray,
    diagonal: FloatArray,
    right: FloatArray,
) -> None:
    for a in range(3):
        for k in range(3):
            right[at, a] -= weighted[k, first + a] * error[k]
        for b in range(3):
            value = 0.0
            for k in range(3):
                value += jacobian[k, first + a] * weighted[k, first + b]
            diagonal[at, 3 * a + b] += value


@njit(nogil=True, cache=True)
def move_poses(
    trial: FloatArray,
    position: IndexArray,
    change: FloatArray,
    nodes: int,
    largest: FloatArray,
    state: State,
    budget: int,
) -> int:
    """`trial` moves by the solution; `largest[0]` becomes the largest change of a coordinate. Node 0 stays."""
    last = min(nodes - 1, state[0] + 2 * budget)
    done = last - state[0]
    for k in range(state[0], last):
        for m in range(3):
            trial[k + 1, m] += change[position[k], m]
            largest[0] = max(largest[0], abs(change[position[k], m]))
    state[0] = last
    return int(done // 2 + 1)


@njit(nogil=True, cache=True)
def farthest_move(
    poses: FloatArray, trial: FloatArray, nodes: int, farthest: FloatArray, state: State, budget: int
) -> int:
    """`farthest[0]` becomes the greatest distance of a node's two places."""
    last = min(nodes, state[0] + 2 * budget)
    done = last - state[0]
    for k in range(state[0], last):
        farthest[0] = max(farthest[0], math.hypot(trial[k, 0] - poses[k, 0], trial[k, 1] - poses[k, 1]))
    state[0] = last
    return int(done // 2 + 1)


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
