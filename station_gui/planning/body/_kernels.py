"""Kernels: how far the car's rectangle is from everything that is not free.

A clearance field is a (rows, columns) array of metres to the nearest cell that is not free; `frame` (3,) holds the map
position of its lower left corner and the size of a cell. `car` (5,): from the rear axle to the rear bumper and to the
front one, half the width, the margin that is kept, and the way beyond it within which a pose counts as tight.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from shared.geometry.field._kernels import bilinear

Floats = NDArray[np.float64]


@njit(nogil=True, cache=True)
def clearance_at(field_m: Floats, frame: Floats, x: float, y: float) -> float:
    """The field at a point, bilinear; 0 outside the map."""
    rows, columns = field_m.shape
    u = (x - frame[0]) / frame[2] - 0.5
    v = (y - frame[1]) / frame[2] - 0.5
    if u < 0.0 or v < 0.0 or u >= columns - 1 or v >= rows - 1:
        return 0.0
    return bilinear(field_m, u, v)


@njit(nogil=True, cache=True)
def _along(
    field_m: Floats, frame: Floats, x: float, y: float, dx: float, dy: float, length: float, least: float
) -> float:
    """The smallest field value on a segment, if that is below `least`.

    The field grows by no more than the way walked, so a step may be as long as the field is above the least so far.
    """
    shortest = 0.5 * frame[2]
    at = 0.0
    while at < length:
        here = clearance_at(field_m, frame, x + at * dx, y + at * dy)
        least = min(least, here)
        at += max(here - least, shortest)
    return least


@njit(nogil=True, cache=True)
def body_clearance(field_m: Floats, frame: Floats, car: Floats, x: float, y: float, theta: float) -> float:
    """From the car's rectangle to the nearest cell that is not free; 0 when one is under it.

    Not more than the margin and the comfort together: beyond that it makes no difference. Exact to half a cell.
    """
    c = math.cos(theta)
    s = math.sin(theta)
    rear, front, half = car[0], car[1], car[2]
    cap = car[3] + car[4]
    middle = 0.5 * (front - rear)
    span = 0.5 * (front + rear)
    if clearance_at(field_m, frame, x + middle * c, y + middle * s) >= cap + math.hypot(span, half):
        return float(cap)
    ahead = x + (half - rear) * c
    aside = y + (half - rear) * s
    spine = _along(field_m, frame, ahead, aside, c, s, front + rear - 2.0 * half, half + cap)
    if spine < half:
        return 0.0
    least = min(cap, spine - half)
    left_x = x - rear * c - half * s
    left_y = y - rear * s + half * c
    right_x = x - rear * c + half * s
    right_y = y - rear * s - half * c
    length = front + rear
    least = _along(field_m, frame, x + front * c + half * s, y + front * s - half * c, -s, c, 2.0 * half, least)
    least = _along(field_m, frame, right_x, right_y, c, s, length, least)
    least = _along(field_m, frame, left_x, left_y, c, s, length, least)
    return float(_along(field_m, frame, right_x, right_y, -s, c, 2.0 * half, least))


@njit(nogil=True, cache=True)
def fits_somehow(
    field_m: Floats, frame: Floats, car: Floats, x: float, y: float, headings: int, needed: float
) -> bool:  # fmt: skip
    """Whether the car can have its rear axle there with any of so many headings and `needed` metres to spare."""
    clear = clearance_at(field_m, frame, x, y)
    if clear < min(car[0], car[2]) + needed:
        return False
    if clear >= math.hypot(max(car[0], car[1]), car[2]) + needed:
        return True
    for k in range(headings):
        if body_clearance(field_m, frame, car, x, y, 2.0 * math.pi * k / headings) >= max(needed, 1e-9):
            return True
    return False


@njit(nogil=True, cache=True)
def where_it_fits(
    field_m: Floats, frame: Floats, car: Floats, cell: float, headings: int, fits: NDArray[np.bool_]
) -> None:
    """Write for the middle of each cell of `fits` (rows, columns) whether the car fits there without a margin."""
    rows, columns = fits.shape
    for i in range(rows):
        for j in range(columns):
            x = frame[0] + (j + 0.5) * cell
            y = frame[1] + (i + 0.5) * cell
            fits[i, j] = fits_somehow(field_m, frame, car, x, y, headings, 0.0)
