"""Kernels on a network of nodes and connections: its links, its angles, and whether edge points lie under it.

Shared arguments are those of `perception._kernels`, and
node_m: (N, 3) float32, optical frame. node_curve: (N,) int32, the edge curve that a node was taken from.
node_weight: (N,) float32, the weight of the sample that it was taken from.
linked: (N, N) uint8, symmetric, 1 where two nodes are connected.
They have room for `max_nodes`; the first `nodes` are in use.
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


@njit(nogil=True, cache=True, **UNCOUNTED)
def separation(a_m: F32, a: int, b_m: F32, b: int) -> float:
    dx, dy, dz = a_m[a, 0] - b_m[b, 0], a_m[a, 1] - b_m[b, 1], a_m[a, 2] - b_m[b, 2]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def near_edge(
    x: float,
    y: float,
    z: float,
    row_lens: float,
    column_lens: float,
    row_middle: float,
    column_middle: float,
    reach_m: float,
    edge_m: F32,
    edge_at: I32,
) -> bool:
    """Whether an edge point lies within `reach_m` of a point on each axis; looks in the cells around its image.

    Across the line of sight the reach is no more than 2.5 cells: there the camera is as good as its pixels.
    `row_lens`, `column_lens`: the focal lengths, `row_middle`, `column_middle`: the optical axis, in cells.
    """
    rows, columns = edge_at.shape
    if z < 0.05:
        return False
    row_scale, column_scale = row_lens / z, column_lens / z  # cells a metre
    side_m = min(reach_m, 2.5 * z / min(row_lens, column_lens))
    ci = math.floor(y * row_scale + row_middle)
    cj = math.floor(x * column_scale + column_middle)
    ri, rj = min(int(side_m * row_scale) + 1, 16), min(int(side_m * column_scale) + 1, 16)
    for step in range(2 * ri + 1):  # the middle row first, and the middle of each row
        k = ci + ((step + 1) // 2 if step % 2 == 1 else -(step // 2))
        if k < 0 or k >= rows:
            continue
        for turn in range(2 * rj + 1):
            m = cj + ((turn + 1) // 2 if turn % 2 == 1 else -(turn // 2))
            if m < 0 or m >= columns:
                continue
            index = edge_at[k, m]
            if (
                index >= 0
                and abs(edge_m[index, 0] - x) <= side_m
                and abs(edge_m[index, 1] - y) <= side_m
                and abs(edge_m[index, 2] - z) <= reach_m
            ):
                return True
    return False


@njit(nogil=True, cache=True, **UNCOUNTED)
def is_supported(
    node_m: F32, a: int, b: int, lens: F64, stride: int, reach_m: float, step_m: float, edge_m: F32, edge_at: I32
) -> bool:
    """Whether edge points lie all along a connection, at points every `step_m` (eqs 31-33; see `Refiner`)."""
    x, y, z = node_m[a, 0], node_m[a, 1], node_m[a, 2]
    dx, dy, dz = node_m[b, 0] - x, node_m[b, 1] - y, node_m[b, 2] - z
    row_lens, column_lens, row_middle, column_middle = (
        lens[1] / stride,
        lens[0] / stride,
        lens[3] / stride,
        lens[2] / stride,
    )
    parts = max(2, math.ceil(math.sqrt(dx * dx + dy * dy + dz * dz) / step_m))
    for part in range(1, parts):
        t = part / parts
        if not near_edge(
            x + t * dx,
            y + t * dy,
            z + t * dz,
            row_lens,
            column_lens,
            row_middle,
            column_middle,
            reach_m,
            edge_m,
            edge_at,
        ):
            return False
    return True


@njit(nogil=True, cache=True, **UNCOUNTED)
def degree(linked: U8, nodes: int, a: int) -> int:
    total = 0
    for b in range(nodes):
        total += linked[a, b]
    return total


@njit(nogil=True, cache=True, **UNCOUNTED)
def set_link(linked: U8, a: int, b: int, value: int) -> None:
    linked[a, b] = value
    linked[b, a] = value


@njit(nogil=True, cache=True, **UNCOUNTED)
def remove_isolated(node_m: F32, node_curve: I32, node_weight: F32, linked: U8, nodes: int) -> int:
    """Step 7: nodes without a connection go; the others keep their order. Returns how many are left."""
    kept = 0
    for a in range(nodes):
        if degree(linked, nodes, a) == 0:
            continue
        if kept != a:
            node_curve[kept], node_weight[kept] = node_curve[a], node_weight[a]
            for axis in range(3):
                node_m[kept, axis] = node_m[a, axis]
            for b in range(nodes):
                if linked[a, b] == 1:
                    set_link(linked, a, b, 0)
                    set_link(linked, kept, b, 1)
        kept += 1
    return kept


@njit(nogil=True, cache=True, **UNCOUNTED)
def angle_at(node_m: F32, a: int, v: int, b: int) -> float:
    """θ (eq 26): the angle at node v between the ways to a and to b, rad; π is straight."""
    ax, ay, az = node_m[a, 0] - node_m[v, 0], node_m[a, 1] - node_m[v, 1], node_m[a, 2] - node_m[v, 2]
    bx, by, bz = node_m[b, 0] - node_m[v, 0], node_m[b, 1] - node_m[v, 1], node_m[b, 2] - node_m[v, 2]
    norm = math.sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    if norm == 0.0:
        return 0.0
    return math.acos(min(1.0, max(-1.0, (ax * bx + ay * by + az * bz) / norm)))


@njit(nogil=True, cache=True, **UNCOUNTED)
def list_connections(linked: U8, nodes: int, pairs: I32) -> int:
    """`pairs`: (M, 2) room for the connections, lower node first; returns how many there are."""
    count = 0
    for a in range(nodes):
        for b in range(a + 1, nodes):
            if linked[a, b] == 1 and count < pairs.shape[0]:
                pairs[count, 0], pairs[count, 1] = a, b
                count += 1
    return count


@njit(nogil=True, cache=True, **UNCOUNTED)
def label_clusters(pairs: I32, cluster_of: I32) -> None:
    """`cluster_of`: (N,) the connected component of each node, numbered from 0 in the order of their first nodes.

    `pairs`: (M, 2) the connections.
    """
    for a in range(cluster_of.size):
        cluster_of[a] = a
    for k in range(pairs.shape[0]):
        a, b = pairs[k, 0], pairs[k, 1]
        while cluster_of[a] != a:
            a = cluster_of[a]
        while cluster_of[b] != b:
            b = cluster_of[b]
        cluster_of[max(a, b)] = min(a, b)
    count = 0
    for a in range(cluster_of.size):
        if cluster_of[a] == a:
            cluster_of[a] = count
            count += 1
        else:
            cluster_of[a] = cluster_of[cluster_of[a]]
