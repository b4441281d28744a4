"""Kernels: where a car can get among boxes, tried out exhaustively.

`boxes` (B, 6): the middle, cosine and sine of the yaw, half lengths. `car` (3,): from the rear axle to the rear and to
the front bumper and half the width, the margin added. `far_m` (rows, columns): to the nearest box from the middle of
each cell of `far_cell`, from the origin of the room's frame.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_CHECKS = 3
_TURN = 2.0 * math.pi


@njit(nogil=True, cache=True)
def _apart(
    ax: float, ay: float, reach: float, dx: float, dy: float, ux: float, uy: float, hx: float, hy: float
) -> bool:
    """Whether a line of direction (ax, ay) parts a body of that reach along it from a box at (dx, dy)."""
    box = hx * abs(ax * ux + ay * uy) + hy * abs(-ax * uy + ay * ux)
    return abs(ax * dx + ay * dy) > reach + box


@njit(nogil=True, cache=True)
def is_free(boxes: Floats, car: Floats, far_m: Floats, far_cell: float, x: float, y: float, theta: float) -> bool:
    """Whether the car's rectangle touches no box: by separating axes, no cells."""
    c = math.cos(theta)
    s = math.sin(theta)
    half_x = 0.5 * (car[0] + car[1])
    half_y = car[2]
    mx = x + 0.5 * (car[1] - car[0]) * c
    my = y + 0.5 * (car[1] - car[0]) * s
    rows, columns = far_m.shape
    i = math.floor(my / far_cell)
    j = math.floor(mx / far_cell)
    if i < 0 or j < 0 or i >= rows or j >= columns:
        return False
    if far_m[i, j] > math.hypot(half_x, half_y) + 2.0 * far_cell:
        return True
    if far_m[i, j] < half_y - 2.0 * far_cell:
        return False
    for b in range(len(boxes)):
        dx = boxes[b, 0] - mx
        dy = boxes[b, 1] - my
        ux, uy, hx, hy = boxes[b, 2], boxes[b, 3], boxes[b, 4], boxes[b, 5]
        if _apart(c, s, half_x, dx, dy, ux, uy, hx, hy) or _apart(-s, c, half_y, dx, dy, ux, uy, hx, hy):
            continue
        along = half_x * abs(c * ux + s * uy) + half_y * abs(-s * ux + c * uy)
        aside = half_x * abs(-c * uy + s * ux) + half_y * abs(s * uy + c * ux)
        if abs(dx * ux + dy * uy) > along + hx or abs(-dx * uy + dy * ux) > aside + hy:
            continue
        return False
    return True


@njit(nogil=True, cache=True)
def flood(
    boxes: Floats,
    car: Floats,
    far_m: Floats,
    far_cell: float,
    start: Floats,
    curvature: float,
    step: float,
    cell: float,
    seen: NDArray[np.bool_],
    stack: Floats,
) -> int:
    """Mark in `seen` (rows, columns, headings) every pose that the car gets to from `start` (3,) by arcs of `step`,
    straight and fully steered, forward and in reverse; returns how many. `stack` (N, 3) has room for all of them."""
    rows, columns, headings = seen.shape
    for k in range(3):
        stack[0, k] = start[k]
    size = 1
    count = 0
    while size > 0:
        size -= 1
        x0, y0, t0 = stack[size, 0], stack[size, 1], stack[size, 2]
        for move in range(6):
            bend = curvature * (move % 3 - 1)
            part = (step if move < 3 else -step) / _CHECKS
            x, y, t = x0, y0, t0
            fits = True
            for _ in range(_CHECKS):
                x += part * math.cos(t + 0.5 * part * bend)
                y += part * math.sin(t + 0.5 * part * bend)
                t += part * bend
                if not is_free(boxes, car, far_m, far_cell, x, y, t):
                    fits = False
                    break
            if not fits:
                continue
            i = math.floor(y / cell)
            j = math.floor(x / cell)
            h = int((t / _TURN - math.floor(t / _TURN)) * headings) % headings
            if i < 0 or j < 0 or i >= rows or j >= columns or seen[i, j, h] or size >= len(stack):
                continue
            seen[i, j, h] = True
            count += 1
            stack[size, 0], stack[size, 1], stack[size, 2] = x, y, t
            size += 1
    return count


@njit(nogil=True, cache=True)
def places_that_fit(
    boxes: Floats, car: Floats, far_m: Floats, far_cell: float, cell: float, fits: NDArray[np.bool_]
) -> None:
    """Write into `fits` (rows, columns, headings) where the car stands clear of all boxes."""
    rows, columns, headings = fits.shape
    for i in range(rows):
        for j in range(columns):
            for h in range(headings):
                theta = (h + 0.5) * 2.0 * math.pi / headings
                fits[i, j, h] = is_free(boxes, car, far_m, far_cell, (j + 0.5) * cell, (i + 0.5) * cell, theta)
