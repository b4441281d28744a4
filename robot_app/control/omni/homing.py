"""Back to where the mission was started, along the way that the robot came: there the disc went through already."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from robot_app.control.omni.avoidance import lanes
from robot_app.control.omni.path_follower import OmniPathConfig, OmniPathFollower
from robot_app.control.path_follower import PathState
from shared.geometry.omni3 import STAND_STILL, Twist
from shared.geometry.se2 import Pose2

Floats = NDArray[np.float64]
_MOST_LANES = 24  # looked at in one step of the control: as many as the avoidance looks at


@dataclass(frozen=True, slots=True)
class HomingConfig:
    step_m: float = 0.08  # places are remembered this often …
    places: int = 2000  # … and half as often each time that there are more
    link_m: float = (
        0.15  # the disc goes straight between two places that are so near: they leave 18 mm of it beside them
    )
    cut_m: float = 1.4  # it goes straight to a place so near where nothing stands; the memory reaches 1.7 m
    cut_margin_m: float = 0.06
    again_m: float = 0.5  # it looks for such a place this often
    start_m: float = 0.4  # nearer to the start is home, where the last bit is blocked
    blocked_s: float = 1.5
    attempts: int = 5  # without getting anywhere …
    progress_m: float = 0.5  # … which is this

    def __post_init__(self) -> None:
        if not 0 < self.step_m < self.link_m or self.places < 100:
            raise ValueError("step_m must be positive and below link_m, places at least 100")


class Trail:
    """The way from the start to here. Where it comes to a place where it was, what lies between is left out."""

    def __init__(self, config: HomingConfig) -> None:
        self._config = config
        self._places_m = np.zeros((config.places, 2))
        self._count = 0

    @property
    def places_m(self) -> Floats:
        """(N, 2), odom frame, from the start on."""
        return self._places_m[: self._count]

    def clear(self) -> None:
        self._count = 0

    def add(self, odom_from_robot: Pose2) -> None:
        """To be called at every step."""
        config, here = self._config, np.array([odom_from_robot.x_m, odom_from_robot.y_m])
        if self._count and np.hypot(*(here - self._places_m[self._count - 1])) < config.step_m:
            return
        lately = 2 * math.ceil(config.link_m / config.step_m)
        near = np.flatnonzero(np.hypot(*(self.places_m[: max(self._count - lately, 0)] - here).T) < config.link_m)
        if len(near):
            self._count = int(near[0]) + 1
        if self._count == len(self._places_m):
            self._count = len(self._places_m[::2])
            self._places_m[: self._count] = self._places_m[::2].copy()
        self._places_m[self._count] = here
        self._count += 1


class HomingState(Enum):
    UNDER_WAY = "under way"
    HOME = "home"
    NO_WAY = "no way"


@dataclass(frozen=True, slots=True)
class HomingStep:
    twist: Twist
    state: HomingState


class Homing:
    """One way home. Step it at 25 Hz or more."""

    def __init__(self, config: HomingConfig, path: OmniPathConfig, radius_m: float, home: Pose2) -> None:
        """`home`: odom frame."""
        self._config = config
        self._path_config = path
        self._radius_m = radius_m
        self._home = home
        self._path: OmniPathFollower | None = None
        self._planned_at = self._anchor = Pose2()
        self._attempts = 0
        self._blocked_since_s: float | None = None

    def step(self, now_s: float, pose: Pose2, trail: Trail, points_m: Floats, blocked: bool) -> HomingStep:
        """`points_m`: (N, 2) obstacles, odom frame; `blocked`: whether the avoidance lets it go nowhere."""
        config = self._config
        if self._path is None:
            if self._is_lost(trail):
                return HomingStep(STAND_STILL, HomingState.NO_WAY)
            self._anchor = pose
            self._plan(pose, trail, points_m)
        elif self._failed(now_s, pose, blocked):
            self._attempts += 1
            if self._attempts >= config.attempts:
                near = pose.distance_m(self._home) < config.start_m
                return HomingStep(STAND_STILL, HomingState.HOME if near else HomingState.NO_WAY)
            self._plan(pose, trail, points_m)
        elif pose.distance_m(self._planned_at) > config.again_m:
            self._plan(pose, trail, points_m)
        assert self._path is not None
        step = self._path.step(now_s, pose)
        state = HomingState.HOME if step.state is PathState.DONE else HomingState.UNDER_WAY
        self._is_off = step.state is PathState.LOST
        return HomingStep(step.twist, state)

    def _is_lost(self, trail: Trail) -> bool:
        """After a restart the robot knows where it was started and not how it came from there."""
        places_m = trail.places_m
        start = (self._home.x_m, self._home.y_m)
        return not len(places_m) or float(np.hypot(*(places_m[0] - start))) > self._config.start_m

    def _failed(self, now_s: float, pose: Pose2, blocked: bool) -> bool:
        if pose.distance_m(self._anchor) > self._config.progress_m:
            self._anchor, self._attempts = pose, 0
        if not blocked:
            self._blocked_since_s = None
        elif self._blocked_since_s is None:
            self._blocked_since_s = now_s
        elif now_s - self._blocked_since_s > self._config.blocked_s:
            self._blocked_since_s = None
            return True
        return self._is_off

    def _plan(self, pose: Pose2, trail: Trail, points_m: Floats) -> None:
        """Straight to the place nearest to the start that can be reached so, and from there along the trail."""
        self._planned_at, self._is_off = pose, False
        places_m = np.vstack((trail.places_m, (pose.x_m, pose.y_m)))
        places_m[0] = self._home.x_m, self._home.y_m
        cut_m = self._config.cut_m if self._attempts == 0 else self._config.link_m
        first = self._first_within_reach(places_m, pose, points_m, cut_m)
        corners_m = np.vstack((places_m[-1], places_m[first::-1]))
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners_m, axis=0).T))))
        at = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / self._config.step_m)))
        x, y = (np.interp(at, along, corners_m[:, k]) for k in (0, 1))
        self._path = OmniPathFollower(
            self._path_config, np.column_stack((x, y, np.full(len(at), self._home.theta_rad)))
        )

    def _first_within_reach(self, places_m: Floats, pose: Pose2, points_m: Floats, cut_m: float) -> int:
        """The last place is where it is now."""
        seen_m = pose.inverse().apply(places_m[:-1])
        distances = np.hypot(*seen_m.T)
        near = np.flatnonzero(distances <= cut_m)
        near = near[:: 1 + len(near) // _MOST_LANES]
        directions = np.arctan2(seen_m[near, 1], seen_m[near, 0])
        robot_points_m = pose.inverse().apply(points_m)
        free_m = lanes(robot_points_m, directions, self._radius_m, self._config.cut_margin_m, 2 * cut_m).free_m
        reached = near[(free_m >= distances[near]) | (distances[near] <= self._config.link_m)]
        return int(reached[0]) if len(reached) else len(places_m) - 2
