"""Fuzzy path follower of a robot that can move sideways: it slides onto the path and faces the way it goes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.control.fuzzy import RuleTable, Variable
from robot_app.control.omni.wall_follower import ANGLE, BEND, TURN
from robot_app.control.path_follower import PathState
from shared.geometry.omni3 import STAND_STILL, Twist
from shared.geometry.se2 import Pose2, wrap_angle


@dataclass(frozen=True, slots=True)
class OmniPathConfig:
    slow_mps: float = 0.09
    medium_mps: float = 0.20
    fast_mps: float = 0.40
    slide_mps: float = 0.12  # to the side, at most
    turn_radps: float = 1.2
    look_ahead_m: float = 0.25
    face_m: float = 0.30  # nearer to the end than this it turns to the heading that is wanted there
    deceleration_mps2: float = 0.3  # towards the goal
    reached_m: float = 0.010
    reached_rad: float = 0.05
    approach_per_s: float = 1.5  # of the way that is left, at the end
    lost_m: float = 0.40
    window_m: float = 0.50  # how far along the path it may be from where it was a step ago
    settle_timeout_s: float = 6.0  # at the end; then it is as near as it gets


@dataclass(frozen=True, slots=True)
class OmniPathStep:
    """`cross_track_m`: positive left of the path; `left_m`: way to the goal."""

    twist: Twist
    state: PathState
    cross_track_m: float
    left_m: float


OFFSET = Variable.partition("offset from the path", right=-0.12, bit_right=-0.03, on_it=0.0, bit_left=0.03, left=0.12)
SLIDE = Variable.partition("slide", RR=-1.0, R=-0.4, o=0.0, L=0.4, LL=1.0)
LEFT = Variable.partition("way that is left", little=0.05, some=0.3, much=0.8)
SLIDE_RULES = RuleTable(
    LEFT,
    OFFSET,
    SLIDE,
    # offset: right bit_right on_it bit_left left
    """
    little    LL    L         o     R        RR
    some      LL    L         o     R        RR
    much      L     L         o     R        R
    """,
)
SPEED = Variable.partition("speed", stop=0.0, slow=1.0, medium=2.0, fast=3.0)
SPEED_RULES = RuleTable(
    LEFT,
    BEND,
    SPEED,
    # angle:  straight bend   sharp behind
    """
    little    slow     slow   slow  slow
    some      medium   medium slow  stop
    much      fast     medium slow  stop
    """,
)
HURRY = Variable.partition("way that is left, to turn in", little=0.1, much=0.5)
TURN_RULES = RuleTable(
    ANGLE,
    HURRY,
    TURN,
    # way left:    little much
    """
    behind_right   RR     RR
    right          RR     R
    bit_right      R      r
    ahead          o      o
    bit_left       L      l
    left           LL     L
    behind_left    LL     LL
    """,
)


class OmniPathFollower:
    """Follows one path. Step it at 25 Hz or more."""

    def __init__(self, config: OmniPathConfig, path: NDArray[np.floating]) -> None:
        """`path`: (N, 3) as in `GoTo`, odom frame; of its headings only the last one matters here."""
        self._config = config
        self._path = np.asarray(path, np.float64)
        steps = np.hypot(*np.diff(self._path[:, :2], axis=0).T)
        self._along = np.concatenate(([0.0], np.cumsum(steps)))
        self._at_m = 0.0
        self._near_since_s: float | None = None
        self._state = PathState.FOLLOWING

    @property
    def _length_m(self) -> float:
        return float(self._along[-1])

    def step(self, now_s: float, odom_from_robot: Pose2) -> OmniPathStep:
        """After DONE or LOST the robot is to stand."""
        if self._state in {PathState.DONE, PathState.LOST}:
            return OmniPathStep(STAND_STILL, self._state, 0.0, 0.0)
        self._at_m = self._project(odom_from_robot)
        left_m = self._length_m - self._at_m
        here, ahead = self._point(self._at_m), self._point(self._at_m + self._config.look_ahead_m)
        offset = _left_of(here, ahead, odom_from_robot)
        if math.dist(here, (odom_from_robot.x_m, odom_from_robot.y_m)) > self._config.lost_m:
            self._state = PathState.LOST
            return OmniPathStep(STAND_STILL, self._state, offset, left_m)
        if left_m < self._config.face_m / 2:
            return self._arrive(now_s, odom_from_robot, offset, left_m)
        return self._go(odom_from_robot, ahead, offset, left_m)

    def _go(self, pose: Pose2, ahead: tuple[float, float], offset: float, left_m: float) -> OmniPathStep:
        config = self._config
        x, y = pose.inverse().apply(np.array([ahead]))[0].tolist()
        angle = math.atan2(y, x)
        facing = angle if left_m > config.face_m else wrap_angle(float(self._path[-1, 2]) - pose.theta_rad)
        level = SPEED_RULES(left_m, abs(angle) if left_m > config.face_m else 0.0)
        speed = float(np.interp(level, (0, 1, 2, 3), (0.0, config.slow_mps, config.medium_mps, config.fast_mps)))
        speed = min(speed, 0.05 + math.sqrt(2 * config.deceleration_mps2 * left_m))
        slide = SLIDE_RULES(left_m, offset) * config.slide_mps if speed > 0 else 0.0
        c, s = math.cos(angle), math.sin(angle)
        turn = TURN_RULES(facing, left_m) * config.turn_radps
        return OmniPathStep(Twist(speed * c - slide * s, speed * s + slide * c, turn), self._state, offset, left_m)

    def _arrive(self, now_s: float, pose: Pose2, offset: float, left_m: float) -> OmniPathStep:
        """Straight to the last point, turning to its heading."""
        config = self._config
        self._near_since_s = now_s if self._near_since_s is None else self._near_since_s
        x, y = pose.inverse().apply(self._path[-1:, :2])[0].tolist()
        away_m, off = math.hypot(x, y), wrap_angle(float(self._path[-1, 2]) - pose.theta_rad)
        there = away_m < config.reached_m and abs(off) < config.reached_rad
        if there or now_s - self._near_since_s > config.settle_timeout_s:
            self._state = PathState.DONE
            return OmniPathStep(STAND_STILL, self._state, offset, away_m)
        speed = min(config.medium_mps, config.approach_per_s * away_m) if away_m >= config.reached_m else 0.0
        share = speed / max(away_m, 1e-6)
        turn = TURN_RULES(off, 0.0) * config.turn_radps
        return OmniPathStep(Twist(share * x, share * y, turn), self._state, offset, left_m)

    def _project(self, pose: Pose2) -> float:
        """How far along the path the robot is, looked for near where it was."""
        samples = np.linspace(max(self._at_m - 0.05, 0.0), min(self._at_m + self._config.window_m, self._length_m), 56)
        x = np.interp(samples, self._along, self._path[:, 0]) - pose.x_m
        y = np.interp(samples, self._along, self._path[:, 1]) - pose.y_m
        return float(samples[int(np.argmin(x * x + y * y))])

    def _point(self, along_m: float) -> tuple[float, float]:
        x = np.interp(along_m, self._along, self._path[:, 0])
        y = np.interp(along_m, self._along, self._path[:, 1])
        return float(x), float(y)


def _left_of(here: tuple[float, float], ahead: tuple[float, float], pose: Pose2) -> float:
    dx, dy = ahead[0] - here[0], ahead[1] - here[1]
    return (dx * (pose.y_m - here[1]) - dy * (pose.x_m - here[0])) / max(math.hypot(dx, dy), 1e-6)
