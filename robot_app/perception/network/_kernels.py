"""Kernels on the network: growing it (steps 2-7) and refining it (sections 3.2.1-3.2.5).

They are in one file because numba's cache does not see a change in a kernel of another file. Shared arguments are
those of `perception._kernels`, and
node_m: (N, 3) float32, optical frame. node_curve: (N,) int32, the edge curve that a node was taken from.
linked: (N, N) uint8, symmetric, 1 where two nodes are connected.
They have room for `max_nodes`; the first `nodes` are in use.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]


@njit(nogil=True, cache=True)
def _distance(a_m: F32, a: int, b_m: F32, b: int) -> float:
    dx, dy, dz = a_m[a, 0] - b_m[b, 0], a_m[a, 1] - b_m[b, 1], a_m[a, 2] - b_m[b, 2]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@njit(nogil=True, cache=True)
def near_edge(x: float, y: float, z: float, lens: F64, stride: int, reach_m: float, edge_m: F32, edge_at: I32) -> bool:
    """Whether an edge point lies within `reach_m` of a point on each axis; looks in the cells around its image.

    Across the line of sight the reach is no more than 2.5 cells: there the camera is as good as its pixels.
    """
    rows, columns = edge_at.shape
    if z < 0.05:
        return False
    side_m = min(reach_m, 2.5 * stride * z / min(lens[0], lens[1]))
    ci = math.floor((y / z * lens[1] + lens[3]) / stride)
    cj = math.floor((x / z * lens[0] + lens[2]) / stride)
    ri = min(int(side_m * lens[1] / (z * stride)) + 1, 16)
    rj = min(int(side_m * lens[0] / (z * stride)) + 1, 16)
    for ring in range(max(ri, rj) + 1):
        for k in range(max(ci - min(ring, ri), 0), min(ci + min(ring, ri) + 1, rows)):
            whole = ring <= ri and abs(k - ci) == ring
            step = 1 if whole or ring == 0 else 2 * ring
            for m in range(cj - ring, cj + ring + 1, step):
                if m < 0 or m >= columns or abs(m - cj) > rj:
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


@njit(nogil=True, cache=True)
def is_supported(
    node_m: F32, a: int, b: int, lens: F64, stride: int, reach_m: float, step_m: float, edge_m: F32, edge_at: I32
) -> bool:
    """Whether edge points lie all along a connection (eqs 31-33, which look at its middle alone)."""
    dx, dy, dz = node_m[b, 0] - node_m[a, 0], node_m[b, 1] - node_m[a, 1], node_m[b, 2] - node_m[a, 2]
    parts = max(2, math.ceil(math.sqrt(dx * dx + dy * dy + dz * dz) / step_m))
    for part in range(1, parts):
        t = part / parts
        x, y, z = node_m[a, 0] + t * dx, node_m[a, 1] + t * dy, node_m[a, 2] + t * dz
        if not near_edge(x, y, z, lens, stride, reach_m, edge_m, edge_at):
            return False
    return True


@njit(nogil=True, cache=True)
def node_probability(distance_m: float, min_m: float, max_m: float, beta: float) -> float:
    """P_node (eq 12) of a sample whose nearest node is `distance_m` away."""
    if distance_m < min_m:
        return 0.0
    if distance_m <= max_m:
        return 1.0
    return math.tanh(beta * max_m / distance_m)


@njit(nogil=True, cache=True)
def degree(linked: U8, nodes: int, a: int) -> int:
    total = 0
    for b in range(nodes):
        total += linked[a, b]
    return total


@njit(nogil=True, cache=True)
def _set_link(linked: U8, a: int, b: int, value: int) -> None:
    linked[a, b] = value
    linked[b, a] = value


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
                if linked[a, b] == 1 and _distance(node_m, a, node_m, b) > longest:
                    longest, la, lb = _distance(node_m, a, node_m, b), a, b
        if la < 0:
            return
        _set_link(linked, la, lb, 0)
        degrees[la] -= 1
        degrees[lb] -= 1


@njit(nogil=True, cache=True)
def remove_isolated(node_m: F32, node_curve: I32, linked: U8, nodes: int) -> int:
    """Step 7: nodes without a connection go; the others keep their order. Returns how many are left."""
    kept = 0
    for a in range(nodes):
        if degree(linked, nodes, a) == 0:
            continue
        if kept != a:
            node_m[kept] = node_m[a]
            node_curve[kept] = node_curve[a]
            for b in range(nodes):
                linked[kept, b] = linked[a, b]
            for b in range(nodes):
                linked[b, kept] = linked[b, a]
        kept += 1
    for a in range(nodes):
        for b in range(kept if a < kept else 0, nodes):
            linked[a, b] = 0
    return kept


@njit(nogil=True, cache=True)
def _note_node(sample_m: F32, samples: int, node_m: F32, node: int, nearest_m: F32) -> None:
    """Keep each sample's distance to its nearest node, dS1 (eq 13), up to date with a new node."""
    for i in range(samples):
        nearest_m[i] = min(nearest_m[i], _distance(sample_m, i, node_m, node))


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
                distance = _distance(node_m, k, node_m, r)
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
            distance = _distance(sample_m, i, node_m, a)
            if distance < own_m:
                own, own_m = sample_weight[i], distance
            if distance < snap_m and sample_weight[i] > best_weight:
                best, best_weight = i, sample_weight[i]
        if best < 0 or best_weight < 1.2 * own:
            continue
        old_m[:] = node_m[a]
        node_m[a] = sample_m[best]
        for b in range(nodes):
            crowded = b != a and _distance(node_m, a, node_m, b) < snap_m
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
            _set_link(linked, s1, r, 1)
            if s2 < 0:
                continue
            ds12 = _distance(node_m, s1, node_m, s2)
            if _distance(node_m, s1, node_m, r) < ds12 and _distance(node_m, s2, node_m, r) < ds12:
                _set_link(linked, s2, r, 1)
                _set_link(linked, s1, s2, 0)
            elif linked[s1, s2] == 0 and is_supported(node_m, s1, s2, lens, stride, reach_m, step_m, edge_m, edge_at):
                _set_link(linked, s1, s2, 1)
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


@njit(nogil=True, cache=True)
def is_ground(
    node_m: F32,
    a: int,
    z: F32,
    slope_x: F32,
    slope_y: F32,
    lens: F64,
    stride: int,
    up: F64,
    reach_m: float,
    rise_m: float,
) -> bool:
    """Whether no point of the cloud lies above or below a node, within `reach_m` of it (eqs 24 and 25)."""
    half = stride // 2
    x, y, depth_m = node_m[a, 0], node_m[a, 1], node_m[a, 2]
    ci = int((y / depth_m * lens[1] + lens[3]) / stride)
    cj = int((x / depth_m * lens[0] + lens[2]) / stride)
    ri = min(int((reach_m + rise_m) * lens[1] / (depth_m * stride)) + 2, 24)
    rj = min(int(reach_m * lens[0] / (depth_m * stride)) + 1, 8)
    for i in range(max(ci - ri, 0), min(ci + ri + 1, z.shape[0])):
        for j in range(max(cj - rj, 0), min(cj + rj + 1, z.shape[1])):
            if z[i, j] == 0.0:
                continue
            dx = slope_x[half + j * stride] * z[i, j] - x
            dy = slope_y[half + i * stride] * z[i, j] - y
            dz = z[i, j] - depth_m
            rise = up[0] * dx + up[1] * dy + up[2] * dz
            if abs(rise) > rise_m and dx * dx + dy * dy + dz * dz - rise * rise < reach_m * reach_m:
                return False
    return True


@njit(nogil=True, cache=True)
def remove_ground(
    node_m: F32,
    linked: U8,
    nodes: int,
    z: F32,
    slope_x: F32,
    slope_y: F32,
    lens: F64,
    stride: int,
    up: F64,
    reach_m: float,
    rise_m: float,
    band_m: float,
) -> None:
    """Section 3.2.1: disconnects the ground nodes below `band_m`."""
    for a in range(nodes):
        height = up[0] * node_m[a, 0] + up[1] * node_m[a, 1] + up[2] * node_m[a, 2] + up[3]
        if height < band_m and is_ground(node_m, a, z, slope_x, slope_y, lens, stride, up, reach_m, rise_m):
            linked[a, :nodes] = 0
            linked[:nodes, a] = 0


@njit(nogil=True, cache=True)
def angle_at(node_m: F32, a: int, v: int, b: int) -> float:
    """θ (eq 26): the angle at node v between the ways to a and to b, rad; π is straight."""
    ax, ay, az = node_m[a, 0] - node_m[v, 0], node_m[a, 1] - node_m[v, 1], node_m[a, 2] - node_m[v, 2]
    bx, by, bz = node_m[b, 0] - node_m[v, 0], node_m[b, 1] - node_m[v, 1], node_m[b, 2] - node_m[v, 2]
    norm = math.sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    if norm == 0.0:
        return 0.0
    return math.acos(min(1.0, max(-1.0, (ax * bx + ay * by + az * bz) / norm)))


@njit(nogil=True, cache=True)
def offset_m(node_m: F32, a: int, v: int, b: int) -> float:
    """Distance of node v from the line through a and b."""
    theta = angle_at(node_m, v, a, b)
    return _distance(node_m, v, node_m, a) * math.sin(theta)


@njit(nogil=True, cache=True)
def _two_neighbours(linked: U8, nodes: int, v: int) -> tuple[int, int]:
    a, b = -1, -1
    for k in range(nodes):
        if linked[v, k] == 1:
            if a < 0:
                a = k
            else:
                b = k
    return a, b


@njit(nogil=True, cache=True)
def _open_end_near(node_m: F32, linked: U8, nodes: int, v: int, a: int, b: int, reach_m: float) -> bool:
    for k in range(nodes):
        if k not in (v, a, b) and degree(linked, nodes, k) == 1 and _distance(node_m, v, node_m, k) < reach_m:
            return True
    return False


@njit(nogil=True, cache=True)
def reduce_straight(
    node_m: F32,
    linked: U8,
    nodes: int,
    angle_rad: float,
    slack_m: float,
    loop_reach_m: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
) -> None:
    """Section 3.2.2: takes nodes out of straight connections, the straightest one first.

    What bends less than three quarters of a cell is straight whatever its angle: the camera does not see more. A node
    stays when an open end may still need it, or when the longer connection would leave the edge points.
    """
    kept = np.zeros(nodes, np.uint8)
    while True:
        best, best_angle, best_slack_m = -1, 0.0, 0.0
        for v in range(nodes):
            if kept[v] == 1 or degree(linked, nodes, v) != 2:
                continue
            a, b = _two_neighbours(linked, nodes, v)
            angle = angle_at(node_m, a, v, b)
            fine_m = 0.75 * stride * node_m[v, 2] / lens[0]
            if linked[a, b] == 0 and angle > best_angle and (angle > angle_rad or offset_m(node_m, a, v, b) < fine_m):
                best, best_angle, best_slack_m = v, angle, max(slack_m, fine_m)
        if best < 0:
            return
        a, b = _two_neighbours(linked, nodes, best)
        if (
            offset_m(node_m, a, best, b) > best_slack_m
            or _open_end_near(node_m, linked, nodes, best, a, b, loop_reach_m)
            or not is_supported(node_m, a, b, lens, stride, reach_m, step_m, edge_m, edge_at)
        ):
            kept[best] = 1
            continue
        _set_link(linked, a, best, 0)
        _set_link(linked, best, b, 0)
        _set_link(linked, a, b, 1)


@njit(nogil=True, cache=True)
def close_loops(
    node_m: F32,
    node_curve: I32,
    linked: U8,
    nodes: int,
    eta_angle_per_rad: float,
    eta_distance_per_m: float,
    loop_reach_m: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
) -> None:
    """Section 3.2.3: connects each open end to the node with the highest P_open (eqs 27 and 28) that edges lead to."""
    for v in range(nodes):
        if degree(linked, nodes, v) != 1:
            continue
        a, _ = _two_neighbours(linked, nodes, v)
        best, best_value = -1, -1e9
        for k in range(nodes):
            if k in (v, a) or degree(linked, nodes, k) == 0 or node_curve[k] != node_curve[v]:
                continue
            distance = _distance(node_m, v, node_m, k)
            if distance > loop_reach_m:
                continue
            angle = angle_at(node_m, a, v, k)
            value = eta_angle_per_rad * angle + eta_distance_per_m * distance
            # Under 45° the new connection would run back along the one that is there.
            if (
                angle > 0.785
                and value > best_value
                and is_supported(node_m, v, k, lens, stride, reach_m, step_m, edge_m, edge_at)
            ):
                best, best_value = k, value
        if best >= 0:
            _set_link(linked, v, best, 1)


@njit(nogil=True, cache=True)
def remove_noise(
    node_m: F32, linked: U8, nodes: int, reach_m: float, support_m: float, cell_width: float, edge_m: F32, edges: int
) -> None:
    """Section 3.2.4: disconnects nodes with too short a piece of edge around them (eqs 29 and 30)."""
    for a in range(nodes):
        length = 0.0
        for i in range(edges):
            if (
                abs(edge_m[i, 0] - node_m[a, 0]) <= reach_m
                and abs(edge_m[i, 1] - node_m[a, 1]) <= reach_m
                and abs(edge_m[i, 2] - node_m[a, 2]) <= reach_m
            ):
                length += cell_width * edge_m[i, 2]
                if length >= support_m:
                    break
        if length < support_m:
            linked[a, :nodes] = 0
            linked[:nodes, a] = 0


@njit(nogil=True, cache=True)
def remove_unsupported(
    node_m: F32,
    linked: U8,
    nodes: int,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
) -> None:
    """Section 3.2.5: connections through free air go."""
    for a in range(nodes):
        for b in range(a + 1, nodes):
            if linked[a, b] == 1 and not is_supported(node_m, a, b, lens, stride, reach_m, step_m, edge_m, edge_at):
                _set_link(linked, a, b, 0)


@njit(nogil=True, cache=True)
def list_connections(linked: U8, nodes: int, pairs: I32) -> int:
    """`pairs`: (M, 2) room for the connections, lower node first; returns how many there are."""
    count = 0
    for a in range(nodes):
        for b in range(a + 1, nodes):
            if linked[a, b] == 1 and count < pairs.shape[0]:
                pairs[count, 0], pairs[count, 1] = a, b
                count += 1
    return count
