"""Where the car really was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2

_MAX_POSES = 500_000  # 2.7 hours at 50 Hz


class Track:
    """Poses over time, room frame, up to a bound."""

    def __init__(self, start: Pose2) -> None:
        self._rows: list[tuple[float, float, float, float]] = []
        self._last = start
        self.distance_m = 0.0

    def record(self, time_s: float, room_from_robot: Pose2) -> None:
        self.distance_m += room_from_robot.distance_m(self._last)
        self._last = room_from_robot
        if len(self._rows) < _MAX_POSES:
            self._rows.append((time_s, room_from_robot.x_m, room_from_robot.y_m, room_from_robot.theta_rad))

    def poses(self) -> NDArray[np.float64]:
        """(N, 4): time_s, x_m, y_m, theta_rad."""
        return np.array(self._rows, dtype=np.float64).reshape(-1, 4)
