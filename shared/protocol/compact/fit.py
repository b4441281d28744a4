"""Where a scan lies best on the last one: the encoder's own choice, so it may use floating point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.protocol.compact import tables
from shared.protocol.compact.casting import _kernels as casting
from shared.protocol.compact.state import UNITS_PER_RAD

IntArray = NDArray[np.int64]

_ROUNDS = 5
_FIRST_ROUNDS = 2
_KERNELS = (60 * 16, 25 * 16)  # residuals of this size count half, in the first rounds and after
_PRIOR = np.array((30 * 16, 30 * 16, 0.03 * UNITS_PER_RAD))  # how far odometry may be off
_NOISE = 10 * 16
_FLATTEST = 0.25  # sine of the angle between beam and wall below which a range says little


def fit(scan: IntArray, pose: IntArray, motion: IntArray, mount: IntArray, ranges_mm: IntArray) -> NDArray[np.float64]:
    """(3,) x, y, heading that bring the ranges near what the stored scan lets expect, starting from `pose`.

    Robust least squares of range differences, linearised anew five times.
    """
    rays, hits = np.zeros((len(ranges_mm), 4), np.int64), np.zeros((len(ranges_mm), 4), np.int64)
    guess = pose.astype(np.float64)
    for turn in range(_ROUNDS):
        rounded = np.round(guess).astype(np.int64)
        casting.aim(rounded, motion, mount, tables.SINE, rays)
        casting.cast(scan, rays, motion, tables.ATAN, hits)
        off, slopes = _linearised(rays, hits, rounded, ranges_mm)
        kernel = _KERNELS[0] if turn < _FIRST_ROUNDS else _KERNELS[1]
        weights = (kernel**2 / (kernel**2 + off**2)) ** 2
        trust = _NOISE**2 / _PRIOR**2
        weighted = slopes * weights[:, None]
        gradient = weighted.T @ off - trust * (guess - pose)
        guess = guess + np.linalg.solve(weighted.T @ slopes + np.diag(trust), gradient)
    return guess


def _linearised(
    rays: IntArray, hits: IntArray, pose: IntArray, ranges_mm: IntArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Differences (n,) of the ranges that can be compared, and how they change with the pose (n, 3)."""
    cosine, sine = rays[:, 2] / 2**tables.SINE_BITS, rays[:, 3] / 2**tables.SINE_BITS
    dx, dy = hits[:, 2].astype(np.float64), hits[:, 3].astype(np.float64)
    across = cosine * dy - sine * dx
    good = (hits[:, 0] > 0) & (ranges_mm > 0) & (np.abs(across) > _FLATTEST * np.hypot(dx, dy))
    cosine, sine, dx, dy, across = cosine[good], sine[good], dx[good], dy[good], across[good]
    by_x, by_y = -dy / across, dx / across
    lever_x, lever_y = rays[good, 0] - pose[0], rays[good, 1] - pose[1]
    turning = by_y * lever_x - by_x * lever_y + hits[good, 0] * (cosine * dx + sine * dy) / across
    off = (16 * ranges_mm - hits[:, 0])[good].astype(np.float64)
    return off, np.stack((by_x, by_y, turning / UNITS_PER_RAD), axis=1)
