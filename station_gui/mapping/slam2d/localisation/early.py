"""Odometry of the scans before a robot was found for the first time, which may be never."""

from __future__ import annotations

import numpy as np

from shared.geometry.se2 import Pose2, interpolate

_MOST = 8192  # kept; at twice as many every other one goes


class EarlyOdometry:
    """Of every scan at first, later of every second, fourth and so on, and between them by interpolation."""

    def __init__(self) -> None:
        self._kept = np.zeros((2 * _MOST, 3))
        self._every = 1
        self._count = 0
        self._last = Pose2()

    def __len__(self) -> int:
        """Scans that have come."""
        return self._count

    def append(self, odom_from_robot: Pose2) -> None:
        if self._count == self._every * len(self._kept):
            self._kept[:_MOST] = self._kept[::2]
            self._every *= 2
        if self._count % self._every == 0:
            self._kept[self._count // self._every] = odom_from_robot.as_array()
        self._count += 1
        self._last = odom_from_robot

    def __getitem__(self, index: int) -> Pose2:
        """odom_from_robot of the index-th scan, from 0; IndexError when it has not come."""
        if not 0 <= index < self._count:
            raise IndexError(f"{index} of {self._count}")
        kept, past = divmod(index, self._every)
        before, first = Pose2.from_array(self._kept[kept]), kept * self._every
        if past == 0:
            return before
        end = first + self._every
        after = Pose2.from_array(self._kept[kept + 1]) if end < self._count else self._last
        return interpolate(before, after, past / (min(end, self._count - 1) - first))
