"""Kernels of standard growing neural gas (Fritzke, NIPS 7, 1995); the graph's arguments as in `graph._kernels`.

error: (N,) float32, the error that a node has accumulated, m².
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robot_app.perception._kernels import UNCOUNTED
from robot_app.perception.learners.graph._kernels import (
    connect,
    disconnect,
    draw,
    grow_older,
    hand_over,
    nearest_two,
    take_place,
)

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]
U64 = NDArray[np.uint64]


@njit(nogil=True, cache=True, **UNCOUNTED)
def adapt(node: F32, beside: I32, degree: I32, s1: int, point: F32, winner_rate: float, neighbour_rate: float) -> None:
    """Fritzke's step 5: the winner and its neighbours move towards the point."""
    for axis in range(3):
        node[axis, s1] += np.float32(winner_rate) * (point[axis] - node[axis, s1])
        for slot in range(degree[s1]):
            b = beside[s1, slot]
            node[axis, b] += np.float32(neighbour_rate) * (point[axis] - node[axis, b])


@njit(nogil=True, cache=True, **UNCOUNTED)
def forget_old(node: F32, beside: I32, age: I32, degree: I32, error: F32, nodes: int, s1: int, max_age: int) -> int:
    """Step 7: the winner's connections older than `max_age` go, and nodes that lose their last one with them.

    Only the winner's connections have just aged. Returns the number of nodes that are left.
    """
    slot = 0
    while slot < degree[s1]:
        b = beside[s1, slot]
        if age[s1, slot] <= max_age:
            slot += 1
            continue
        disconnect(beside, age, degree, s1, b)
        if degree[b] == 0 and nodes > 2:
            nodes -= 1
            take_place(node, beside, age, degree, b, nodes)
            error[b] = error[nodes]
            if s1 == nodes:
                s1 = b
    return nodes


@njit(nogil=True, cache=True, **UNCOUNTED)
def insert(node: F32, beside: I32, age: I32, degree: I32, error: F32, nodes: int, alpha: float) -> int:
    """Step 8: a node between the one with the largest error and that one's neighbour with the largest error."""
    q = 0
    for a in range(1, nodes):
        if error[a] > error[q]:
            q = a
    if degree[q] == 0:
        return nodes
    f = beside[q, 0]
    for slot in range(1, degree[q]):
        if error[beside[q, slot]] > error[f]:
            f = beside[q, slot]
    r = nodes
    for axis in range(3):
        node[axis, r] = np.float32(0.5) * (node[axis, q] + node[axis, f])
    degree[r] = 0
    disconnect(beside, age, degree, q, f)
    connect(beside, age, degree, q, r)
    connect(beside, age, degree, f, r)
    error[q] *= np.float32(alpha)
    error[f] *= np.float32(alpha)
    error[r] = error[q]
    return nodes + 1


@njit(nogil=True, cache=True, **UNCOUNTED)
def grow(
    sample_m: F32,
    samples: int,
    most_nodes: int,
    most_iterations: int,
    per_node: int,
    winner_rate: float,
    neighbour_rate: float,
    max_age: int,
    alpha: float,
    decay: float,
    state: U64,
    node: F32,
    square: F32,
    error: F32,
    beside: I32,
    age: I32,
    degree: I32,
    node_m: F32,
    linked: U8,
) -> tuple[int, int]:
    """Learns until there are `most_nodes`; returns the numbers of nodes and of iterations."""
    if samples < 2:
        return 0, 0
    first = draw(state, samples)
    second = (first + 1 + draw(state, samples - 1)) % samples
    for axis in range(3):
        node[axis, 0], node[axis, 1] = sample_m[first, axis], sample_m[second, axis]
    error[:2] = 0.0
    degree[:2] = 0
    connect(beside, age, degree, 0, 1)
    nodes, iterations = 2, 0
    keep = np.float32(decay)
    while nodes < most_nodes and iterations < most_iterations:
        iterations += 1
        point = sample_m[draw(state, samples)]
        s1, s2 = nearest_two(point[0], point[1], point[2], node, nodes, square)
        grow_older(beside, age, degree, s1, 1)
        error[s1] += square[s1]
        adapt(node, beside, degree, s1, point, winner_rate, neighbour_rate)
        connect(beside, age, degree, s1, s2)
        nodes = forget_old(node, beside, age, degree, error, nodes, s1, max_age)
        if iterations % per_node == 0:
            nodes = insert(node, beside, age, degree, error, nodes, alpha)
        for a in range(nodes):
            error[a] *= keep
    hand_over(node, beside, degree, nodes, node_m, linked)
    return nodes, iterations
