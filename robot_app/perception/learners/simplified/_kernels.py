"""Kernels of simplified FastGNG (steps 2-7); other arguments as in `network._kernels`.

The samples stand in blocks of LANES by falling weight, in rows, so that a block is computed at once:
point: (B, 3, LANES) float32, x, y and z, m. place: (B, 3, LANES) float32, the same as the network learns it: apart from
other curves, and the larger the finer its curve is to be drawn; node_place: (N, 3) float32, that of the nodes.
weight: (B, LANES) float32, 0 where there is none. curve: (B, LANES) int32. bound: (B + 1,) float32, no later sample
weighs more. near: (B, LANES) float32, dS1² (eq 13), m². chance: (B, LANES) float32, P_node (eq 12) times weight.
top: (B,) float32, the highest chance of a block, and seen: (B,) int32, of how many nodes `near` knows, -1 before the
first look.
"""

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

# Handing many arrays over costs more than what the helpers do with them (they are counted, atomically, at each call):
# those with one caller are inlined.

LANES = 32
BUCKETS = 256
CANDIDATES = 8  # of the older nodes, for a connection to a new one
FAR = 1e18  # m²


@njit(nogil=True, cache=True, inline="always")
def node_chances(near: F32, weight: F32, b: int, min_m: float, max_m: float, beta: float, chance: F32) -> None:
    """P_node (eq 12) times weight for each sample of block b; tanh by its continued fraction, right to 1e-7."""
    low, high = np.float32(min_m * min_m), np.float32(max_m * max_m)
    scale = np.float32((beta * max_m) ** 2)
    for lane in range(near.shape[1]):
        y = scale / max(near[b, lane], high)
        above = np.float32(10395.0) + y * (np.float32(1260.0) + y * np.float32(21.0))
        below = np.float32(10395.0) + y * (np.float32(4725.0) + y * (np.float32(210.0) + y))
        value = np.sqrt(y) * above / below
        value = np.float32(1.0) if near[b, lane] <= high else value
        value = np.float32(0.0) if near[b, lane] < low else value
        chance[b, lane] = value * weight[b, lane]


@njit(nogil=True, cache=True, inline="always")
def place_of(point_m: F32, i: int, axis: int, curve: int, curve_detail: F32, apart_m: float) -> float:
    """A coordinate of where the network learns point i of a curve: the same place when curves are not to lie apart."""
    place: float = point_m[i, axis]
    if apart_m > 0.0:
        place = place * curve_detail[curve] + (apart_m * curve if axis == 0 else 0.0)
    return place


@njit(nogil=True, cache=True)
def sort_samples(
    sample_m: F32,
    sample_weight: F32,
    sample_curve: I32,
    samples: int,
    curve_detail: F32,
    apart_m: float,
    starts: I32,
    point: F32,
    place: F32,
    weight: F32,
    curve: I32,
    bound: F32,
) -> int:
    """Put the samples into blocks by falling weight, equal ones in their order; returns the number of blocks.

    `curve_detail`: (K,) by how much shorter connections may be; `apart_m`: how far from each other curves are learned.
    `starts`: (BUCKETS + 1,) room to work in. Weights in one bucket keep their order, so `bound` is what counts.
    """
    heaviest = 0.0
    for i in range(samples):
        heaviest = max(heaviest, sample_weight[i])
    scale = (BUCKETS - 1) / heaviest if heaviest > 0.0 else 0.0
    starts[:] = 0
    for i in range(samples):
        starts[BUCKETS - int(sample_weight[i] * scale)] += 1
    for k in range(BUCKETS):
        starts[k + 1] += starts[k]
    for i in range(samples):
        bucket = BUCKETS - 1 - int(sample_weight[i] * scale)
        at = starts[bucket]
        starts[bucket] += 1
        b, lane = at // LANES, at % LANES
        for axis in range(3):
            point[b, axis, lane] = sample_m[i, axis]
            place[b, axis, lane] = place_of(sample_m, i, axis, sample_curve[i], curve_detail, apart_m)
        weight[b, lane] = sample_weight[i]
        curve[b, lane] = sample_curve[i]
    blocks = (samples + LANES - 1) // LANES
    for at in range(samples, blocks * LANES):
        weight[blocks - 1, at % LANES] = 0.0
        curve[blocks - 1, at % LANES] = -1
        for axis in range(3):
            place[blocks - 1, axis, at % LANES] = np.float32(0.0)
    bound[blocks] = 0.0
    for b in range(blocks - 1, -1, -1):
        bound[b] = bound[b + 1]
        for lane in range(LANES):
            bound[b] = max(bound[b], weight[b, lane])
    return blocks


@njit(nogil=True, cache=True, inline="always")
def _note_one(place: F32, b: int, node_place: F32, a: int, near: F32) -> None:
    """Keep dS1² of block b up to date with node a.

    The number of lanes is read from the array: a loop of a length that the compiler knows it unrolls and leaves scalar.
    """
    x, y, z = node_place[a, 0], node_place[a, 1], node_place[a, 2]
    for lane in range(near.shape[1]):
        dx, dy, dz = place[b, 0, lane] - x, place[b, 1, lane] - y, place[b, 2, lane] - z
        near[b, lane] = min(near[b, lane], dx * dx + dy * dy + dz * dz)


@njit(nogil=True, cache=True, inline="always")
def _note_four(place: F32, b: int, node_place: F32, a: int, near: F32) -> None:
    """The same for the nodes a to a + 3 at once: a sample is read once for the four."""
    x0, y0, z0 = node_place[a, 0], node_place[a, 1], node_place[a, 2]
    x1, y1, z1 = node_place[a + 1, 0], node_place[a + 1, 1], node_place[a + 1, 2]
    x2, y2, z2 = node_place[a + 2, 0], node_place[a + 2, 1], node_place[a + 2, 2]
    x3, y3, z3 = node_place[a + 3, 0], node_place[a + 3, 1], node_place[a + 3, 2]
    for lane in range(near.shape[1]):
        x, y, z = place[b, 0, lane], place[b, 1, lane], place[b, 2, lane]
        u0, v0, w0, u1, v1, w1 = x - x0, y - y0, z - z0, x - x1, y - y1, z - z1
        u2, v2, w2, u3, v3, w3 = x - x2, y - y2, z - z2, x - x3, y - y3, z - z3
        first = min(u0 * u0 + v0 * v0 + w0 * w0, u1 * u1 + v1 * v1 + w1 * w1)
        last = min(u2 * u2 + v2 * v2 + w2 * w2, u3 * u3 + v3 * v3 + w3 * w3)
        near[b, lane] = min(near[b, lane], first, last)


@njit(nogil=True, cache=True, inline="always")
def _look_again(
    place: F32,
    weight: F32,
    b: int,
    node_place: F32,
    seen: int,
    nodes: int,
    min_m: float,
    max_m: float,
    beta: float,
    near: F32,
    before: F32,
    chance: F32,
    top: float,
) -> float:
    """Bring block b up to date, which knows the first `seen` nodes, -1 for nothing at all; returns its highest chance,
    which was `top`."""
    lanes = near.shape[1]
    for lane in range(lanes):
        before[lane] = near[b, lane]
    node = max(seen, 0)
    while node + 4 <= nodes:
        _note_four(place, b, node_place, node, near)
        node += 4
    while node < nodes:
        _note_one(place, b, node_place, node, near)
        node += 1
    changed = seen < 0
    for lane in range(lanes):
        changed |= near[b, lane] != before[lane]
    if not changed:
        return top
    node_chances(near, weight, b, min_m, max_m, beta, chance)
    top = 0.0
    for lane in range(lanes):
        top = max(top, chance[b, lane])
    return top


@njit(nogil=True, cache=True, inline="always")
def best_sample(
    place: F32,
    weight: F32,
    bound: F32,
    blocks: int,
    node_place: F32,
    nodes: int,
    min_m: float,
    max_m: float,
    beta: float,
    near: F32,
    square: F32,
    chance: F32,
    top: F32,
    seen: I32,
) -> int:
    """The sample with the highest P_node times weight; -1 when none may be added.

    P_node is 1 at most: blocks whose weights are below the best so far need not be looked at, nor those where no
    sample had a chance, for within a phase none comes back.
    """
    best, best_chance = -1, 0.0
    for b in range(blocks):
        if bound[b] <= best_chance:
            break
        if seen[b] >= 0 and top[b] == 0.0:
            continue
        if seen[b] < nodes:
            top[b] = _look_again(
                place, weight, b, node_place, seen[b], nodes, min_m, max_m, beta, near, square, chance, top[b]
            )
            seen[b] = nodes
        if top[b] > best_chance:
            best_chance = top[b]
            lane = 0
            while chance[b, lane] != top[b]:
                lane += 1
            best = b * LANES + lane
    return best


@njit(nogil=True, cache=True)
def limit_degree(node_m: F32, linked: U8, nodes: int, most: int, pair: I32, length_m: F32, degrees: I32) -> None:
    """Step 6: while a node has more than `most` connections, the longest one of such a node goes.

    What is no such connection does not become one, so all are looked at once, the longest first.
    `pair`: (M, 2), `length_m`: (M,), `degrees`: (N,) room to work in; what finds no room in it goes at once.
    """
    for a in range(nodes):
        degrees[a] = degree(linked, nodes, a)
    count = 0
    for a in range(nodes):
        if degrees[a] <= most:
            continue
        for b in range(nodes):
            if linked[a, b] == 0 or (b < a and degrees[b] > most):
                continue
            if count == length_m.shape[0]:
                set_link(linked, a, b, 0)
                degrees[a] -= 1
                degrees[b] -= 1
                continue
            gap_m = separation(node_m, a, node_m, b)
            k = count
            while k > 0 and length_m[k - 1] < gap_m:
                length_m[k], pair[k, 0], pair[k, 1] = length_m[k - 1], pair[k - 1, 0], pair[k - 1, 1]
                k -= 1
            length_m[k], pair[k, 0], pair[k, 1] = gap_m, a, b
            count += 1
    for k in range(count):
        a, b = pair[k, 0], pair[k, 1]
        if degrees[a] > most or degrees[b] > most:
            set_link(linked, a, b, 0)
            degrees[a] -= 1
            degrees[b] -= 1


@njit(nogil=True, cache=True, inline="always")
def nearest_two(
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
    gap: F32,
    other: I32,
    evidence: bool,
) -> tuple[int, int]:
    """s1 and s2 (eqs 13 and 18), the nearest two of the older nodes; -1 for none.

    With `evidence` those that edge points lead to from node r, among the nearest CANDIDATES on its own edge curve.
    `gap`, `other`: (CANDIDATES,) room for them.
    """
    count = 0
    furthest = np.float32(limit_m * limit_m) if evidence else np.float32(FAR)
    x, y, z = node_m[r, 0], node_m[r, 1], node_m[r, 2]
    for k in range(r):
        dx, dy, dz = node_m[k, 0] - x, node_m[k, 1] - y, node_m[k, 2] - z
        square = dx * dx + dy * dy + dz * dz
        if square >= furthest or (evidence and node_curve[k] != node_curve[r]):
            continue
        slot = min(count, CANDIDATES - 1)
        while slot > 0 and gap[slot - 1] > square:
            gap[slot], other[slot] = gap[slot - 1], other[slot - 1]
            slot -= 1
        gap[slot], other[slot] = square, k
        count = min(count + 1, CANDIDATES)
        if count == CANDIDATES:
            furthest = gap[CANDIDATES - 1]
    s1 = -1
    for slot in range(count):
        if not evidence or is_supported(node_m, other[slot], r, lens, stride, reach_m, step_m, edge_m, edge_at):
            if s1 >= 0:
                return s1, other[slot]
            s1 = other[slot]
    return s1, -1


@njit(nogil=True, cache=True, inline="always")
def add_node(
    node_m: F32,
    node_curve: I32,
    linked: U8,
    r: int,
    limit_m: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
    gap: F32,
    other: I32,
    evidence: bool,
) -> None:
    """Step 5 (eqs 19-22): connect node r, which is new; with `evidence` only where edge points lie."""
    s1, s2 = nearest_two(
        node_m, node_curve, r, limit_m, lens, stride, reach_m, step_m, edge_m, edge_at, gap, other, evidence
    )
    if s1 < 0:
        return
    set_link(linked, s1, r, 1)
    if s2 < 0:
        return
    ds12 = separation(node_m, s1, node_m, s2)
    if separation(node_m, s1, node_m, r) < ds12 and separation(node_m, s2, node_m, r) < ds12:
        set_link(linked, s2, r, 1)
        set_link(linked, s1, s2, 0)
    elif linked[s1, s2] == 0 and (
        not evidence or is_supported(node_m, s1, s2, lens, stride, reach_m, step_m, edge_m, edge_at)
    ):
        set_link(linked, s1, s2, 1)


@njit(nogil=True, cache=True, inline="always")
def _better_place(
    place: F32,
    weight: F32,
    curve: I32,
    bound: F32,
    node_place: F32,
    a: int,
    own_curve: int,
    own: float,
    snap_m: float,
    square: F32,
) -> int:
    """The heaviest sample within `snap_m` of node a on its curve, if it weighs 1.2 times as much; -1 otherwise."""
    best, best_weight = -1, 1.2 * own
    x, y, z = node_place[a, 0], node_place[a, 1], node_place[a, 2]
    limit = np.float32(snap_m * snap_m)
    lanes = weight.shape[1]
    for b in range(weight.shape[0]):
        if bound[b] <= best_weight:
            break
        within = False
        for lane in range(lanes):
            dx, dy, dz = place[b, 0, lane] - x, place[b, 1, lane] - y, place[b, 2, lane] - z
            square[lane] = dx * dx + dy * dy + dz * dz
            within |= square[lane] < limit
        if not within:
            continue
        for lane in range(lanes):
            if square[lane] < limit and weight[b, lane] > best_weight and curve[b, lane] == own_curve:
                best, best_weight = b * LANES + lane, weight[b, lane]
    return best


@njit(nogil=True, cache=True)
def snap_to_corners(
    point: F32,
    place: F32,
    weight: F32,
    curve: I32,
    bound: F32,
    snap_m: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
    node_m: F32,
    node_place: F32,
    node_curve: I32,
    node_weight: F32,
    linked: U8,
    nodes: int,
    square: F32,
) -> None:
    """Moves each node to the sample of highest weight within `snap_m` of it, if its connections stay on edges.

    So a node that happened to be put beside a corner does not cut it, and two frames put it in the same place.
    """
    for a in range(nodes):
        best = _better_place(place, weight, curve, bound, node_place, a, node_curve[a], node_weight[a], snap_m, square)
        if best < 0:
            continue
        x, y, z = node_m[a, 0], node_m[a, 1], node_m[a, 2]
        u, v, w = node_place[a, 0], node_place[a, 1], node_place[a, 2]
        for axis in range(3):
            node_m[a, axis] = point[best // LANES, axis, best % LANES]
            node_place[a, axis] = place[best // LANES, axis, best % LANES]
        node_weight[a], own = weight[best // LANES, best % LANES], node_weight[a]
        for b in range(nodes):
            crowded = b != a and separation(node_place, a, node_place, b) < snap_m
            if crowded or (
                linked[a, b] == 1 and not is_supported(node_m, a, b, lens, stride, reach_m, step_m, edge_m, edge_at)
            ):
                node_m[a, 0], node_m[a, 1], node_m[a, 2] = x, y, z
                node_place[a, 0], node_place[a, 1], node_place[a, 2] = u, v, w
                node_weight[a] = own
                break


# error_model="numpy" only leaves out the test for a division by zero, without which 16 samples go at once.
@njit(nogil=True, cache=True, error_model="numpy")
def grow(
    samples: int,
    blocks: int,
    curve_detail: F32,
    apart_m: float,
    point: F32,
    place: F32,
    weight: F32,
    curve: I32,
    bound: F32,
    min_length_m: F64,
    max_length_m: F64,
    per_node: F64,
    beta: float,
    evidence: bool,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
    near: F32,
    square: F32,
    chance: F32,
    top: F32,
    seen: I32,
    gap: F32,
    other: I32,
    pair: I32,
    length_m: F32,
    degrees: I32,
    node_place: F32,
    node_m: F32,
    node_curve: I32,
    node_weight: F32,
    linked: U8,
) -> int:
    """Steps 2-7 over what `sort_samples` made; returns the number of nodes.

    The paper draws a sample at random and takes it with probability P_node. Here the sample with the highest
    P_node times weight is taken, which is the same preference without chance: the network grows along an edge for
    as long as it goes on, and the same scene grows the same network.

    With `evidence` a connection is only made where edge points lie under it, which the paper asks at the end (3.2.5):
    s1 and s2 are the nearest two nodes that can be connected so, for the nearest of all may be across a face. And the
    nodes beside a corner are moved into it. Without, the steps are those that the paper prints.
    """
    nodes = 0
    linked[:] = 0
    if samples < 2:
        return 0
    for phase in range(min_length_m.shape[0]):
        near[:blocks] = FAR
        seen[:blocks] = -1
        for _ in range(math.ceil(samples / per_node[phase]) + (2 if phase == 0 else 0)):
            if nodes == node_m.shape[0]:
                break
            low_m, high_m = min_length_m[phase], max_length_m[phase]
            v = best_sample(
                place, weight, bound, blocks, node_place, nodes, low_m, high_m, beta, near, square, chance, top, seen
            )
            if v < 0:
                break
            for axis in range(3):
                node_m[nodes, axis] = point[v // LANES, axis, v % LANES]
                node_place[nodes, axis] = place[v // LANES, axis, v % LANES]
            node_curve[nodes] = curve[v // LANES, v % LANES]
            node_weight[nodes] = weight[v // LANES, v % LANES]
            nodes += 1
            limit_m = 1.5 * max_length_m[0]
            add_node(
                node_m,
                node_curve,
                linked,
                nodes - 1,
                limit_m,
                lens,
                stride,
                reach_m,
                step_m,
                edge_m,
                edge_at,
                gap,
                other,
                evidence,
            )
        limit_degree(node_m, linked, nodes, 2, pair, length_m, degrees)
        nodes = remove_isolated(node_m, node_curve, node_weight, linked, nodes)
        for a in range(nodes):
            for axis in range(3):
                node_place[a, axis] = place_of(node_m, a, axis, node_curve[a], curve_detail, apart_m)
        if evidence:
            snap_to_corners(
                point,
                place,
                weight,
                curve,
                bound,
                min_length_m[min_length_m.shape[0] - 1],
                lens,
                stride,
                reach_m,
                step_m,
                edge_m,
                edge_at,
                node_m,
                node_place,
                node_curve,
                node_weight,
                linked,
                nodes,
                square,
            )
    return nodes
