"""Robust least squares of range differences, then the cheapest correction near by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.protocol.compact import tables
from shared.protocol.compact.casting import _kernels as casting
from shared.protocol.compact.correction import LARGEST, Triple, corrected, quantised
from shared.protocol.compact.fitting._kernels import add_up, rough_cost
from shared.protocol.compact.state import UNITS_PER_RAD

IntArray = NDArray[np.int64]

_KERNELS = (960.0, 960.0, 400.0, 400.0, 400.0)  # 60 mm, then 25 mm: one for each time it is linearised
_PRIOR = np.array((480.0, 480.0, 0.03))  # how far odometry may be off: 30 mm and 0.03 rad
_NOISE = 160.0  # of a range: 10 mm
_IN_UNITS = np.array((1.0, 1.0, UNITS_PER_RAD))
_COSTS = np.array((14, 45, 72, 90, 101, 112, 120, 128, 200), np.int64)  # 1/16 bit, measured on test_lab2
_CORRECTION_COST = 16  # of a step away from none
_NEIGHBOURS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
_CLIMBS = 3


class _Scene:
    """A new scan against the last one."""

    def __init__(
        self, scan: IntArray, pose: IntArray, motion: IntArray, mount: IntArray, ranges_mm: IntArray, step_mm: int
    ) -> None:
        self._scan, self._pose, self._motion, self._mount = scan, pose, motion, mount
        self._ranges_mm, self._step_mm = ranges_mm, step_mm
        self._rays = np.zeros((len(ranges_mm), 4), np.int64)
        self._hits = np.zeros((len(ranges_mm), 4), np.int64)

    def _cast(self, pose: IntArray) -> None:
        casting.aim(pose, self._motion, self._mount, tables.SINE, self._rays)
        casting.cast(self._scan, self._rays, self._motion, tables.ATAN, self._hits)

    def least_squares(self) -> NDArray[np.float64]:
        """(3,) by how much to shift the pose, in its units."""
        sums = np.zeros((3, 4))
        shift: NDArray[np.float64] = np.zeros(3)
        trust = (_NOISE / _PRIOR) ** 2
        for kernel in _KERNELS:
            moved = self._pose + np.round(shift * _IN_UNITS).astype(np.int64)
            self._cast(moved)
            add_up(self._rays, self._hits, moved, self._ranges_mm, kernel, sums)
            shift = shift + np.linalg.solve(sums[:, :3] + np.diag(trust), sums[:, 3] - trust * shift)
        return np.asarray(shift * _IN_UNITS)

    def cost(self, correction: Triple) -> int:
        x, y, heading = self._pose.tolist()
        self._cast(np.array(corrected((x, y, heading), correction), np.int64))
        said = _CORRECTION_COST * sum(abs(value) for value in correction)
        return said + int(rough_cost(self._hits, self._ranges_mm, self._step_mm, _COSTS))


def best_correction(
    scan: IntArray, pose: IntArray, motion: IntArray, mount: IntArray, ranges_mm: IntArray, step_mm: int
) -> Triple:
    """The correction of `pose` after which the ranges come near what the stored scan lets expect."""
    scene = _Scene(scan, pose, motion, mount, ranges_mm, step_mm)
    best = quantised(scene.least_squares(), int(pose[2]))
    cost = scene.cost(best)
    for _ in range(_CLIMBS):
        start = best
        for da, db, dc in _NEIGHBOURS:
            tried = (start[0] + da, start[1] + db, start[2] + dc)
            if max(map(abs, tried)) <= LARGEST and (tried_cost := scene.cost(tried)) < cost:
                best, cost = tried, tried_cost
        if best == start:
            break
    return best
