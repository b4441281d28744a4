"""Kernels of the post-processing (sections 3.2.1-3.2.5); arguments as in `network._kernels`, and

beside: (N, MOST) int32, the nodes that each is connected to, of which the first `degree` (N,) int32 count.
curve_group: (K,) int32, the same number for edge curves that touch. curve_extent_m: (K,) float32, how large each is.
curve_detail: (K,) float32, by how much shorter than those of table 3 its connections may be.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robot_app.perception._kernels import UNCOUNTED
from robot_app.perception.network._kernels import angle_at, is_supported, separation

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]

MOST = 8  # connections of a node; more are not kept


@njit(nogil=True, cache=True, **UNCOUNTED)
def offset_m(node_m: F32, a: int, v: int, b: int) -> float:
    """Distance of node v from the line through a and b."""
    off_m: float = separation(node_m, v, node_m, a) * math.sin(angle_at(node_m, v, a, b))
    return off_m


@njit(nogil=True, cache=True, **UNCOUNTED)
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


@njit(nogil=True, cache=True, **UNCOUNTED)
def find_curves(sample_m: F32, sample_curve: I32, samples: int, node_m: F32, nodes: int, node_curve: I32) -> None:
    """`node_curve`: that of the sample nearest to each node."""
    for a in range(nodes):
        best_m = math.inf
        for i in range(samples):
            gap_m = separation(sample_m, i, node_m, a)
            if gap_m < best_m:
                best_m, node_curve[a] = gap_m, sample_curve[i]


@njit(nogil=True, cache=True, **UNCOUNTED)
def list_neighbours(linked: U8, nodes: int, beside: I32, degree: I32) -> None:
    """Fill `beside` and `degree` from `linked`."""
    for a in range(nodes):
        degree[a] = 0
    for a in range(nodes):
        for b in range(a + 1, nodes):
            if linked[a, b] == 1:
                connect(beside, degree, a, b)


@njit(nogil=True, cache=True, **UNCOUNTED)
def link_neighbours(beside: I32, degree: I32, nodes: int, linked: U8) -> None:
    """Fill `linked` from `beside` and `degree`."""
    for a in range(nodes):
        for b in range(nodes):
            linked[a, b] = 0
    for a in range(nodes):
        for slot in range(degree[a]):
            linked[a, beside[a, slot]] = 1


@njit(nogil=True, cache=True, **UNCOUNTED)
def are_connected(beside: I32, degree: I32, a: int, b: int) -> bool:
    found = False
    for slot in range(degree[a]):
        found |= beside[a, slot] == b
    return found


@njit(nogil=True, cache=True, **UNCOUNTED)
def connect(beside: I32, degree: I32, a: int, b: int) -> None:
    if degree[a] < MOST and degree[b] < MOST:
        beside[a, degree[a]], beside[b, degree[b]] = b, a
        degree[a] += 1
        degree[b] += 1


@njit(nogil=True, cache=True, **UNCOUNTED)
def _forget(beside: I32, degree: I32, a: int, b: int) -> None:
    for slot in range(degree[a]):
        if beside[a, slot] == b:
            degree[a] -= 1
            beside[a, slot] = beside[a, degree[a]]
            return


@njit(nogil=True, cache=True, **UNCOUNTED)
def disconnect(beside: I32, degree: I32, a: int, b: int) -> None:
    _forget(beside, degree, a, b)
    _forget(beside, degree, b, a)


@njit(nogil=True, cache=True, **UNCOUNTED)
def isolate(beside: I32, degree: I32, a: int) -> None:
    """Take all connections of a node away."""
    while degree[a] > 0:
        disconnect(beside, degree, a, beside[a, 0])


@njit(nogil=True, cache=True, **UNCOUNTED)
def remove_ground(
    node_m: F32,
    beside: I32,
    degree: I32,
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
            isolate(beside, degree, a)


@njit(nogil=True, cache=True, **UNCOUNTED)
def _open_end_near(node_m: F32, v: int, a: int, b: int, ends: I32, count: int, reach_m: float) -> bool:
    for k in range(count):
        end = ends[k]
        if end not in (a, b) and separation(node_m, v, node_m, end) < reach_m:
            return True
    return False


@njit(nogil=True, cache=True, **UNCOUNTED)
def _straightness(
    node_m: F32, beside: I32, degree: I32, v: int, angle_rad: float, stride: int, lens: F64, slack_m: float
) -> float:
    """The angle at node v if that may be removed, 0 otherwise.

    What bends less than three quarters of a cell is straight whatever its angle: the camera does not see more.
    """
    if degree[v] != 2:
        return 0.0
    a, b = beside[v, 0], beside[v, 1]
    angle: float = angle_at(node_m, a, v, b)
    fine_m = 0.75 * stride * node_m[v, 2] / lens[0]
    off_m = offset_m(node_m, a, v, b)
    if (angle > angle_rad or off_m < fine_m) and off_m <= max(slack_m, fine_m):
        return angle
    return 0.0


@njit(nogil=True, cache=True, **UNCOUNTED)
def reduce_straight(
    node_m: F32,
    beside: I32,
    degree: I32,
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
    angle: F32,
    ends: I32,
) -> None:
    """Section 3.2.2: takes nodes out of straight connections, the straightest one first.

    A node stays when an open end may still need it, or when the longer connection would leave the edge points.
    `angle`: (N,), `ends`: (N,) room to work in.
    """
    count = 0
    for v in range(nodes):
        if degree[v] == 1:
            ends[count] = v
            count += 1
    for v in range(nodes):
        angle[v] = _straightness(node_m, beside, degree, v, angle_rad, stride, lens, slack_m)
    while True:
        v, best = -1, 0.0
        for k in range(nodes):
            if angle[k] > best:
                v, best = k, angle[k]
        if v < 0:
            return
        angle[v] = 0.0
        a, b = beside[v, 0], beside[v, 1]
        if (
            are_connected(beside, degree, a, b)
            or (loop_reach_m > 0.0 and _open_end_near(node_m, v, a, b, ends, count, loop_reach_m))
            or not is_supported(node_m, a, b, lens, stride, reach_m, step_m, edge_m, edge_at)
        ):
            continue
        isolate(beside, degree, v)
        connect(beside, degree, a, b)
        for k in (a, b):
            if angle[k] > 0.0:
                angle[k] = _straightness(node_m, beside, degree, k, angle_rad, stride, lens, slack_m)


@njit(nogil=True, cache=True, **UNCOUNTED)
def close_loops(
    node_m: F32,
    node_curve: I32,
    curve_group: I32,
    curve_detail: F32,
    beside: I32,
    degree: I32,
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
        if degree[v] != 1:
            continue
        a, group = beside[v, 0], curve_group[node_curve[v]]
        best, best_value = -1, -1e9
        for k in range(nodes):
            if k == v or degree[k] == 0 or curve_group[node_curve[k]] != group or are_connected(beside, degree, v, k):
                continue
            distance = separation(node_m, v, node_m, k)
            if distance > loop_reach_m / curve_detail[node_curve[v]]:
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
            connect(beside, degree, v, best)


@njit(nogil=True, cache=True, **UNCOUNTED)
def _loss(node_m: F32, beside: I32, degree: I32, a: int, b: int) -> float:
    """What is lost when node a goes and the others connected to it are connected to b, m."""
    loss = 1e9
    if degree[a] == 1:
        loss = separation(node_m, a, node_m, b)
    elif degree[a] == 2:
        other = beside[a, 0] if beside[a, 0] != b else beside[a, 1]
        loss = offset_m(node_m, other, a, b)
    return loss


@njit(nogil=True, cache=True, **UNCOUNTED)
def contract_short(
    node_m: F32,
    node_curve: I32,
    curve_detail: F32,
    beside: I32,
    degree: I32,
    nodes: int,
    min_length_m: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
) -> None:
    """Makes one node of two that are connected over less than the least length; the one that matters less goes."""
    for first in range(nodes):
        slot = 0
        while slot < degree[first]:
            a, b = first, beside[first, slot]
            slot += 1
            if separation(node_m, a, node_m, b) >= 0.99 * min_length_m / curve_detail[node_curve[a]]:
                continue
            if _loss(node_m, beside, degree, b, a) < _loss(node_m, beside, degree, a, b):
                a, b = b, a
            if degree[a] > 2:
                continue
            other = -1
            if degree[a] == 2:
                other = beside[a, 0] if beside[a, 0] != b else beside[a, 1]
                if not are_connected(beside, degree, other, b) and not is_supported(
                    node_m, other, b, lens, stride, reach_m, step_m, edge_m, edge_at
                ):
                    continue
            isolate(beside, degree, a)
            if other >= 0 and not are_connected(beside, degree, other, b):
                connect(beside, degree, other, b)
            slot = 0


@njit(nogil=True, cache=True, **UNCOUNTED)
def remove_noise(
    node_m: F32,
    node_curve: I32,
    curve_extent_m: F32,
    beside: I32,
    degree: I32,
    nodes: int,
    reach_m: float,
    support_m: float,
    cell_width: float,
    edge_m: F32,
    edges: int,
) -> None:
    """Section 3.2.4: disconnects nodes with too short a piece of edge around them (eqs 29 and 30).

    A curve that is larger than that piece is enough by itself.
    """
    for a in range(nodes):
        if degree[a] == 0 or curve_extent_m[node_curve[a]] >= support_m:
            continue
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
            isolate(beside, degree, a)


@njit(nogil=True, cache=True, **UNCOUNTED)
def remove_unsupported(
    node_m: F32,
    beside: I32,
    degree: I32,
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
        slot = 0
        while slot < degree[a]:
            b = beside[a, slot]
            if b > a and not is_supported(node_m, a, b, lens, stride, reach_m, step_m, edge_m, edge_at):
                disconnect(beside, degree, a, b)
            else:
                slot += 1


@njit(nogil=True, cache=True, **UNCOUNTED)
def list_outlines(beside: I32, degree: I32, nodes: int, member: I32, start: I32) -> int:
    """`member`: (N,) the connected nodes, outline by outline, `start`: (N + 1,) where each begins; returns how many."""
    count, filled, at = 0, 0, 0
    for a in range(nodes):
        known = degree[a] == 0
        for k in range(filled):
            known |= member[k] == a
        if known:
            continue
        start[count], member[filled] = filled, a
        filled += 1
        while at < filled:
            for slot in range(degree[member[at]]):
                b, new = beside[member[at], slot], True
                for k in range(start[count], filled):
                    new &= member[k] != b
                if new:
                    member[filled] = b
                    filled += 1
            at += 1
        count += 1
    start[count] = filled
    return count


@njit(nogil=True, cache=True, **UNCOUNTED)
def _furthest(node_m: F32, a: int, member: I32, first: int, end: int) -> int:
    """The node of an outline that is furthest from node a."""
    best, best_m = a, 0.0
    for k in range(first, end):
        gap_m = separation(node_m, a, node_m, member[k])
        if gap_m > best_m:
            best, best_m = member[k], gap_m
    return best


@njit(nogil=True, cache=True, **UNCOUNTED)
def flatten_narrow(
    node_m: F32,
    beside: I32,
    degree: I32,
    member: I32,
    start: I32,
    outlines: int,
    narrow_cells: float,
    lens: F64,
    stride: int,
    reach_m: float,
    step_m: float,
    edge_m: F32,
    edge_at: I32,
) -> None:
    """An outline of few cells across, as of a slot in the back of a chair, becomes a line from end to end of it.

    Whether such edges are one or two, the camera does not see from frame to frame.
    """
    for outline in range(outlines):
        first, end = start[outline], start[outline + 1]
        if end - first < 3:
            continue
        p = _furthest(node_m, member[first], member, first, end)
        q = _furthest(node_m, p, member, first, end)
        limit_m = narrow_cells * stride * min(node_m[p, 2], node_m[q, 2]) / lens[0]
        narrow = separation(node_m, p, node_m, q) > 4.0 * limit_m
        for k in range(first, end):
            if narrow and member[k] not in (p, q):
                narrow = offset_m(node_m, p, member[k], q) <= limit_m
        if narrow and is_supported(node_m, p, q, lens, stride, reach_m, step_m, edge_m, edge_at):
            for k in range(first, end):
                isolate(beside, degree, member[k])
            connect(beside, degree, p, q)


@njit(nogil=True, cache=True, **UNCOUNTED)
def keep_important(
    node_m: F32, beside: I32, degree: I32, member: I32, start: I32, outlines: int, most: int, size: F32
) -> None:
    """Keeps the outlines that look largest from where the camera is, as far as they have no more than `most` nodes.

    `size`: (N,) room to work in.
    """
    for outline in range(outlines):
        first, end = start[outline], start[outline + 1]
        p = _furthest(node_m, member[first], member, first, end)
        q = _furthest(node_m, p, member, first, end)
        size[outline] = separation(node_m, p, node_m, q) / min(node_m[p, 2], node_m[q, 2])
    room = most
    for _ in range(outlines):
        largest = 0
        for outline in range(outlines):
            if size[outline] > size[largest]:
                largest = outline
        size[largest] = -1.0
        first, end, count = start[largest], start[largest + 1], 0
        for k in range(first, end):
            count += degree[member[k]] > 0
        if count <= room:
            room -= count
        else:
            for k in range(first, end):
                isolate(beside, degree, member[k])
