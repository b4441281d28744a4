"""Brings the car to the floor that was not seen yet, home to where it started, and out of dead ends.

The robot does this by itself, on the floor map of its own, so that neither a slow link nor a silent one matters. It
goes where the most unseen floor comes into sight for the way to get there (next best view), over the ways that a car
has, reversing included. Floor that ought to have been seen from a place and was not does not call again.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from robot_app.control.ground.floor_map import FloorMap, FloorMapConfig
from robot_app.control.trail import Trail, TrailConfig
from robot_app.control.ways.ways import Ways, WaysBuffers, WaysConfig, path_room_m
from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2, wrap_angle
from shared.messages import ScanGeometry


@dataclass(frozen=True, slots=True)
class ExplorerConfig:
    floor: FloorMapConfig = field(default_factory=FloorMapConfig)
    ways: WaysConfig = field(default_factory=WaysConfig)
    trail: TrailConfig = field(default_factory=TrailConfig)
    coarsest: int = 3  # ways are so many times as coarse where finer ones do not get to all places
    margin_m: float = 0.045  # planned round the body; the avoidance insists on 3 cm
    least_view_m2: float = 0.05  # a place that shows less unseen floor is not worth going to
    least_yield_m: float = 0.01  # … nor one that shows less for each metre of the way (m² / m)
    way_bonus_m: float = 0.7  # views are weighed by floor shown over the way and this
    place_m: float = 0.25  # places looked at: the best of each square and each of so many headings
    headings: int = 8
    places: int = 2000  # the nearest so many are looked at first; farther ones where those show nothing
    finer: int = 2  # … and then this many times as densely, among the nearest only: slits show from few places
    finer_places: int = 6000
    home_m: float = 0.12  # so near to the start is home
    home_rad: float = 0.5
    retreat_m: float = 0.5  # back along the way it came, where no other leads on
    least_nodes: int = 60  # fewer poses are no way on
    attempts: int = 6  # without getting anywhere
    progress_m: float = 0.6  # getting somewhere
    things_m: float = 1.0  # what stands so near is told to the avoidance, which forgets after half a minute

    def __post_init__(self) -> None:
        if not 0.0 < self.least_view_m2 <= 1.0 or not 0.03 <= self.margin_m <= 0.2:
            raise ValueError("least_view_m2 must be from 0 to 1 and margin_m from 0.03 to 0.2")
        if not 1 <= self.coarsest <= 4:
            raise ValueError("coarsest must be from 1 to 4")


class Task(Enum):
    NONE = "none"
    EXPLORE = "explore"
    HOME = "home"


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """`path`: (N, 3) as of `PathFollower`, odom frame."""

    number: int
    path: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LegEnd:
    """What became of a leg: driven to its end, or not."""

    number: int
    arrived: bool


class Explorer:
    """Step it a few times a second in one thread; `leg`, `finished` and `end` may be used by another."""

    def __init__(self, car: CarGeometry, config: ExplorerConfig) -> None:
        self._car = car
        self._config = config
        self._floor = FloorMap(car, config.floor)
        self._trail = Trail(config.trail)
        self._buffers = WaysBuffers(config.ways)
        self._number = 0
        self._task = Task.NONE
        self.home = Pose2()
        self.things_m: NDArray[np.float64] = np.zeros((0, 2))  # odom frame, what stands near the robot
        self.seen_m2 = 0.0  # floor that is known to be free
        self.forget()

    def forget(self) -> None:
        """A new task begins."""
        self.leg: Leg | None = None
        self.finished = False
        self.found_way = True  # whether the task that is finished was done, or given up
        self._ended: LegEnd | None = None
        self._attempts = 0
        self._anchor: Pose2 | None = None
        self._shunned: deque[Pose2] = deque(maxlen=20)
        self._is_retreat = False

    def clear(self) -> None:
        """A new mission begins: it has seen nothing yet."""
        self._floor.clear()
        self._trail.clear()

    def begin(self, task: Task, home: Pose2) -> None:
        self._task = task
        self.home = home
        self.forget()

    def end(self, ended: LegEnd) -> None:
        """The leg was driven, or cannot be."""
        self._ended = ended

    def look(
        self,
        ranges_m: NDArray[np.floating],
        geometry: ScanGeometry,
        odom_from_robot: Pose2,
        way_m: float,
    ) -> None:
        """Take a scan made at this pose, after `way_m` driven."""
        self._geometry, self._beams = geometry, len(ranges_m)
        self._floor.add_scan(ranges_m, geometry, odom_from_robot)
        self.things_m = self._floor.things_m(odom_from_robot, self._config.things_m)
        self.seen_m2 = self._floor.seen_m2
        self._trail.add(odom_from_robot, way_m)

    @property
    def loop_closed(self) -> bool:
        """Whether the robot has been at one place twice, some way apart, so that the map's ends can meet."""
        return self._trail.loop_closed

    def step(self, odom_from_robot: Pose2, speed_mps: float) -> None:
        """Do what is due for the task."""
        if self._task is Task.NONE or self.finished or not len(self._trail):
            return
        leg, ended = self.leg, self._ended
        if leg is not None and ended is not None and ended.number == leg.number:
            self._close(leg, ended, odom_from_robot)
        elif leg is not None and self._still_good(leg, odom_from_robot):
            return
        self._plan(odom_from_robot, speed_mps)

    def _close(self, leg: Leg, ended: LegEnd, pose: Pose2) -> None:
        self.leg = None
        if self._anchor is None or pose.distance_m(self._anchor) > self._config.progress_m:
            self._anchor, self._attempts = pose, 0
        if not ended.arrived:
            self._attempts += 1
            self._shunned.append(Pose2.from_array(leg.path[-1]))

    def _still_good(self, leg: Leg, pose: Pose2) -> bool:
        """Free as far as it is left, and worth it."""
        if self._is_retreat:
            return True
        path = leg.path
        rest = path[int(np.argmin(np.hypot(path[:, 0] - pose.x_m, path[:, 1] - pose.y_m))) :]
        room = self._floor.room_along(np.vstack((pose.as_array(), rest)), self._config.margin_m - 0.015)
        start_room_m = path_room_m(self._car, room, pose.as_array()[None])
        if path_room_m(self._car, room, rest) < min(0.0, start_room_m):
            return False
        if self._task is Task.HOME or self._is_home_leg:
            return True
        view_m2 = self._floor.views_m2(path[-1:], self._geometry, self._beams)[0]
        return bool(view_m2 >= 0.6 * self._config.least_view_m2)

    def _plan(self, pose: Pose2, speed_mps: float) -> None:
        self.leg, self._is_retreat, self._is_home_leg = None, False, False
        room = self._floor.room_for_body(pose, self._config.margin_m)
        direction = 0.0 if abs(speed_mps) < 0.05 else math.copysign(1.0, speed_mps)
        if self._attempts >= self._config.attempts:
            self._finish(done=False)
            return
        for grain in range(1, self._config.coarsest + 1):
            ways = Ways(self._car, self._config.ways, room, pose, direction, self._buffers, grain)
            if grain == 1 and (len(ways) < self._config.least_nodes or self._attempts % 3 == 2):
                self._retreat(pose)
                return
            if self._goes_home(ways) if self._task is Task.HOME else self._explores(ways):
                return
            if ways.are_all:
                break
        if self._task is Task.HOME:
            self._finish(done=False)
        elif self.loop_closed or pose.distance_m(self.home) <= self._config.trail.loop_gate_m:
            self._finish(done=True)
        else:
            self._is_home_leg = True
            if not self._goes_home(ways):
                self._finish(done=False)

    def _explores(self, ways: Ways) -> bool:
        """Whether these ways lead to unseen floor."""
        config = self._config
        best = self._best_view(ways, ways.spread(config.place_m, config.headings))
        if best is None:
            dense = ways.spread(config.place_m / config.finer, config.headings * config.finer)
            best = self._best_view(ways, dense[: config.finer_places])
        if best is not None and best > 0:
            self._go(ways.path_to(best))
        return best is not None

    def _best_view(self, ways: Ways, nodes: NDArray[np.int64]) -> int | None:
        """Of these nodes, the one from which the most floor comes into sight for the way."""
        config = self._config
        for first in range(0, len(nodes), config.places):
            some = nodes[first : first + config.places]
            views_m2 = self._floor.views_m2(ways.poses[some], self._geometry, self._beams)
            scores = np.where(
                views_m2 >= config.least_view_m2, views_m2 / (ways.costs_m[some] + config.way_bonus_m), 0.0
            )
            for k in np.argsort(-scores, kind="stable").tolist():
                if scores[k] <= config.least_yield_m:
                    break
                if not self._is_shunned(ways.poses[some[k]]):
                    return int(some[k])
        return None

    def _is_shunned(self, pose: NDArray[np.float64]) -> bool:
        return any(
            math.hypot(pose[0] - s.x_m, pose[1] - s.y_m) < 0.2 and abs(wrap_angle(pose[2] - s.theta_rad)) < 0.6
            for s in self._shunned
        )

    def _goes_home(self, ways: Ways) -> bool:
        """Whether these ways lead home, or it is there."""
        config = self._config
        gates = ((config.home_m, config.home_rad), (config.home_m, math.pi), (3 * config.home_m, math.pi))
        for reach_m, turn_rad in gates:
            node = ways.nearest_to(self.home, reach_m, turn_rad)
            if node == 0:
                self._finish(done=True)
                return True
            if node is not None:
                self._go(ways.path_to(node))
                return True
        return False

    def _retreat(self, pose: Pose2) -> None:
        """Back along the way it came, which was free."""
        self._attempts += 1
        back = self._trail.back(pose, self._config.retreat_m)
        if len(back) < 3:
            self._finish(done=False)
            return
        self._is_retreat = True
        self._go(back)

    def _go(self, path: NDArray[np.float64]) -> None:
        self._number += 1
        self.leg = Leg(self._number, path)

    def _finish(self, done: bool) -> None:
        self.found_way = done
        self.finished = True
