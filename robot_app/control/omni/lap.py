"""Notices that the robot has come round: it goes where it went before, by its odometry, and has turned once since."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from shared.geometry.se2 import Pose2, wrap_angle


@dataclass(frozen=True, slots=True)
class LapConfig:
    distance_m: float = 4.0  # no lap is shorter
    gate_m: float = 0.4  # it ends so near to a place where the robot was before …
    drift_per_m: float = 0.04  # … and the odometry may have lost so much since: 2° over 30 m to and fro
    farthest_m: float = 3.0  # but no farther: the scanner sees 4 m ahead
    turns: float = 0.7  # of a whole one
    course_m: float = 1.5  # over which its direction is taken: on a bend round a thing it points anywhere
    course_rad: float = 0.6  # two courses of one way differ by less
    sure_m: float = 0.5  # for so long it must be so
    came_m: float = 3.0  # before a lap, over which the direction in which it came is taken
    step_m: float = 0.1  # places are remembered this often
    places: int = 1200


@dataclass(frozen=True, slots=True)
class _Place:
    """And how far the robot had gone and turned by then, and which way it was going."""

    pose: Pose2
    distance_m: float
    turned_rad: float
    course_rad: float


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
        self._matched_m = 0.0
        self.came_rad: float | None = None  # the direction in which it came to where the lap began

    def travel(self, odom_from_robot: Pose2) -> None:
        """To be called at every step."""
        if self._last is not None:
            self.distance_m += odom_from_robot.distance_m(self._last)
            self.turned_rad += wrap_angle(odom_from_robot.theta_rad - self._last.theta_rad)
        self._last = odom_from_robot

    def turns_round(self) -> float:
        """How often it has turned to the left in the lap that is closed here, negative to the right; 0: none is."""
        config = self._config
        if self._last is None or (self._places and self.distance_m - self._places[-1].distance_m <= config.step_m):
            return 0.0
        here = _Place(self._last, self.distance_m, self.turned_rad, self._course_rad(self._last))
        self._places.append(here)
        turns = 0.0
        for index, place in enumerate(self._places):
            turns = self._turns_since(place, here)
            if turns:
                self.came_rad = self._came_rad(index)
                break
        self._matched_m = self._matched_m + config.step_m if turns else 0.0
        return turns if self._matched_m >= config.sure_m else 0.0

    def _course_rad(self, pose: Pose2) -> float:
        """Its direction of late; its heading where it has just begun."""
        back = round(self._config.course_m / self._config.step_m)
        if len(self._places) < back:
            return pose.theta_rad
        before = self._places[-back].pose
        return math.atan2(pose.y_m - before.y_m, pose.x_m - before.x_m)

    def _came_rad(self, index: int) -> float | None:
        back = index - round(self._config.came_m / self._config.step_m)
        if back < 0:
            return None
        before, place = self._places[back].pose, self._places[index].pose
        return math.atan2(place.y_m - before.y_m, place.x_m - before.x_m)

    def _turns_since(self, place: _Place, here: _Place) -> float:
        """0 where the robot does not go the same way as then."""
        config, way_m = self._config, here.distance_m - place.distance_m
        turns = (here.turned_rad - place.turned_rad) / math.tau
        if way_m < config.distance_m or abs(turns) < config.turns:
            return 0.0
        gate_m = min(config.gate_m + config.drift_per_m * way_m, config.farthest_m)
        apart_rad = abs(wrap_angle(here.course_rad - place.course_rad))
        same = apart_rad < config.course_rad and here.pose.distance_m(place.pose) < gate_m
        return turns if same else 0.0
