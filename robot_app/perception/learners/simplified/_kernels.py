"""Kernels of simplified FastGNG (steps 2-7); arguments as in `network._kernels`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robot_app.perception.network._kernels import degree, is_supported, remove_isolated, separation, set_link

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]


@njit(nogil=True, cache=True)
def node_probability(distance_m: float, min_m: float, max_m: float, beta: float) -> float:
    """P_node (eq 12) of a sample whose nearest node is `distance_m` away."""
    if distance_m < min_m:
        return 0.0
    if distance_m <= max_m:
        return 1.0
    return math.tanh(beta * max_m / distance_m)


@njit(nogil=True, cache=True)
def limit_degree(node_m: F32, linked: U8, nodes: int, most: int) -> None:
    """Step 6: while a node has more than `most` connections, the longest one of such a node goes."""
    degrees = np.zeros(nodes, np.int32)
    for a in range(nodes):
        degrees[a] = degree(linked, nodes, a)
    while True:
        longest, la, lb = -1.0, -1, -1
        for a in range(nodes):
            if degrees[a] <= most:
                continue
            for b in range(nodes):
                if linked[a, b] == 1 and separation(node_m, a, node_m, b) > longest:
                    longest, la, lb = separation(node_m, a, node_m, b), a, b
        if la < 0:
            return
        set_link(linked, la, lb, 0)
        degrees[la] -= 1
        degrees[lb] -= 1


@njit(nogil=True, cache=True)
def _note_node(sample_m: F32, samples: int, node_m: F32, node: int, nearest_m: F32) -> None:
    """Keep each sample's distance to its nearest node, dS1 (eq 13), up to date with a new node."""
    for i in range(samples):
        nearest_m[i] = min(nearest_m[i], separation(sample_m, i, node_m, node))


@njit(nogil=True, cache=True)
def _nearest_supported(
    node_m: F32,
    node_curve: I32,
    r: int,
    limit_m: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
) -> tuple[int, int]:
    """The nearest two of the older nodes that edge points lead to from node r, -1 for none; looks at eight nodes."""
    s1, after_m = -1, -1.0
    for _ in range(8):
        best, best_m = -1, limit_m
        for k in range(r):
            if node_curve[k] == node_curve[r]:
                distance = separation(node_m, k, node_m, r)
                if after_m < distance < best_m:
                    best, best_m = k, distance
        if best < 0:
            break
        after_m = best_m
        if is_supported(node_m, best, r, lens, stride, reach_m, step_m, edge_m, edge_at):
            if s1 >= 0:
                return s1, best
            s1 = best
    return s1, -1


@njit(nogil=True, cache=True)
def _best_sample(
    sample_weight: F32,
    samples: int,
    nearest_m: F32,
    seen_m: F32,
    chance: F32,
    min_m: float,
    max_m: float,
    beta: float,
) -> int:
    """The sample with the highest P_node times weight; -1 when none may be added."""
    best, best_weight = -1, 0.0
    for i in range(samples):
        if seen_m[i] != nearest_m[i]:
            seen_m[i] = nearest_m[i]
            chance[i] = node_probability(nearest_m[i], min_m, max_m, beta) * sample_weight[i]
        if chance[i] > best_weight:
            best, best_weight = i, chance[i]
    return best


@njit(nogil=True, cache=True)
def snap_to_corners(
    sample_m: F32,
    sample_weight: F32,
    sample_curve: I32,
    samples: int,
    snap_m: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
    node_m: F32,
    node_curve: I32,
    linked: U8,
    nodes: int,
) -> None:
    """Moves each node to the sample of highest weight within `snap_m` of it, if its connections stay on edges.

    So a node that happened to be put beside a corner does not cut it, and two frames put it in the same place.
    """
    old_m = np.zeros(3, np.float32)
    for a in range(nodes):
        best, best_weight, own, own_m = -1, 0.0, 0.0, 1e9
        for i in range(samples):
            if sample_curve[i] != node_curve[a]:
                continue
            distance = separation(sample_m, i, node_m, a)
            if distance < own_m:
                own, own_m = sample_weight[i], distance
            if distance < snap_m and sample_weight[i] > best_weight:
                best, best_weight = i, sample_weight[i]
        if best < 0 or best_weight < 1.2 * own:
            continue
        old_m[:] = node_m[a]
        node_m[a] = sample_m[best]
        for b in range(nodes):
            crowded = b != a and separation(node_m, a, node_m, b) < snap_m
            if crowded or (
                linked[a, b] == 1 and not is_supported(node_m, a, b, lens, stride, reach_m, step_m, edge_m, edge_at)
            ):
                node_m[a] = old_m
                break


@njit(nogil=True, cache=True)
def grow(
    sample_m: F32,
    sample_weight: F32,
    sample_curve: I32,
    samples: int,
    min_length_m: F64,
    max_length_m: F64,
    per_node: F64,
    beta: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
    nearest_m: F32,
    seen_m: F32,
    chance: F32,
    node_m: F32,
    node_curve: I32,
    linked: U8,
) -> int:
    """Simplified FastGNG, steps 2-7; returns the number of nodes.

    The paper draws a sample at random and takes it with probability P_node. Here the sample with the highest
    P_node is taken, which is the same preference without chance: the network grows along an edge for as long as it
    goes on, and the same scene grows the same network. A connection is only made where edge points lie under it, and
    s1 and s2 are the nearest two nodes that can be connected so: the nearest of all may be across a face.
    """
    nodes = 0
    linked[:] = 0
    if samples < 2:
        return 0
    for phase in range(min_length_m.shape[0]):
        for i in range(samples):
            nearest_m[i], seen_m[i] = 1e9, -1.0
        for node in range(nodes):
            _note_node(sample_m, samples, node_m, node, nearest_m)
        for _ in range(math.ceil(samples / per_node[phase]) + (2 if phase == 0 else 0)):
            if nodes == node_m.shape[0]:
                break
            v = _best_sample(
                sample_weight,
                samples,
                nearest_m,
                seen_m,
                chance,
                min_length_m[phase],
                max_length_m[phase],
                beta,
            )
            if v < 0:
                break
            r = nodes
            node_m[r] = sample_m[v]
            node_curve[r] = sample_curve[v]
            nodes += 1
            _note_node(sample_m, samples, node_m, r, nearest_m)
            s1, s2 = _nearest_supported(
                node_m, node_curve, r, 1.5 * max_length_m[0], lens, stride, reach_m, step_m, edge_m, edge_at
            )
            if s1 < 0:
                continue
            set_link(linked, s1, r, 1)
            if s2 < 0:
                continue
            ds12 = separation(node_m, s1, node_m, s2)
            if separation(node_m, s1, node_m, r) < ds12 and separation(node_m, s2, node_m, r) < ds12:
                set_link(linked, s2, r, 1)
                set_link(linked, s1, s2, 0)
            elif linked[s1, s2] == 0 and is_supported(node_m, s1, s2, lens, stride, reach_m, step_m, edge_m, edge_at):
                set_link(linked, s1, s2, 1)
        limit_degree(node_m, linked, nodes, 2)
        nodes = remove_isolated(node_m, node_curve, linked, nodes)
        snap_to_corners(
            sample_m,
            sample_weight,
            sample_curve,
            samples,
            min_length_m[min_length_m.shape[0] - 1],
            lens,
            stride,
            reach_m,
            step_m,
            edge_m,
            edge_at,
            node_m,
            node_curve,
            linked,
            nodes,
        )
    return nodes
