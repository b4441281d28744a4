"""Robust least squares of range differences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.protocol.compact import tables
from shared.protocol.compact.casting import _kernels as casting
from shared.protocol.compact.fitting._kernels import add_up
from shared.protocol.compact.state import UNITS_PER_RAD

IntArray = NDArray[np.int64]

_KERNELS = (960.0, 960.0, 400.0, 400.0, 400.0)  # 60 mm, then 25 mm: one for each time it is linearised
_PRIOR = np.array((480.0, 480.0, 0.03))  # how far odometry may be off: 30 mm and 0.03 rad
_NOISE = 160.0  # of a range: 10 mm
_IN_UNITS = np.array((1.0, 1.0, UNITS_PER_RAD))


def fit(scan: IntArray, pose: IntArray, motion: IntArray, mount: IntArray, ranges_mm: IntArray) -> NDArray[np.float64]:
    """(3,) by how much to shift `pose`, in its units, so that the ranges come near what the stored scan lets expect."""
    rays, hits = np.zeros((len(ranges_mm), 4), np.int64), np.zeros((len(ranges_mm), 4), np.int64)
    sums = np.zeros((3, 4))
    shift: NDArray[np.float64] = np.zeros(3)
    trust = (_NOISE / _PRIOR) ** 2
    for kernel in _KERNELS:
        moved = pose + np.round(shift * _IN_UNITS).astype(np.int64)
        casting.aim(moved, motion, mount, tables.SINE, rays)
        casting.cast(scan, rays, motion, tables.ATAN, hits)
        add_up(rays, hits, moved, ranges_mm, kernel, sums)
        shift = shift + np.linalg.solve(sums[:, :3] + np.diag(trust), sums[:, 3] - trust * shift)
    return np.asarray(shift * _IN_UNITS)
