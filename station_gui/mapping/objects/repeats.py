"""Tells an image's own measurement from outlines that the robot only says again.

Over Wi-Fi each observation has what its image showed. Over LoRa outlines stay as they were, to the last bit in the
odometry's frame, as long as images confirm them: nine in ten pieces are such repeats, whose errors are always the same.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2

# What is written to the millimetre in the robot's frame comes back so near; a new measurement hardly ever does.
_SAME_PLACE_M = 2e-3
_SAME_HEIGHT_M = 7e-4
_NEW_SHARE = 0.5


class Repeats:
    """Remembers the pieces of the last observation."""

    def __init__(self) -> None:
        self._before_m = np.zeros((0, 2, 3))

    def is_measurement(self, ends_m: NDArray[np.float64], odom_from_robot: Pose2) -> bool:
        """Whether most of these pieces, (N, 2, 3) in the robot's frame, were not there in the last observation."""
        now_m = odom_from_robot.apply_3d(ends_m.reshape(-1, 3)).reshape(-1, 2, 3)
        before_m, self._before_m = self._before_m, now_m
        if len(now_m) == 0:
            return False
        off_m = np.abs(before_m[None] - now_m[:, None])
        same = (off_m[..., :2] < _SAME_PLACE_M).all(axis=(2, 3)) & (off_m[..., 2] < _SAME_HEIGHT_M).all(axis=2)
        return float(np.mean(~np.any(same, axis=1))) >= _NEW_SHARE
