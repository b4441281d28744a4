"""The way that the robot has come: to go back along it, and to know whether it closes a loop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2


@dataclass(frozen=True, slots=True)
class TrailConfig:
    step_m: float = 0.03
    length: int = 2000  # places that are kept
    loop_distance_m: float = 4.0  # a loop is closed where the robot was so much of its way before
    loop_gate_m: float = 0.5
    loop_gate_rad: float = 0.8


class Trail:
    """The last places, one for each step. One thread."""

    def __init__(self, config: TrailConfig) -> None:
        self._config = config
        self._places = np.zeros((config.length, 4))  # x, y, theta, metres driven; a ring
        self.clear()

    def clear(self) -> None:
        self._count = 0
        self.loop_closed = False  # whether the robot was at one place twice, so that the map's ends can meet

    def __len__(self) -> int:
        return min(self._count, len(self._places))

    def add(self, odom_from_robot: Pose2, way_m: float) -> None:
        """The robot is here, after `way_m` driven."""
        here = odom_from_robot.as_array()
        if self._count:
            last = self._places[(self._count - 1) % len(self._places)]
            if math.hypot(here[0] - last[0], here[1] - last[1]) < self._config.step_m:
                return
        self.loop_closed = self.loop_closed or self._was_near(here, way_m)
        self._places[self._count % len(self._places)] = *here, way_m
        self._count += 1

    def _was_near(self, here: NDArray[np.float64], way_m: float) -> bool:
        config, earlier = self._config, self._places[: len(self)]
        off = np.hypot(earlier[:, 0] - here[0], earlier[:, 1] - here[1])
        turned = np.abs(np.mod(earlier[:, 2] - here[2] + math.pi, math.tau) - math.pi)
        before = earlier[:, 3] <= way_m - config.loop_distance_m
        return bool((before & (off < config.loop_gate_m) & (turned < config.loop_gate_rad)).any())

    def back(self, odom_from_robot: Pose2, length_m: float) -> NDArray[np.float64]:
        """(N, 3): from here back along the trail; it ends where the trail has a gap."""
        config, path, way_m = self._config, [odom_from_robot.as_array()], 0.0
        for k in range(self._count - 1, self._count - 1 - len(self), -1):
            place = self._places[k % len(self._places), :3]
            step_m = math.hypot(*(place[:2] - path[-1][:2]))
            if step_m < 0.5 * config.step_m:
                continue
            if step_m > 10 * config.step_m or way_m > length_m:
                break
            path.append(place.copy())
            way_m += step_m
        return np.array(path)
