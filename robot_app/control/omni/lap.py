"""Notices that the robot has come round: it is where it was before, by its odometry, and has turned once on the way."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from shared.geometry.se2 import Pose2, wrap_angle

_SAME_HEADING_RAD = 1.0


@dataclass(frozen=True, slots=True)
class LapConfig:
    distance_m: float = 4.0  # no lap is shorter
    gate_m: float = 0.4  # it ends so near to a place where the robot was before …
    drift_per_m: float = 0.04  # … and the odometry may have lost so much since: 2° over 30 m to and fro
    farthest_m: float = 3.0  # but no farther: the scanner sees 4 m ahead
    turns: float = 0.7  # of a whole one
    step_m: float = 0.1  # places are remembered this often
    places: int = 1200


@dataclass(frozen=True, slots=True)
class _Place:
    """And how far the robot had gone and turned by then."""

    pose: Pose2
    distance_m: float
    turned_rad: float


class Lap:
    def __init__(self, config: LapConfig) -> None:
        self._config = config
        self._last: Pose2 | None = None
        self.distance_m = 0.0
        self.turned_rad = 0.0
        self.forget()

    def forget(self) -> None:
        """Begin a new lap here."""
        self._places: deque[_Place] = deque(maxlen=self._config.places)

    def travel(self, odom_from_robot: Pose2) -> None:
        """To be called at every step."""
        if self._last is not None:
            self.distance_m += odom_from_robot.distance_m(self._last)
            self.turned_rad += wrap_angle(odom_from_robot.theta_rad - self._last.theta_rad)
        self._last = odom_from_robot

    def turns_round(self) -> float:
        """How often it has turned to the left in the lap that is closed here, negative to the right; 0: none is."""
        config, pose = self._config, self._last
        if pose is None or (self._places and self.distance_m - self._places[-1].distance_m <= config.step_m):
            return 0.0
        self._places.append(_Place(pose, self.distance_m, self.turned_rad))
        for place in self._places:
            way_m = self.distance_m - place.distance_m
            if way_m < config.distance_m:
                break
            heading_off = abs(wrap_angle(pose.theta_rad - place.pose.theta_rad))
            gate_m = min(config.gate_m + config.drift_per_m * way_m, config.farthest_m)
            turns = (self.turned_rad - place.turned_rad) / math.tau
            if abs(turns) > config.turns and heading_off < _SAME_HEADING_RAD and pose.distance_m(place.pose) < gate_m:
                return turns
        return 0.0
