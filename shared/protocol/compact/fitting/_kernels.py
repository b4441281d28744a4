"""Sums of the least squares that bring a scan onto the last one."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

_FLATTEST = 0.25  # sine of the angle between beam and wall below which a range says little
_ONE = 1048576.0  # of a direction


@njit(nogil=True, cache=True)
def add_up(rays: Ints, hits: Ints, pose: Ints, ranges_mm: Ints, kernel: float, sums: Floats) -> None:
    """`sums` (3, 4) out: normal matrix and, in its last column, gradient, of x, y in 1/16 mm and heading in radians.

    Each range's difference from what is expected counts the less, the larger it is: half at 0.64 of `kernel`.
    """
    sums[:, :] = 0.0
    slope = np.zeros(3)
    for i in range(rays.shape[0]):
        if hits[i, 0] == 0 or ranges_mm[i] == 0:
            continue
        c, s = rays[i, 2] / _ONE, rays[i, 3] / _ONE
        dx, dy = float(hits[i, 2]), float(hits[i, 3])
        across = c * dy - s * dx
        if abs(across) <= _FLATTEST * math.sqrt(dx * dx + dy * dy):
            continue
        slope[0] = -dy / across
        slope[1] = dx / across
        slope[2] = slope[1] * (rays[i, 0] - pose[0]) - slope[0] * (rays[i, 1] - pose[1])
        slope[2] += hits[i, 0] * (c * dx + s * dy) / across
        off = float(16 * ranges_mm[i] - hits[i, 0])
        weight = (kernel * kernel / (kernel * kernel + off * off)) ** 2
        for a in range(3):
            for b in range(3):
                sums[a, b] += weight * slope[a] * slope[b]
            sums[a, 3] += weight * slope[a] * off


@njit(nogil=True, cache=True)
def rough_cost(hits: Ints, ranges_mm: Ints, step: int, costs: Ints) -> int:
    """About what a scan would cost to say, in 1/16 bit; `costs` (C,): of a range that is so many steps off."""
    total = 0
    for i in range(hits.shape[0]):
        if hits[i, 0] == 0 and ranges_mm[i] == 0:
            continue
        if hits[i, 0] == 0 or ranges_mm[i] == 0:
            total += 48
            continue
        off = abs(ranges_mm[i] - ((hits[i, 0] + 8) >> 4))
        total += costs[min(costs.shape[0] - 1, (2 * off + step) // (2 * step))]
    return total
