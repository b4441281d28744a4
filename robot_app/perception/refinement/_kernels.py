"""Kernels of the post-processing (sections 3.2.1-3.2.5); arguments as in `network._kernels`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robot_app.perception.network._kernels import angle_at, degree, is_supported, separation, set_link, two_neighbours

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]


@njit(nogil=True, cache=True)
def offset_m(node_m: F32, a: int, v: int, b: int) -> float:
    """Distance of node v from the line through a and b."""
    theta = angle_at(node_m, v, a, b)
    return separation(node_m, v, node_m, a) * math.sin(theta)


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
def _open_end_near(node_m: F32, linked: U8, nodes: int, v: int, a: int, b: int, reach_m: float) -> bool:
    for k in range(nodes):
        if k not in (v, a, b) and degree(linked, nodes, k) == 1 and separation(node_m, v, node_m, k) < reach_m:
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
            a, b = two_neighbours(linked, nodes, v)
            angle = angle_at(node_m, a, v, b)
            fine_m = 0.75 * stride * node_m[v, 2] / lens[0]
            if linked[a, b] == 0 and angle > best_angle and (angle > angle_rad or offset_m(node_m, a, v, b) < fine_m):
                best, best_angle, best_slack_m = v, angle, max(slack_m, fine_m)
        if best < 0:
            return
        a, b = two_neighbours(linked, nodes, best)
        if (
            offset_m(node_m, a, best, b) > best_slack_m
            or _open_end_near(node_m, linked, nodes, best, a, b, loop_reach_m)
            or not is_supported(node_m, a, b, lens, stride, reach_m, step_m, edge_m, edge_at)
        ):
            kept[best] = 1
            continue
        set_link(linked, a, best, 0)
        set_link(linked, best, b, 0)
        set_link(linked, a, b, 1)


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
        a, _ = two_neighbours(linked, nodes, v)
        best, best_value = -1, -1e9
        for k in range(nodes):
            if k in (v, a) or degree(linked, nodes, k) == 0 or node_curve[k] != node_curve[v]:
                continue
            distance = separation(node_m, v, node_m, k)
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
            set_link(linked, v, best, 1)


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
                set_link(linked, a, b, 0)
