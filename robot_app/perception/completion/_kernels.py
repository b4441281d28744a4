"""Kernels that draw the stretches of a curve that no connection follows; arguments as in `refinement._kernels`, and

sample_m: (S, 3) float32, the samples, those of a curve one after the other; sample_curve: (S,) int32, its number.
curve_closed: (K,) uint8, 1 where the last sample of a curve is followed by the first.
stand: (N,) int32, the sample that each node stands on or next to. covered: (S,) uint8, 1 where a connection lies along.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robot_app.perception._kernels import UNCOUNTED
from robot_app.perception.network._kernels import is_supported, separation
from robot_app.perception.refinement._kernels import are_connected, connect, disconnect

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]

DEEPEST = 12  # so often a stretch is halved at the most


@njit(nogil=True, cache=True, **UNCOUNTED)
def _square_off(sample_m: F32, k: int, from_m: F32, a: int, to_m: F32, b: int) -> float:
    """Distance of sample k from the line between two places, squared."""
    along, length, px, py, pz = 0.0, 0.0, 0.0, 0.0, 0.0
    dx, dy, dz = to_m[b, 0] - from_m[a, 0], to_m[b, 1] - from_m[a, 1], to_m[b, 2] - from_m[a, 2]
    px, py, pz = sample_m[k, 0] - from_m[a, 0], sample_m[k, 1] - from_m[a, 1], sample_m[k, 2] - from_m[a, 2]
    length = dx * dx + dy * dy + dz * dz
    along = px * dx + py * dy + pz * dz
    t = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    square: float = (px - t * dx) ** 2 + (py - t * dy) ** 2 + (pz - t * dz) ** 2
    return square


@njit(nogil=True, cache=True, **UNCOUNTED)
def find_stands(
    node_m: F32, node_curve: I32, nodes: int, curve: int, sample_m: F32, first: int, last: int, stand: I32, member: I32
) -> int:
    """`member`: (N,) the nodes of a curve in the order of their `stand` on it; returns how many."""
    count = 0
    for a in range(nodes):
        if node_curve[a] != curve:
            continue
        best_m = math.inf
        for k in range(first, last):
            gap_m = separation(sample_m, k, node_m, a)
            if gap_m < best_m:
                best_m, stand[a] = gap_m, k
        slot = count
        while slot > 0 and stand[member[slot - 1]] > stand[a]:
            member[slot] = member[slot - 1]
            slot -= 1
        member[slot] = a
        count += 1
    return count


@njit(nogil=True, cache=True, **UNCOUNTED)
def mark_covered(
    node_m: F32,
    beside: I32,
    degree: I32,
    member: I32,
    count: int,
    stand: I32,
    sample_m: F32,
    first: int,
    last: int,
    closed: int,
    slack: float,
    covered: U8,
) -> None:
    """`covered` for the samples first to last, which are those of one curve; `slack`: for each metre of depth."""
    for k in range(first, last):
        covered[k] = 0
    for slot in range(count):
        a = member[slot]
        for side in range(degree[a]):
            b = beside[a, side]
            if stand[b] < stand[a]:
                continue
            low, high = (first, last) if closed == 1 else (stand[a], stand[b] + 1)
            for k in range(low, high):
                if covered[k] == 0:
                    square = _square_off(sample_m, k, node_m, a, node_m, b)
                    covered[k] = square <= (slack * sample_m[k, 2]) ** 2


@njit(nogil=True, cache=True, **UNCOUNTED)
def _put_node(
    sample_m: F32,
    k: int,
    curve: int,
    node_m: F32,
    node_curve: I32,
    node_weight: F32,
    degree: I32,
    stand: I32,
    nodes: int,
) -> int:
    """A new node on sample k while there is room; returns the new count."""
    if nodes < node_m.shape[0]:
        for axis in range(3):
            node_m[nodes, axis] = sample_m[k, axis]
        node_curve[nodes], node_weight[nodes], degree[nodes], stand[nodes] = curve, 1.0, 0, k
        nodes += 1
    return nodes


@njit(nogil=True, cache=True, **UNCOUNTED)
def draw_stretch(
    sample_m: F32,
    a: int,
    b: int,
    slack: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
    node_m: F32,
    node_curve: I32,
    node_weight: F32,
    beside: I32,
    degree: I32,
    stand: I32,
    nodes: int,
    pile: I32,
) -> int:
    """Connects nodes a and b along the samples between them, with a node at each that is too far from a straight line
    (Douglas and Peucker 1973); returns the new count of nodes. `pile`: (DEEPEST + 1,) the nodes still to come to."""
    pile[0], height = b, 1
    while height > 0:
        b = pile[height - 1]
        worst, most = -1, 1.0
        for k in range(stand[a] + 1, stand[b]):
            off = _square_off(sample_m, k, node_m, a, node_m, b) / (slack * sample_m[k, 2]) ** 2
            if off > most:
                worst, most = k, off
        if worst >= 0 and height <= DEEPEST:
            more = _put_node(sample_m, worst, node_curve[a], node_m, node_curve, node_weight, degree, stand, nodes)
            if more > nodes:
                pile[height] = nodes
                height += 1
                nodes = more
                continue
        if not are_connected(beside, degree, a, b) and is_supported(
            node_m, a, b, lens, stride, reach_m, step_m, edge_m, edge_at
        ):
            connect(beside, degree, a, b)
        a = b
        height -= 1
    return nodes


@njit(nogil=True, cache=True, **UNCOUNTED)
def _node_at(member: I32, count: int, stand: I32, k: int, way: int) -> int:
    """The node of the curve nearest to sample k, not after it (`way` -1) or not before it (1); -1 for none."""
    found = -1
    for slot in range(count):
        at = stand[member[slot]]
        if (way < 0 and at <= k) or (way > 0 and at >= k and found < 0):
            found = member[slot]
    return found


@njit(nogil=True, cache=True, **UNCOUNTED)
def _length_m(sample_m: F32, first: int, last: int) -> float:
    length_m = 0.0
    for k in range(first, last):
        length_m += separation(sample_m, k, sample_m, k + 1)
    return length_m


@njit(nogil=True, cache=True, **UNCOUNTED)
def complete(
    sample_m: F32,
    sample_curve: I32,
    samples: int,
    curve_closed: U8,
    curve_detail: F32,
    slack: float,
    min_length_m: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
    node_m: F32,
    node_curve: I32,
    node_weight: F32,
    beside: I32,
    degree: I32,
    nodes: int,
    stand: I32,
    member: I32,
    covered: U8,
    pile: I32,
) -> int:
    """Draws each stretch of a curve that no connection follows within `slack` for each metre of depth, if it is longer
    than `min_length_m`, less where the curve is drawn finer; returns how many nodes there are then."""
    first = 0
    while first < samples:
        curve, last = sample_curve[first], first
        while last < samples and sample_curve[last] == curve:
            last += 1
        count = find_stands(node_m, node_curve, nodes, curve, sample_m, first, last, stand, member)
        mark_covered(
            node_m, beside, degree, member, count, stand, sample_m, first, last, curve_closed[curve], slack, covered
        )
        least_m = min_length_m / curve_detail[curve]
        k = first
        while k < last:
            begin = k
            while k < last and covered[k] == 0:
                k += 1
            low, high = max(begin - 1, first), min(k, last - 1)
            if k > begin and count > 0 and _length_m(sample_m, low, high) >= least_m:
                a, b = _node_at(member, count, stand, begin, -1), _node_at(member, count, stand, k - 1, 1)
                if a < 0 or b < 0:
                    end = first if a < 0 else last - 1
                    more = _put_node(sample_m, end, curve, node_m, node_curve, node_weight, degree, stand, nodes)
                    if more > nodes:
                        a, b = (nodes, b) if a < 0 else (a, nodes)
                        nodes = more
                if a >= 0 and b >= 0:
                    disconnect(beside, degree, a, b)
                    nodes = draw_stretch(
                        sample_m, a, b, slack, lens, stride, reach_m, step_m, edge_m, edge_at,
                        node_m, node_curve, node_weight, beside, degree, stand, nodes, pile,
                    )  # fmt: skip
            k += 1
        first = last
    return nodes
