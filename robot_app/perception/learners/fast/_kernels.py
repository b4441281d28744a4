"""Kernels of FastGNG (Kubota 2021; Junaedy et al. 2022); the graph's arguments as in `graph._kernels`.

shift: (3, N) float32, by how much the mini-batch wants to move a node, m; share: (N,) float32, the weight of that.
wins: (N,) int32, how many samples of the phase were nearest to a node.
"""

from __future__ import annotations

import math

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
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]
U64 = NDArray[np.uint64]


@njit(nogil=True, cache=True, **UNCOUNTED)
def node_probability(distance_m: float, min_m: float, max_m: float, beta: float) -> float:
    """P_node (eq 12) of a sample whose nearest node is `distance_m` away."""
    if distance_m < min_m:
        return 0.0
    if distance_m <= max_m:
        return 1.0
    return math.tanh(beta * max_m / distance_m)


@njit(nogil=True, cache=True, **UNCOUNTED)
def note_sample(
    node: F32, beside: I32, degree: I32, s1: int, point: F32, neighbour_rate: float, shift: F32, share: F32
) -> None:
    """The winner and its neighbours remember where the sample pulls them."""
    share[s1] += np.float32(1.0)
    for axis in range(3):
        shift[axis, s1] += point[axis] - node[axis, s1]
    for slot in range(degree[s1]):
        b = beside[s1, slot]
        share[b] += np.float32(neighbour_rate)
        for axis in range(3):
            shift[axis, b] += np.float32(neighbour_rate) * (point[axis] - node[axis, b])


@njit(nogil=True, cache=True, **UNCOUNTED)
def move_nodes(node: F32, nodes: int, rate: float, shift: F32, share: F32) -> None:
    """The end of a mini-batch: each node goes `rate` of the way to the mean of what pulled it."""
    for a in range(nodes):
        if share[a] > 0.0:
            part = np.float32(rate) * min(share[a], np.float32(1.0)) / share[a]
            for axis in range(3):
                node[axis, a] += part * shift[axis, a]
                shift[axis, a] = 0.0
            share[a] = 0.0


@njit(nogil=True, cache=True, **UNCOUNTED)
def add_node(node: F32, beside: I32, age: I32, degree: I32, r: int, s1: int, s2: int, d1_m: float, d2_m: float) -> None:
    """Eqs 19-22: connect node r between or beside its nearest two, which are d1_m and d2_m away."""
    dx, dy, dz = node[0, s1] - node[0, s2], node[1, s1] - node[1, s2], node[2, s1] - node[2, s2]
    d12_m = math.sqrt(dx * dx + dy * dy + dz * dz)
    degree[r] = 0
    connect(beside, age, degree, s1, r)
    if d1_m < d12_m and d2_m < d12_m:
        connect(beside, age, degree, s2, r)
        disconnect(beside, age, degree, s1, s2)
    else:
        connect(beside, age, degree, s1, s2)


@njit(nogil=True, cache=True, **UNCOUNTED)
def remove_useless(
    node: F32, beside: I32, age: I32, degree: I32, wins: I32, nodes: int, max_age: int, max_length_m: float
) -> int:
    """The deletion at the end of a phase: old or long connections, then nodes that won nothing or stand alone."""
    for a in range(nodes):
        slot = 0
        while slot < degree[a]:
            b = beside[a, slot]
            dx, dy, dz = node[0, a] - node[0, b], node[1, a] - node[1, b], node[2, a] - node[2, b]
            if age[a, slot] > max_age or dx * dx + dy * dy + dz * dz > max_length_m * max_length_m:
                disconnect(beside, age, degree, a, b)
            else:
                slot += 1
    a = 0
    while a < nodes:
        if nodes > 2 and (wins[a] == 0 or degree[a] == 0):
            while degree[a] > 0:
                disconnect(beside, age, degree, a, beside[a, 0])
            nodes -= 1
            take_place(node, beside, age, degree, a, nodes)
            wins[a] = wins[nodes]
        else:
            a += 1
    return nodes


@njit(nogil=True, cache=True, **UNCOUNTED)
def grow(
    sample_m: F32,
    samples: int,
    most_nodes: int,
    min_length_m: F64,
    max_length_m: F64,
    per_node: F64,
    beta: float,
    batch: int,
    rate: float,
    neighbour_rate: float,
    max_age: int,
    state: U64,
    node: F32,
    square: F32,
    shift: F32,
    share: F32,
    wins: I32,
    beside: I32,
    age: I32,
    degree: I32,
    node_m: F32,
    linked: U8,
) -> tuple[int, int]:
    """All phases; returns the numbers of nodes and of samples that were looked at.

    A loop (eq 16 says how many a phase has) learns a mini-batch of samples, moves the nodes by its mean, and adds the
    sample with the highest weight, P_node, as a node with the connections of eq 20.
    """
    if samples < 2:
        return 0, 0
    shift[:] = 0.0
    share[:] = 0.0
    wins[:] = 0
    first = draw(state, samples)
    second = (first + 1 + draw(state, samples - 1)) % samples
    for axis in range(3):
        node[axis, 0], node[axis, 1] = sample_m[first, axis], sample_m[second, axis]
    degree[:2] = 0
    connect(beside, age, degree, 0, 1)
    nodes, looked = 2, 0
    for phase in range(min_length_m.shape[0]):
        wins[:nodes] = 0
        for _ in range(math.ceil(samples / per_node[phase])):
            best, best_weight = -1, 0.0
            for _ in range(batch):
                i = draw(state, samples)
                point = sample_m[i]
                s1, s2 = nearest_two(point[0], point[1], point[2], node, nodes, square)
                looked += 1
                wins[s1] += 1
                grow_older(beside, age, degree, s1, 1)
                connect(beside, age, degree, s1, s2)
                note_sample(node, beside, degree, s1, point, neighbour_rate, shift, share)
                weight = node_probability(math.sqrt(square[s1]), min_length_m[phase], max_length_m[phase], beta)
                if weight > best_weight:
                    best, best_weight = i, weight
            move_nodes(node, nodes, rate, shift, share)
            if best < 0 or nodes == most_nodes:
                continue
            point = sample_m[best]
            s1, s2 = nearest_two(point[0], point[1], point[2], node, nodes, square)
            for axis in range(3):
                node[axis, nodes] = point[axis]
            wins[nodes] = 1
            d1_m, d2_m = math.sqrt(square[s1]), math.sqrt(square[s2])
            add_node(node, beside, age, degree, nodes, s1, s2, d1_m, d2_m)
            nodes += 1
        nodes = remove_useless(node, beside, age, degree, wins, nodes, max_age, 1.5 * max_length_m[phase])
    hand_over(node, beside, degree, nodes, node_m, linked)
    return nodes, looked
