"""Kernels of scan matching: plain arrays and scalars.

A local map is a window of square cells. `nearest` (H, W) int32 names the surfel nearest to a cell, -1 for none
within reach; `distance2` (H, W) uint8 is its squared distance in cells, 255 for none; 0 marks the surfel's own cell.
`surfels` (S, 5) float64 holds sums over the hits of a cell: count, x, y, normal x, normal y.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
NONE_NEAR = 255
TILE = 32  # cells along a side


@njit(nogil=True, cache=True)
def scan_normals(
    points: FloatArray, origin: FloatArray, half_window: int, max_gap_m: float, max_rms_m: float, normals: FloatArray
) -> None:
    """Unit normals of a scan's points towards the scanner, (0, 0) where the neighbours form no line."""
    count = points.shape[0]
    for i in range(count):
        first = i
        while first > 0 and i - first < half_window and _gap(points, first - 1, first) < max_gap_m:
            first -= 1
        last = i
        while last < count - 1 and last - i < half_window and _gap(points, last, last + 1) < max_gap_m:
            last += 1
        normals[i, 0] = 0.0
        normals[i, 1] = 0.0
        members = last - first + 1
        if members < 3:
            continue
        mean_x = 0.0
        mean_y = 0.0
        for k in range(first, last + 1):
            mean_x += points[k, 0]
            mean_y += points[k, 1]
        mean_x /= members
        mean_y /= members
        xx = 0.0
        xy = 0.0
        yy = 0.0
        for k in range(first, last + 1):
            dx = points[k, 0] - mean_x
            dy = points[k, 1] - mean_y
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
        spread = math.sqrt((xx - yy) * (xx - yy) + 4.0 * xy * xy)
        smallest = 0.5 * (xx + yy - spread)
        largest = 0.5 * (xx + yy + spread)
        if largest <= 0.0 or smallest > 0.1 * largest or smallest > members * max_rms_m * max_rms_m:
            continue
        along = 0.5 * math.atan2(2.0 * xy, xx - yy)
        nx = -math.sin(along)
        ny = math.cos(along)
        if nx * (origin[0] - points[i, 0]) + ny * (origin[1] - points[i, 1]) < 0.0:
            nx = -nx
            ny = -ny
        normals[i, 0] = nx
        normals[i, 1] = ny


@njit(nogil=True, cache=True)
def scan_lines(
    points: FloatArray,
    origin: FloatArray,
    half_window: int,
    max_gap_m: float,
    max_rms_m: float,
    max_lonely_m: float,
    useful: FloatArray,
    normals: FloatArray,
) -> int:
    """The points that lie on a line or next to a neighbour, and their normals as by `scan_normals`; how many."""
    scan_normals(points, origin, half_window, max_gap_m, max_rms_m, normals)
    last = points.shape[0] - 1
    count = 0
    for i in range(points.shape[0]):
        if normals[i, 0] == 0.0 and normals[i, 1] == 0.0:
            near = i > 0 and _gap(points, i - 1, i) < max_lonely_m
            if not near and not (i < last and _gap(points, i, i + 1) < max_lonely_m):
                continue
        for k in range(2):
            useful[count, k] = points[i, k]
            normals[count, k] = normals[i, k]
        count += 1
    return count


@njit(nogil=True, cache=True)
def _gap(points: FloatArray, i: int, j: int) -> float:
    return math.hypot(points[i, 0] - points[j, 0], points[i, 1] - points[j, 1])


@njit(nogil=True, cache=True)
def stamp(
    points: FloatArray | NDArray[np.float32],
    normals: FloatArray | NDArray[np.float32],
    pose: FloatArray,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    reach: int,
    max_count: float,
    nearest: NDArray[np.int32],
    distance2: NDArray[np.uint8],
    surfels: FloatArray,
    used: int,
) -> int:
    """Add a scan at `pose` to a local map; returns the number of surfels in use. Points outside are left out."""
    height, width = nearest.shape
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    for i in range(points.shape[0]):
        x = pose[0] + c * points[i, 0] - s * points[i, 1]
        y = pose[1] + s * points[i, 0] + c * points[i, 1]
        column = math.floor((x - origin_x) / cell_m)
        row = math.floor((y - origin_y) / cell_m)
        if column < reach or row < reach or column >= width - reach or row >= height - reach:
            continue
        if distance2[row, column] == 0:
            index = nearest[row, column]
        else:
            if used >= surfels.shape[0]:
                continue
            index = used
            used += 1
            for k in range(5):
                surfels[index, k] = 0.0
            _brush(row, column, index, reach, nearest, distance2)
        if surfels[index, 0] >= max_count:
            keep = (max_count - 1.0) / surfels[index, 0]
            for k in range(5):
                surfels[index, k] *= keep
        surfels[index, 0] += 1.0
        surfels[index, 1] += x
        surfels[index, 2] += y
        surfels[index, 3] += c * normals[i, 0] - s * normals[i, 1]
        surfels[index, 4] += s * normals[i, 0] + c * normals[i, 1]
    return used


@njit(nogil=True, cache=True)
def _brush(
    row: int, column: int, index: int, reach: int, nearest: NDArray[np.int32], distance2: NDArray[np.uint8]
) -> None:
    for dr in range(-reach, reach + 1):
        for dc in range(-reach, reach + 1):
            d2 = dr * dr + dc * dc
            if d2 <= reach * reach and d2 < distance2[row + dr, column + dc]:
                distance2[row + dr, column + dc] = d2
                nearest[row + dr, column + dc] = index


@njit(nogil=True, cache=True)
def mark_tiles(
    surfels: FloatArray,
    used: int,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    reach: int,
    dirty: NDArray[np.bool_],
    state: NDArray[np.int64],
    budget: int,
) -> int:
    """Mark the tiles of `TILE` cells that the surfels from `state[0]` on have written to."""
    last = min(used, state[0] + budget)
    done = last - state[0]
    for index in range(state[0], last):
        column = math.floor((surfels[index, 1] / surfels[index, 0] - origin_x) / cell_m)
        row = math.floor((surfels[index, 2] / surfels[index, 0] - origin_y) / cell_m)
        for r in range(max(0, row - reach - 1) // TILE, min((row + reach + 1) // TILE + 1, dirty.shape[0])):
            for q in range(max(0, column - reach - 1) // TILE, min((column + reach + 1) // TILE + 1, dirty.shape[1])):
                dirty[r, q] = True
    state[0] = last
    return int(done + 1)


@njit(nogil=True, cache=True)
def clear_tiles(
    dirty: NDArray[np.bool_],
    nearest: NDArray[np.int32],
    distance2: NDArray[np.uint8],
    state: NDArray[np.int64],
    budget: int,
) -> int:
    """Empty the marked tiles from `state[0]` on, row after row, and take their marks off."""
    height, width = nearest.shape
    work = 0
    while state[0] < dirty.size and work < budget:
        r = state[0] // dirty.shape[1]
        q = state[0] % dirty.shape[1]
        work += 1
        if dirty[r, q]:
            dirty[r, q] = False
            for row in range(r * TILE, min((r + 1) * TILE, height)):
                for column in range(q * TILE, min((q + 1) * TILE, width)):
                    nearest[row, column] = -1
                    distance2[row, column] = NONE_NEAR
            work += TILE * TILE // 8
        state[0] += 1
    return work


@njit(nogil=True, cache=True)
def add_line_term(
    w: float, r: float, nx: float, ny: float, rx: float, ry: float, hessian: FloatArray, gradient: FloatArray
) -> None:
    """Add the residual `r` along a line's normal, of weight `w`, to the upper half of the normal equations.

    (`rx`, `ry`): the point relative to the robot, map directions.
    """
    turn = ny * rx - nx * ry
    hessian[0, 0] += w * nx * nx
    hessian[0, 1] += w * nx * ny
    hessian[0, 2] += w * nx * turn
    hessian[1, 1] += w * ny * ny
    hessian[1, 2] += w * ny * turn
    hessian[2, 2] += w * turn * turn
    gradient[0] += w * r * nx
    gradient[1] += w * r * ny
    gradient[2] += w * r * turn


@njit(nogil=True, cache=True)
def add_point_term(
    w: float, dx: float, dy: float, rx: float, ry: float, hessian: FloatArray, gradient: FloatArray
) -> None:
    """The same for a difference (`dx`, `dy`) in both coordinates."""
    hessian[0, 0] += w
    hessian[1, 1] += w
    hessian[0, 2] -= w * ry
    hessian[1, 2] += w * rx
    hessian[2, 2] += w * (rx * rx + ry * ry)
    gradient[0] += w * dx
    gradient[1] += w * dy
    gradient[2] += w * (dy * rx - dx * ry)


@njit(nogil=True, cache=True)
def mirror(hessian: FloatArray) -> None:
    """Fill the lower half."""
    hessian[1, 0] = hessian[0, 1]
    hessian[2, 0] = hessian[0, 2]
    hessian[2, 1] = hessian[1, 2]


@njit(nogil=True, cache=True)
def linearise(
    points: FloatArray,
    normals: FloatArray,
    pose: FloatArray,
    kernel_m: float,
    inlier_m: float,
    point_weight: float,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    nearest: NDArray[np.int32],
    surfels: FloatArray,
    hessian: FloatArray,
    gradient: FloatArray,
    figures: FloatArray,
) -> None:
    """Normal equations of all points against the surfels nearest to them, robust weights by Geman and McClure.

    The residual of a point is its distance along the surfel's normal, or, where the surfel has none, both
    coordinates of the difference. The increment is (dx, dy) in the map frame and a turn about the robot.
    `figures`: [robust cost, points inside the window, inliers, sum of the inliers' squared residuals].
    """
    height, width = nearest.shape
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    k2 = kernel_m * kernel_m
    for a in range(3):
        gradient[a] = 0.0
        for b in range(3):
            hessian[a, b] = 0.0
    for a in range(4):
        figures[a] = 0.0
    for i in range(points.shape[0]):
        rx = c * points[i, 0] - s * points[i, 1]
        ry = s * points[i, 0] + c * points[i, 1]
        x = pose[0] + rx
        y = pose[1] + ry
        column = math.floor((x - origin_x) / cell_m)
        row = math.floor((y - origin_y) / cell_m)
        if column < 0 or row < 0 or column >= width or row >= height:
            continue
        figures[1] += 1.0
        index = nearest[row, column]
        if index < 0:
            figures[0] += k2
            continue
        count = surfels[index, 0]
        dx = x - surfels[index, 1] / count
        dy = y - surfels[index, 2] / count
        nx = surfels[index, 3]
        ny = surfels[index, 4]
        length = math.sqrt(nx * nx + ny * ny)
        if length > 0.5 * count:
            nx /= length
            ny /= length
            facing = nx * (c * normals[i, 0] - s * normals[i, 1]) + ny * (s * normals[i, 0] + c * normals[i, 1])
            if facing < 0.0:  # the other side of a thin wall
                figures[0] += k2
                continue
            r = nx * dx + ny * dy
            r2 = r * r
            w = k2 / (k2 + r2)
            w *= w
            add_line_term(w, r, nx, ny, rx, ry, hessian, gradient)
        else:
            r2 = dx * dx + dy * dy
            w = k2 / (k2 + r2)
            w *= w * point_weight
            add_point_term(w, dx, dy, rx, ry, hessian, gradient)
        figures[0] += k2 * r2 / (k2 + r2)
        if r2 < inlier_m * inlier_m:
            figures[2] += 1.0
            figures[3] += r2
    mirror(hessian)


@njit(nogil=True, cache=True)
def solve3(a: FloatArray, b: FloatArray, x: FloatArray) -> bool:
    """x = -a⁻¹ b for a symmetric positive definite (3, 3); False where it is not."""
    l00 = a[0, 0]
    if l00 <= 0.0:
        return False
    l00 = math.sqrt(l00)
    l10 = a[1, 0] / l00
    l20 = a[2, 0] / l00
    d1 = a[1, 1] - l10 * l10
    if d1 <= 0.0:
        return False
    l11 = math.sqrt(d1)
    l21 = (a[2, 1] - l20 * l10) / l11
    d2 = a[2, 2] - l20 * l20 - l21 * l21
    if d2 <= 0.0:
        return False
    l22 = math.sqrt(d2)
    y0 = -b[0] / l00
    y1 = (-b[1] - l10 * y0) / l11
    y2 = (-b[2] - l20 * y0 - l21 * y1) / l22
    x[2] = y2 / l22
    x[1] = (y1 - l21 * x[2]) / l11
    x[0] = (y0 - l10 * x[1] - l20 * x[2]) / l00
    return True


@njit(nogil=True, cache=True)
def prior_information(
    hessian: FloatArray, prior_weight: FloatArray, weak_points: float, weak_weight: float, prior: FloatArray
) -> None:
    """What the prediction weighs: `prior_weight`, and more along a direction that few points hold.

    The eigenvalues of the Hessian's part for the shift count the points that hold each direction. Along a corridor
    these are a handful of clutter whose errors are not independent, and the odometry knows better (the degeneracy
    of Zhang et al. 2016, made soft).
    """
    for a in range(3):
        for b in range(3):
            prior[a, b] = 0.0
        prior[a, a] = prior_weight[a]
    angle = 0.5 * math.atan2(2.0 * hessian[0, 1], hessian[0, 0] - hessian[1, 1])
    mean = 0.5 * (hessian[0, 0] + hessian[1, 1])
    spread = 0.5 * math.hypot(hessian[0, 0] - hessian[1, 1], 2.0 * hessian[0, 1])
    for k in range(2):
        points = max(mean + spread if k == 0 else mean - spread, 0.0)
        x = math.cos(angle) if k == 0 else -math.sin(angle)
        y = math.sin(angle) if k == 0 else math.cos(angle)
        ratio = points / weak_points
        weight = weak_weight / (1.0 + ratio * ratio)
        prior[0, 0] += weight * x * x
        prior[0, 1] += weight * x * y
        prior[1, 0] += weight * x * y
        prior[1, 1] += weight * y * y


@njit(nogil=True, cache=True)
def refine(
    points: FloatArray,
    normals: FloatArray,
    pose: FloatArray,
    prior_pose: FloatArray,
    prior_weight: FloatArray,
    weak_points: float,
    weak_weight: float,
    wide_kernel_m: float,
    fine_kernel_m: float,
    inlier_m: float,
    point_weight: float,
    max_iterations: int,
    origin_x: float,
    origin_y: float,
    cell_m: float,
    nearest: NDArray[np.int32],
    surfels: FloatArray,
    hessian: FloatArray,
    figures: FloatArray,
    state: FloatArray,
    budget: int,
) -> None:
    """At most `budget` iterations of Gauss–Newton with a prior; `pose` is moved in place.

    The kernel narrows from wide to fine by halves, each time the pose has settled, so that far points pull first
    and near points decide.
    `state` is [width of the kernel or 0 at the beginning, iterations, 1 at the end]; at the end `hessian` and
    `figures` are those of the last linearisation, without the prior.
    """
    gradient = np.zeros(3)
    system = np.zeros((3, 3))
    step = np.zeros(3)
    difference = np.zeros(3)
    if state[0] == 0.0:
        state[0] = wide_kernel_m
    kernel_m = state[0]
    for _ in range(budget):
        if state[1] >= max_iterations:
            state[2] = 1.0
            break
        state[1] += 1.0
        linearise(
            points, normals, pose, kernel_m, inlier_m, point_weight, origin_x, origin_y, cell_m, nearest, surfels,
            hessian, gradient, figures,
        )  # fmt: skip
        prior_information(hessian, prior_weight, weak_points, weak_weight, system)
        difference[0] = pose[0] - prior_pose[0]
        difference[1] = pose[1] - prior_pose[1]
        turn = pose[2] - prior_pose[2]
        difference[2] = turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
        for a in range(3):
            for b in range(3):
                gradient[a] += system[a, b] * difference[b]
        for a in range(3):
            for b in range(3):
                system[a, b] += hessian[a, b]
        if not solve3(system, gradient, step):
            state[2] = 1.0
            break
        for a in range(3):
            pose[a] += step[a]
        moved_m = abs(step[0]) + abs(step[1])
        if kernel_m > fine_kernel_m:
            if moved_m < 5e-3 and abs(step[2]) < 1e-3:
                kernel_m = max(fine_kernel_m, 0.5 * kernel_m)
                state[0] = kernel_m
        elif moved_m < 2e-4 and abs(step[2]) < 5e-5:
            state[2] = 1.0
            break
    if state[2] > 0.0:
        linearise(
            points, normals, pose, fine_kernel_m, inlier_m, point_weight, origin_x, origin_y, cell_m, nearest, surfels,
            hessian, gradient, figures,
        )  # fmt: skip
