"""Kernels of the local obstacle memory, of the wall trace and of the swept footprint."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from shared.geometry.field._kernels import bilinear, to_distances

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@njit(nogil=True, cache=True)
def insert_hits(
    hits_m: Floats,
    stamp_s: float,
    cell_m: float,
    max_count: int,
    owner: Ints,
    mean_m: Floats,
    count: Ints,
    seen_s: Floats,
) -> None:
    """Put `hits_m` (N, 2), odom frame, into the rolling grid: `owner` (S, S, 2) tells whose cell a slot holds."""
    size = len(owner)
    for k in range(len(hits_m)):
        column = math.floor(hits_m[k, 0] / cell_m)
        row = math.floor(hits_m[k, 1] / cell_m)
        i = row % size
        j = column % size
        if owner[i, j, 0] != row or owner[i, j, 1] != column:
            owner[i, j, 0] = row
            owner[i, j, 1] = column
            count[i, j] = 0
        if count[i, j] == 0:
            mean_m[i, j, 0] = hits_m[k, 0]
            mean_m[i, j, 1] = hits_m[k, 1]
        count[i, j] = min(count[i, j] + 1, max_count)
        mean_m[i, j, 0] += (hits_m[k, 0] - mean_m[i, j, 0]) / count[i, j]
        mean_m[i, j, 1] += (hits_m[k, 1] - mean_m[i, j, 1]) / count[i, j]
        seen_s[i, j] = stamp_s


@njit(nogil=True, cache=True)
def clear_seen_through(
    ranges_m: Floats,
    first_angle_rad: float,
    step_rad: float,
    scanner: Floats,
    reach_m: float,
    slack_m: float,
    mean_m: Floats,
    count: Ints,
) -> None:
    """Take hits from cells that the beams pass: the three nearest beams all measured farther than the cell is.

    `scanner`: (3,) its pose in the odom frame. `ranges_m`: (B,), NaN where nothing was measured: that clears nothing.
    """
    size = len(count)
    beams = len(ranges_m)
    for i in range(size):
        for j in range(size):
            if count[i, j] == 0:
                continue
            dx = mean_m[i, j, 0] - scanner[0]
            dy = mean_m[i, j, 1] - scanner[1]
            distance = math.hypot(dx, dy)
            if distance > reach_m:
                continue
            turn = math.atan2(dy, dx) - scanner[2] - first_angle_rad
            beam = round((turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi))) / step_rad)
            if beam < 1 or beam > beams - 2:
                continue
            passed = True
            for b in range(beam - 1, beam + 2):
                if not ranges_m[b] > distance + slack_m:
                    passed = False
            if passed:
                count[i, j] -= 1


@njit(nogil=True, cache=True)
def collect_points(
    x_m: float,
    y_m: float,
    reach_m: float,
    oldest_s: float,
    min_count: int,
    mean_m: Floats,
    count: Ints,
    seen_s: Floats,
    points_m: Floats,
) -> int:
    """Write the believed points within `reach_m` of (x, y) into `points_m` (M, 2); returns how many there are."""
    size = len(count)
    found = 0
    for i in range(size):
        for j in range(size):
            if count[i, j] < min_count or seen_s[i, j] < oldest_s:
                continue
            dx = mean_m[i, j, 0] - x_m
            dy = mean_m[i, j, 1] - y_m
            if dx * dx + dy * dy <= reach_m * reach_m and found < len(points_m):
                points_m[found, 0] = mean_m[i, j, 0]
                points_m[found, 1] = mean_m[i, j, 1]
                found += 1
    return found


@njit(nogil=True, cache=True)
def distance_field(points_m: Floats, left_m: float, low_m: float, cell_m: float, far_m: float, field_m: Floats) -> None:
    """Write into `field_m` (S, S) how far each cell's centre is from the nearest cell with a point, at most `far_m`."""
    size = len(field_m)
    far = far_m / cell_m
    field_m.fill(far * far)
    for k in range(len(points_m)):
        j = math.floor((points_m[k, 0] - left_m) / cell_m)
        i = math.floor((points_m[k, 1] - low_m) / cell_m)
        if 0 <= i < size and 0 <= j < size:
            field_m[i, j] = 0.0
    to_distances(field_m, cell_m)


@njit(nogil=True, cache=True)
def sample_field(field_m: Floats, left_m: float, low_m: float, cell_m: float, x_m: float, y_m: float) -> float:
    """The field at a point, bilinear between cell centres; clamped at the border."""
    size = len(field_m)
    u = min(max((x_m - left_m) / cell_m - 0.5, 0.0), size - 1.001)
    v = min(max((y_m - low_m) / cell_m - 0.5, 0.0), size - 1.001)
    return bilinear(field_m, u, v)


@njit(nogil=True, cache=True)
def field_slope(
    field_m: Floats, left_m: float, low_m: float, cell_m: float, x_m: float, y_m: float, slope: Floats
) -> None:
    """Write the unit vector away from the nearest obstacle into `slope` (2,); zero on a ridge or plateau."""
    gx = sample_field(field_m, left_m, low_m, cell_m, x_m + cell_m, y_m) - sample_field(
        field_m, left_m, low_m, cell_m, x_m - cell_m, y_m
    )
    gy = sample_field(field_m, left_m, low_m, cell_m, x_m, y_m + cell_m) - sample_field(
        field_m, left_m, low_m, cell_m, x_m, y_m - cell_m
    )
    norm = math.hypot(gx, gy)
    slope[0] = gx / norm if norm > 1e-9 else 0.0
    slope[1] = gy / norm if norm > 1e-9 else 0.0


@njit(nogil=True, cache=True)
def walk_to_level(
    field_m: Floats,
    left_m: float,
    low_m: float,
    cell_m: float,
    start_m: Floats,
    direction_rad: float,
    level_m: float,
    reach_m: float,
) -> float:
    """How far from `start_m` in a direction the field falls below `level_m` after having been above; inf if never."""
    armed = False
    walked = 0.0
    while walked <= reach_m:
        x = start_m[0] + walked * math.cos(direction_rad)
        y = start_m[1] + walked * math.sin(direction_rad)
        value = sample_field(field_m, left_m, low_m, cell_m, x, y)
        if value >= level_m:
            armed = True
        elif armed:
            return walked
        walked += cell_m
    return math.inf


@njit(nogil=True, cache=True)
def widest_on_way(
    field_m: Floats, left_m: float, low_m: float, cell_m: float, start_m: Floats, direction_rad: float, reach_m: float
) -> float:
    """The largest field value on the way from `start_m` to the first obstacle in a direction."""
    widest = 0.0
    walked = 0.0
    while walked <= reach_m:
        x = start_m[0] + walked * math.cos(direction_rad)
        y = start_m[1] + walked * math.sin(direction_rad)
        value = sample_field(field_m, left_m, low_m, cell_m, x, y)
        widest = max(widest, value)
        if value < cell_m:
            break
        walked += cell_m
    return widest


@njit(nogil=True, cache=True)
def roll_along(
    field_m: Floats,
    left_m: float,
    low_m: float,
    cell_m: float,
    start_m: Floats,
    side: float,
    level_m: float,
    wanted_m: float,
    step_m: float,
    path_m: Floats,
) -> int:
    """Roll a disc of radius `level_m` along the obstacles, then move its centres away from them up to `wanted_m`.

    The disc keeps the obstacles on its left (`side` +1) or right (-1), and so bridges every gap that is narrower
    than itself. Where there is no room for `wanted_m`, the centres end midway between both sides.
    Writes `path_m` (N, 2); returns how many points it has.
    """
    slope = np.empty(2)
    x = start_m[0]
    y = start_m[1]
    for n in range(len(path_m)):
        field_slope(field_m, left_m, low_m, cell_m, x, y, slope)
        if slope[0] == 0.0 and slope[1] == 0.0:
            return n
        px = x
        py = y
        here = sample_field(field_m, left_m, low_m, cell_m, px, py)
        ux = slope[0]
        uy = slope[1]
        while here < wanted_m:
            qx = px + ux * cell_m
            qy = py + uy * cell_m
            there = sample_field(field_m, left_m, low_m, cell_m, qx, qy)
            if there < here + 0.4 * cell_m:
                break
            px = qx
            py = qy
            here = there
        path_m[n, 0] = px
        path_m[n, 1] = py
        error = sample_field(field_m, left_m, low_m, cell_m, x, y) - level_m
        pull = max(-1.0, min(1.0, 8.0 * error / level_m))
        dx = -side * slope[1] - pull * slope[0]
        dy = side * slope[0] - pull * slope[1]
        norm = math.hypot(dx, dy)
        x += step_m * dx / norm
        y += step_m * dy / norm
    return len(path_m)


@njit(nogil=True, cache=True)
def point_margins(
    points_m: Floats, front_m: float, rear_m: float, half_m: float, margin_m: float, margins_m: Floats
) -> None:
    """Write how near each point, robot frame, may come: `margin_m`, but less where it is nearer already."""
    for k in range(len(points_m)):
        dx = max(points_m[k, 0] - front_m, -rear_m - points_m[k, 0], 0.0)
        dy = max(abs(points_m[k, 1]) - half_m, 0.0)
        margins_m[k] = min(margin_m, max(math.hypot(dx, dy) - 0.004, 0.0))


@njit(nogil=True, cache=True)
def sweep(
    points_m: Floats,
    margins_m: Floats,
    start: Floats,
    steering_rad: float,
    target_rad: float,
    steering_per_m: float,
    direction: float,
    wheelbase_m: float,
    front_m: float,
    rear_m: float,
    half_m: float,
    step_m: float,
    horizon_m: float,
    end: Floats,
) -> tuple[float, float]:
    """Drive the rectangle from `start` (x, y, theta) with the wheels turning from `steering_rad` to `target_rad`.

    Returns how far it gets before a point comes nearer than its margin, and how near any point came on the way.
    `end` (4,) takes the last free pose and its steering. `direction`: +1 forward, -1 reverse.
    """
    x = start[0]
    y = start[1]
    theta = start[2]
    delta = steering_rad
    driven = 0.0
    nearest = math.inf
    end[0] = x
    end[1] = y
    end[2] = theta
    end[3] = delta
    while driven < horizon_m - 1e-9:
        change = max(-steering_per_m * step_m, min(steering_per_m * step_m, target_rad - delta))
        delta += change
        turn = direction * step_m * math.tan(delta - 0.5 * change) / wheelbase_m
        x += direction * step_m * math.cos(theta + 0.5 * turn)
        y += direction * step_m * math.sin(theta + 0.5 * turn)
        theta += turn
        c = math.cos(theta)
        s = math.sin(theta)
        for k in range(len(points_m)):
            dx = points_m[k, 0] - x
            dy = points_m[k, 1] - y
            u = c * dx + s * dy
            ou = max(u - front_m, -rear_m - u, 0.0)
            if ou > 0.3:
                continue
            ov = max(abs(c * dy - s * dx) - half_m, 0.0)
            squared = ou * ou + ov * ov
            if squared < margins_m[k] * margins_m[k] or squared == 0.0:
                return driven, nearest
            if squared < nearest * nearest:
                nearest = math.sqrt(squared)
        driven += step_m
        end[0] = x
        end[1] = y
        end[2] = theta
        end[3] = delta
    return driven, nearest


@njit(nogil=True, cache=True)
def mark_seen(
    scanner: Floats, angles_rad: Floats, ranges_m: Floats, reach_m: float, cell_m: float, owner: Ints
) -> None:
    """Note every cell that a beam has passed: `owner` (S, S, 2) then holds its row and column. Angles: odom frame."""
    size = len(owner)
    for k in range(len(angles_rad)):
        ux = math.cos(angles_rad[k])
        uy = math.sin(angles_rad[k])
        walked = 0.0
        last = min(ranges_m[k], reach_m)
        while walked < last:
            row = math.floor((scanner[1] + walked * uy) / cell_m)
            column = math.floor((scanner[0] + walked * ux) / cell_m)
            owner[row % size, column % size, 0] = row
            owner[row % size, column % size, 1] = column
            walked += 0.7 * cell_m


@njit(nogil=True, cache=True)
def collect_unseen(candidates_m: Floats, cell_m: float, owner: Ints, unseen_m: Floats) -> int:
    """Write those of `candidates_m` (N, 2), odom frame, whose cell was never seen; returns how many."""
    size = len(owner)
    found = 0
    for k in range(len(candidates_m)):
        row = math.floor(candidates_m[k, 1] / cell_m)
        column = math.floor(candidates_m[k, 0] / cell_m)
        if owner[row % size, column % size, 0] != row or owner[row % size, column % size, 1] != column:
            unseen_m[found, 0] = candidates_m[k, 0]
            unseen_m[found, 1] = candidates_m[k, 1]
            found += 1
    return found
