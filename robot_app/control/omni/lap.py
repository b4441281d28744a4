"""Notices that the robot has come round, and whether round the room or round something that stands free in it.

It has come round when it goes where it went before, by its odometry. The way of a disc that rolls along a wall turns by
a whole turn meanwhile: away from the wall in a room, towards it round an island (the turning number of a closed curve,
Hopf, Compositio Math. 2, 1935). Only the way counts and not the heading: where the way ends before it and leads back,
the robot may turn round by either side, but the disc has rolled away from the wall.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from itertools import islice

from shared.geometry.se2 import Pose2, wrap_angle


@dataclass(frozen=True, slots=True)
class LapConfig:
    distance_m: float = 4.0  # no lap of a room is shorter …
    island_m: float = 1.5  # … and none of an island
    gate_m: float = 0.4  # it ends so near to a place where the robot was before …
    drift_per_m: float = 0.04  # … and the odometry may have lost so much since: 2° over 30 m to and fro
    farthest_m: float = 3.0  # but no farther: the scanner sees 4 m ahead
    turns: float = 0.7  # of a whole one
    sharpest_rad: float = 2.0  # a disc turns towards its wall in an arc; what is sharper was a turn away from it
    course_m: float = 1.5  # over which its direction is taken: on a bend round a thing it points anywhere
    course_rad: float = 0.6  # two courses of one way differ by less
    sure_m: float = 0.5  # for so long it must be so
    came_m: float = 3.0  # before a lap, over which the direction in which it came is taken
    step_m: float = 0.1  # between places that are remembered
    places: int = 1200


@dataclass(frozen=True, slots=True)
class _Place:
    """With how far the robot had gone by then, how far its way had turned to the left, and where it was going."""

    pose: Pose2
    distance_m: float
    turned_rad: float
    step_rad: float | None  # the direction of the step to here
    course_rad: float | None  # and of the last ones together; None at the beginning


class Lap:
    def __init__(self, config: LapConfig, side: int) -> None:
        """`side`: where the wall is, -1 right, +1 left."""
        self._config = config
        self._side = side
        self._last: Pose2 | None = None
        self.distance_m = 0.0
        self.heading_turned_rad = 0.0
        self._places: deque[_Place] = deque(maxlen=config.places)
        self._matched_m = 0.0
        self._began = 0  # the place where the lap that is closed began

    def travel(self, odom_from_robot: Pose2) -> None:
        """To be called at every step."""
        if self._last is not None:
            self.distance_m += odom_from_robot.distance_m(self._last)
            self.heading_turned_rad += wrap_angle(odom_from_robot.theta_rad - self._last.theta_rad)
        self._last = odom_from_robot

    def turns_round(self) -> float:
        """How often its way has turned in the lap that is closed here, positive away from the wall; 0: none is."""
        config = self._config
        if self._last is None or (self._places and self._last.distance_m(self._places[-1].pose) < config.step_m):
            return 0.0
        here = self._place(self._last)
        self._places.append(here)
        turns = 0.0
        for index, place in enumerate(self._places):
            turns = self._turns_since(place, here)
            if turns:
                self._began = index
                break
        self._matched_m = self._matched_m + config.step_m if turns else 0.0
        return turns if self._matched_m >= config.sure_m else 0.0

    def leave_out(self) -> float | None:
        """The lap that is closed: as if the robot had gone on at once where that began.

        Returns the direction in which it came there. Where it came from near, that is None, and a new lap begins: the
        first steps led to the island and along no wall of the room.
        """
        began, here = self._places[self._began], self._places[-1]
        back = self._began - round(self._config.came_m / self._config.step_m)
        came_rad = _direction_rad(self._places[back].pose, began.pose) if back >= 0 else None
        whole_rad = math.tau * round((here.turned_rad - began.turned_rad) / math.tau)
        kept = [*islice(self._places, self._began), replace(here, turned_rad=here.turned_rad - whole_rad)]
        self._places = deque(kept if came_rad is not None else (), self._places.maxlen)
        self._matched_m = 0.0
        return came_rad

    def _place(self, pose: Pose2) -> _Place:
        if not self._places:
            return _Place(pose, self.distance_m, 0.0, None, None)
        before, back = self._places[-1], round(self._config.course_m / self._config.step_m)
        step_rad = _direction_rad(before.pose, pose)
        bend_rad = 0.0 if before.step_rad is None else self._bend_rad(step_rad - before.step_rad)
        course_rad = _direction_rad(self._places[-back].pose, pose) if len(self._places) >= back else None
        return _Place(pose, self.distance_m, before.turned_rad + bend_rad, step_rad, course_rad)

    def _bend_rad(self, change_rad: float) -> float:
        """Positive to the left."""
        bend_rad = wrap_angle(change_rad)
        is_sharp = self._side * bend_rad > self._config.sharpest_rad
        return bend_rad - self._side * math.tau if is_sharp else bend_rad

    def _turns_since(self, place: _Place, here: _Place) -> float:
        """0 where the robot does not go the same way as then."""
        config, way_m = self._config, here.distance_m - place.distance_m
        turns = -self._side * (here.turned_rad - place.turned_rad) / math.tau
        if way_m < (config.distance_m if turns > 0 else config.island_m) or abs(turns) < config.turns:
            return 0.0
        if here.course_rad is None or place.course_rad is None:
            return 0.0
        gate_m = min(config.gate_m + config.drift_per_m * way_m, config.farthest_m)
        apart_rad = abs(wrap_angle(here.course_rad - place.course_rad))
        same = apart_rad < config.course_rad and here.pose.distance_m(place.pose) < gate_m
        return turns if same else 0.0


def _direction_rad(start: Pose2, end: Pose2) -> float:
    return math.atan2(end.y_m - start.y_m, end.x_m - start.x_m)
