"""Kernels of simplified FastGNG (steps 2-7); other arguments as in `network._kernels`.

The samples stand in blocks of LANES in their order, which is along the curves, so that a block is computed at once and
has its samples near each other. It is looked at again only when a node comes that may be the nearest one of a sample.
place: (B, 3, LANES) float32, where the network learns a sample: apart from other curves, and the larger the finer its
curve is to be drawn; node_place: (N, 3) float32, that of the nodes. box: (6, B) float32, the least and the greatest
coordinates of a block's places. weight: (B, LANES) float32, 0 where there is none, and heaviest: (B,) float32.
near: (B, LANES) float32, dS1² (eq 13), m², and far: (B,) float32, the largest. chance: (B, LANES) float32, P_node
(eq 12) times weight, and top: (B,) float32, the highest. reached, hit, stale: (B,) uint8, the blocks that a node may be
the nearest for, those whose chances have changed, and those that the next phase has to look at anew.
degrees: (N,) int32, how many connections a node has. node_axis: (3, N) float32, node_m by rows.
node_sample: (N,) int32, the sample that a node stands on. The samples of a curve follow one another.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robot_app.perception._kernels import UNCOUNTED
from robot_app.perception.network._kernels import is_supported, separation

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]

LANES = 16
CANDIDATES = 8  # of the older nodes, for a connection to a new one
FAR = 1e18  # m²


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
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


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def lay_out_samples(
    sample_m: F32,
    sample_weight: F32,
    sample_curve: I32,
    samples: int,
    curve_detail: F32,
    apart_m: float,
    place: F32,
    box: F32,
    weight: F32,
    heaviest: F32,
) -> int:
    """Fill the blocks, the last one up with copies that weigh nothing; returns how many there are.

    `curve_detail`: (K,) by how much shorter connections may be; `apart_m`: how far from each other curves are learned:
    in rows of 8 to each side, so that no coordinate is so great that float32 would round it by more than a tenth of a
    millimetre.
    """
    blocks = (samples + LANES - 1) // LANES
    rank = 0
    for at in range(blocks * LANES):
        i = min(at, samples - 1)
        b, lane, curve = at // LANES, at % LANES, sample_curve[i]
        rank += i > 0 and curve != sample_curve[i - 1]
        # Without `apart_m` curves are learned where they are, all with the same lengths.
        detail = curve_detail[curve] if apart_m > 0.0 else np.float32(1.0)
        place[b, 0, lane] = sample_m[i, 0] * detail + apart_m * (rank % 8)
        place[b, 1, lane] = sample_m[i, 1] * detail + apart_m * (rank // 8 % 8)
        place[b, 2, lane] = sample_m[i, 2] * detail + apart_m * (rank // 64)
        weight[b, lane] = sample_weight[i] if at < samples else np.float32(0.0)
    for b in range(blocks):
        heaviest[b] = 0.0
        for lane in range(weight.shape[1]):
            heaviest[b] = max(heaviest[b], weight[b, lane])
        for axis in range(3):
            low = high = place[b, axis, 0]
            for lane in range(weight.shape[1]):
                low, high = min(low, place[b, axis, lane]), max(high, place[b, axis, lane])
            box[axis, b], box[3 + axis, b] = low, high
    return blocks


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def mark_reached(box: F32, blocks: int, x: float, y: float, z: float, reach: F32, reached: U8) -> None:
    """`reached`: 1 for the blocks whose box is no further from a place than the root of `reach`, (B,) float32, m².

    The box is never further than one of its samples by the same arithmetic: rounding keeps the order.
    """
    zero = np.float32(0.0)
    for b in range(blocks):
        dx, dy, dz = (
            max(box[0, b] - x, x - box[3, b]),
            max(box[1, b] - y, y - box[4, b]),
            max(box[2, b] - z, z - box[5, b]),
        )
        dx, dy, dz = max(dx, zero), max(dy, zero), max(dz, zero)
        reached[b] = np.uint8(dx * dx + dy * dy + dz * dz <= reach[b])


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _look_anew(place: F32, b: int, node_place: F32, nodes: int, near: F32, far: F32) -> None:
    """dS1² of block b, from all nodes, of which four are taken at once.

    The number of lanes is read from the array: a loop of a length that the compiler knows it unrolls and leaves scalar.
    """
    lanes = near.shape[1]
    for lane in range(lanes):
        near[b, lane] = FAR
    a = 0
    while a + 4 <= nodes:
        x0, y0, z0 = node_place[a, 0], node_place[a, 1], node_place[a, 2]
        x1, y1, z1 = node_place[a + 1, 0], node_place[a + 1, 1], node_place[a + 1, 2]
        x2, y2, z2 = node_place[a + 2, 0], node_place[a + 2, 1], node_place[a + 2, 2]
        x3, y3, z3 = node_place[a + 3, 0], node_place[a + 3, 1], node_place[a + 3, 2]
        for lane in range(lanes):
            x, y, z = place[b, 0, lane], place[b, 1, lane], place[b, 2, lane]
            u0, v0, w0, u1, v1, w1 = x - x0, y - y0, z - z0, x - x1, y - y1, z - z1
            u2, v2, w2, u3, v3, w3 = x - x2, y - y2, z - z2, x - x3, y - y3, z - z3
            first = min(u0 * u0 + v0 * v0 + w0 * w0, u1 * u1 + v1 * v1 + w1 * w1)
            last = min(u2 * u2 + v2 * v2 + w2 * w2, u3 * u3 + v3 * v3 + w3 * w3)
            near[b, lane] = min(near[b, lane], first, last)
        a += 4
    while a < nodes:
        x, y, z = node_place[a, 0], node_place[a, 1], node_place[a, 2]
        for lane in range(lanes):
            dx, dy, dz = place[b, 0, lane] - x, place[b, 1, lane] - y, place[b, 2, lane] - z
            near[b, lane] = min(near[b, lane], dx * dx + dy * dy + dz * dz)
        a += 1
    furthest = near[b, 0]
    for lane in range(lanes):
        furthest = max(furthest, near[b, lane])
    far[b] = furthest


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _note_node(place: F32, b: int, x: float, y: float, z: float, near: F32, far: F32) -> bool:
    """Keep dS1² of block b up to date with a new node; returns whether anything changed."""
    changed, furthest = False, np.float32(0.0)
    for lane in range(near.shape[1]):
        dx, dy, dz = place[b, 0, lane] - x, place[b, 1, lane] - y, place[b, 2, lane] - z
        square, before = dx * dx + dy * dy + dz * dz, near[b, lane]
        changed |= square < before
        near[b, lane] = min(before, square)
        furthest = max(furthest, near[b, lane])
    far[b] = furthest
    return changed


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def best_sample(
    near: F32,
    weight: F32,
    heaviest: F32,
    min_m: float,
    max_m: float,
    beta: float,
    chance: F32,
    top: F32,
    hit: U8,
    blocks: int,
) -> int:
    """The sample with the highest P_node times weight, the first of several; -1 when none may be added.

    P_node is 1 at most: of the blocks that are `hit`, whose `top` is 0, only those are worked out that weigh enough.
    """
    best_chance = np.float32(0.0)
    for b in range(blocks):
        best_chance = max(best_chance, top[b])
    for b in range(blocks):
        if hit[b] == 1 and heaviest[b] >= best_chance:
            node_chances(near, weight, b, min_m, max_m, beta, chance)
            for lane in range(chance.shape[1]):
                top[b] = max(top[b], chance[b, lane])
            hit[b] = 0
            best_chance = max(best_chance, top[b])
    if best_chance == 0.0:
        return -1
    best, lane = 0, 0
    while top[best] != best_chance:
        best += 1
    while chance[best, lane] != best_chance:
        lane += 1
    return best * LANES + lane


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _set_link(linked: U8, degrees: I32, a: int, b: int, value: int) -> None:
    if linked[a, b] != value:
        linked[a, b] = linked[b, a] = value
        degrees[a] += 2 * value - 1
        degrees[b] += 2 * value - 1


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def limit_degree(node_m: F32, linked: U8, nodes: int, most: int, pair: I32, length_m: F32, degrees: I32) -> None:
    """Step 6: while a node has more than `most` connections, the longest one of such a node goes.

    What is no such connection does not become one, so all are looked at once, the longest first.
    `pair`: (M, 2), `length_m`: (M,) room to work in; what finds no room in it goes at once.
    """
    count = 0
    for a in range(nodes):
        if degrees[a] <= most:
            continue
        for b in range(nodes):
            if linked[a, b] == 0 or (b < a and degrees[b] > most):
                continue
            if count == length_m.shape[0]:
                _set_link(linked, degrees, a, b, 0)
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
            _set_link(linked, degrees, a, b, 0)


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def drop_isolated(
    node_m: F32,
    node_place: F32,
    node_curve: I32,
    node_weight: F32,
    node_sample: I32,
    linked: U8,
    degrees: I32,
    nodes: int,
) -> int:
    """Step 7: nodes without a connection go; the others keep their order. Returns how many are left."""
    kept = 0
    for a in range(nodes):
        if degrees[a] == 0:
            continue
        if kept != a:
            node_curve[kept], node_weight[kept], node_sample[kept] = node_curve[a], node_weight[a], node_sample[a]
            for axis in range(3):
                node_m[kept, axis], node_place[kept, axis] = node_m[a, axis], node_place[a, axis]
            for b in range(nodes):
                if linked[a, b] == 1:
                    linked[a, b] = linked[b, a] = 0
                    linked[kept, b] = linked[b, kept] = 1
            degrees[kept] = degrees[a]
        kept += 1
    return kept


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def nearest_two(
    node_m: F32,
    node_axis: F32,
    node_curve: I32,
    r: int,
    limit_m: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
    square: F32,
    gap: F32,
    other: I32,
    evidence: bool,
) -> tuple[int, int]:
    """s1 and s2 (eqs 13 and 18), the nearest two of the older nodes; -1 for none.

    With `evidence` those that edge points lead to from node r, among the nearest CANDIDATES on its own edge curve.
    `gap`, `other`: (CANDIDATES,), `square`: (N,) room for them and for the squared distances.
    """
    count, most = 0, CANDIDATES if evidence else 2
    furthest = np.float32(limit_m * limit_m) if evidence else np.float32(FAR)
    x, y, z, curve = node_m[r, 0], node_m[r, 1], node_m[r, 2], node_curve[r]
    for k in range(r):
        dx, dy, dz = node_axis[0, k] - x, node_axis[1, k] - y, node_axis[2, k] - z
        square[k] = dx * dx + dy * dy + dz * dz
    for k in range(r):
        if square[k] >= furthest or (evidence and node_curve[k] != curve):
            continue
        slot = min(count, most - 1)
        while slot > 0 and gap[slot - 1] > square[k]:
            gap[slot], other[slot] = gap[slot - 1], other[slot - 1]
            slot -= 1
        gap[slot], other[slot] = square[k], k
        count = min(count + 1, most)
        if count == most:
            furthest = gap[most - 1]
    s1 = -1
    for slot in range(count):
        if not evidence or is_supported(node_m, other[slot], r, lens, stride, reach_m, step_m, edge_m, edge_at):
            if s1 >= 0:
                return s1, other[slot]
            s1 = other[slot]
    return s1, -1


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def connect_new(
    node_m: F32,
    linked: U8,
    degrees: I32,
    r: int,
    s1: int,
    s2: int,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
    evidence: bool,
) -> None:
    """Step 5 (eqs 19-22): connect node r, which is new; with `evidence` only where edge points lie."""
    degrees[r] = 0
    if s1 >= 0:
        _set_link(linked, degrees, s1, r, 1)
    if s2 >= 0:
        ds12 = separation(node_m, s1, node_m, s2)
        if separation(node_m, s1, node_m, r) < ds12 and separation(node_m, s2, node_m, r) < ds12:
            _set_link(linked, degrees, s2, r, 1)
            _set_link(linked, degrees, s1, s2, 0)
        elif linked[s1, s2] == 0 and (
            not evidence or is_supported(node_m, s1, s2, lens, stride, reach_m, step_m, edge_m, edge_at)
        ):
            _set_link(linked, degrees, s1, s2, 1)


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def _better_place(
    place: F32, weight: F32, heaviest: F32, sample_curve: I32, samples: int, own_sample: int, own: float, snap_m: float
) -> int:
    """The heaviest sample within `snap_m` of a node on its curve, if it weighs 1.2 times as much; -1 otherwise."""
    best, best_weight = -1, 1.2 * own
    limit = np.float32(snap_m * snap_m)
    b, lane, curve = own_sample // LANES, own_sample % LANES, sample_curve[own_sample]
    x, y, z = place[b, 0, lane], place[b, 1, lane], place[b, 2, lane]
    while b > 0 and sample_curve[b * LANES - 1] == curve:
        b -= 1
    while b * LANES < samples and sample_curve[max(b * LANES, own_sample)] == curve:
        if heaviest[b] > best_weight:
            for i in range(b * LANES, min(b * LANES + LANES, samples)):
                lane = i - b * LANES
                if weight[b, lane] > best_weight and sample_curve[i] == curve:
                    dx, dy, dz = place[b, 0, lane] - x, place[b, 1, lane] - y, place[b, 2, lane] - z
                    if dx * dx + dy * dy + dz * dz < limit:
                        best, best_weight = i, weight[b, lane]
        b += 1
    return best


@njit(nogil=True, cache=True, inline="always", **UNCOUNTED)
def snap_to_corners(
    sample_m: F32,
    sample_curve: I32,
    place: F32,
    box: F32,
    weight: F32,
    heaviest: F32,
    samples: int,
    blocks: int,
    snap_m: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
    node_m: F32,
    node_place: F32,
    node_weight: F32,
    node_sample: I32,
    linked: U8,
    nodes: int,
    far: F32,
    reached: U8,
    stale: U8,
) -> None:
    """Moves each node to the sample of highest weight within `snap_m` of it, if its connections stay on edges.

    So a node that happened to be put beside a corner does not cut it, and two frames put it in the same place.
    """
    for a in range(nodes):
        best = _better_place(place, weight, heaviest, sample_curve, samples, node_sample[a], node_weight[a], snap_m)
        if best < 0:
            continue
        u, v, w = node_place[a, 0], node_place[a, 1], node_place[a, 2]
        x, y, z = node_m[a, 0], node_m[a, 1], node_m[a, 2]
        for axis in range(3):
            node_m[a, axis] = sample_m[best, axis]
            node_place[a, axis] = place[best // LANES, axis, best % LANES]
        node_weight[a], own = weight[best // LANES, best % LANES], node_weight[a]
        p, q, r, stays = node_place[a, 0], node_place[a, 1], node_place[a, 2], False
        for b in range(nodes):
            du, dv, dw = p - node_place[b, 0], q - node_place[b, 1], r - node_place[b, 2]
            stays |= b != a and math.sqrt(du * du + dv * dv + dw * dw) < snap_m
        for b in range(nodes):
            if linked[a, b] == 1 and not stays:
                stays = not is_supported(node_m, a, b, lens, stride, reach_m, step_m, edge_m, edge_at)
        if stays:
            node_m[a, 0], node_m[a, 1], node_m[a, 2] = x, y, z
            node_place[a, 0], node_place[a, 1], node_place[a, 2] = u, v, w
            node_weight[a] = own
            continue
        node_sample[a] = best
        mark_reached(box, blocks, u, v, w, far, reached)
        for b in range(blocks):
            stale[b] |= reached[b]
        mark_reached(box, blocks, p, q, r, far, reached)
        for b in range(blocks):
            stale[b] |= reached[b]


# error_model="numpy" only leaves out the test for a division by zero, without which 16 samples go at once.
@njit(nogil=True, cache=True, error_model="numpy", **UNCOUNTED)
def grow(
    sample_m: F32,
    sample_weight: F32,
    sample_curve: I32,
    samples: int,
    curve_detail: F32,
    apart_m: float,
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
    place: F32,
    box: F32,
    weight: F32,
    heaviest: F32,
    near: F32,
    far: F32,
    chance: F32,
    top: F32,
    reached: U8,
    hit: U8,
    stale: U8,
    square: F32,
    gap: F32,
    other: I32,
    pair: I32,
    length_m: F32,
    degrees: I32,
    node_sample: I32,
    node_place: F32,
    node_axis: F32,
    node_m: F32,
    node_curve: I32,
    node_weight: F32,
    linked: U8,
) -> int:
    """Steps 2-7; returns the number of nodes.

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
    blocks = lay_out_samples(
        sample_m, sample_weight, sample_curve, samples, curve_detail, apart_m, place, box, weight, heaviest
    )
    stale[:blocks] = 1
    limit_m, snap_m = 1.5 * max_length_m[0], min_length_m[min_length_m.shape[0] - 1]
    for phase in range(min_length_m.shape[0]):
        low_m, high_m = min_length_m[phase], max_length_m[phase]
        for b in range(blocks):
            if stale[b] == 1:
                _look_anew(place, b, node_place, nodes, near, far)
            stale[b], hit[b], top[b] = 0, 1, 0.0
        for a in range(nodes):
            for axis in range(3):
                node_axis[axis, a] = node_m[a, axis]
        for _ in range(math.ceil(samples / per_node[phase]) + (2 if phase == 0 else 0)):
            v = best_sample(near, weight, heaviest, low_m, high_m, beta, chance, top, hit, blocks)
            if v < 0 or nodes == node_m.shape[0]:
                break
            for axis in range(3):
                node_axis[axis, nodes] = node_m[nodes, axis] = sample_m[v, axis]
                node_place[nodes, axis] = place[v // LANES, axis, v % LANES]
            node_curve[nodes], node_weight[nodes], node_sample[nodes] = sample_curve[v], sample_weight[v], v
            x, y, z = node_place[nodes, 0], node_place[nodes, 1], node_place[nodes, 2]
            mark_reached(box, blocks, x, y, z, far, reached)
            for b in range(blocks):
                if reached[b] == 1 and _note_node(place, b, x, y, z, near, far):
                    hit[b], top[b] = 1, 0.0
            s1, s2 = nearest_two(
                node_m,
                node_axis,
                node_curve,
                nodes,
                limit_m,
                lens,
                stride,
                reach_m,
                step_m,
                edge_m,
                edge_at,
                square,
                gap,
                other,
                evidence,
            )
            connect_new(
                node_m, linked, degrees, nodes, s1, s2, lens, stride, reach_m, step_m, edge_m, edge_at, evidence
            )
            nodes += 1
        limit_degree(node_m, linked, nodes, 2, pair, length_m, degrees)
        for a in range(nodes):
            if degrees[a] == 0:
                mark_reached(box, blocks, node_place[a, 0], node_place[a, 1], node_place[a, 2], far, reached)
                for b in range(blocks):
                    stale[b] |= reached[b]
        nodes = drop_isolated(node_m, node_place, node_curve, node_weight, node_sample, linked, degrees, nodes)
        if evidence:
            snap_to_corners(
                sample_m,
                sample_curve,
                place,
                box,
                weight,
                heaviest,
                samples,
                blocks,
                snap_m,
                lens,
                stride,
                reach_m,
                step_m,
                edge_m,
                edge_at,
                node_m,
                node_place,
                node_weight,
                node_sample,
                linked,
                nodes,
                far,
                reached,
                stale,
            )
    return nodes
