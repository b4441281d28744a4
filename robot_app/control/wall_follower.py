"""Fuzzy wall follower: once round the room with the wall at one side (paper 1, section 2.2)."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from robot_app.control.fuzzy import paper_speeds
from robot_app.control.motion import Motion
from robot_app.control.wall_rules import WallRulesConfig
from robot_app.control.wall_trace import WallTraceConfig, WallTracer
from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2, wrap_angle


class WallState(IntEnum):
    SEARCH = 0  # no wall in sight: straight on until there is one
    FOLLOW = 1
    LEAVE = 2  # what was gone round stands free in the room: cross over to another wall
    DONE = 3  # once round the room


@dataclass(frozen=True, slots=True)
class WallFollowerConfig:
    side: int = -1  # where the wall is kept: -1 right, +1 left
    trace: WallTraceConfig = field(default_factory=WallTraceConfig)
    rules: WallRulesConfig = field(default_factory=WallRulesConfig)
    middle_m: float = 0.13  # the point of the car that is to be on the way, ahead of its origin
    look_ahead_m: float = 0.40  # from there to the point of the way it heads for
    slow_mps: float = 0.08  # paper 1, section 4: slow is below 0.1, medium 0.2, fast above 0.4
    medium_mps: float = 0.20
    fast_mps: float = 0.32  # below the paper's "fast": the room is small
    corner_m: float = 1.6  # how far along the way inner corners are looked for
    corner_aside_m: float = 0.8  # beyond this to the side there is room to turn later
    lap_distance_m: float = 4.0  # no lap is shorter
    lap_gate_m: float = 0.4  # the lap ends this near to a place where the robot was before
    crossed_m: float = 0.5  # an island is left when something else is so near ahead
    leave_limit_m: float = 4.0
    track_step_m: float = 0.1  # such places are remembered this often
    track_length: int = 800  # as far as an observation may go

    def __post_init__(self) -> None:
        if self.side not in {-1, 1}:
            raise ValueError(f"side must be -1 (right) or 1 (left), not {self.side}")
        paper_speeds(self.slow_mps, self.medium_mps, self.fast_mps)


@dataclass(frozen=True, slots=True)
class WallStep:
    """`carrot_m`: where the robot is heading, robot frame, None while no wall is in sight."""

    motion: Motion
    state: WallState
    carrot_m: tuple[float, float] | None
    lateral_error_m: float  # of the car's middle from the way, positive left of it
    angle_rad: float  # of the way ahead, seen from the robot


@dataclass(frozen=True, slots=True)
class _Mark:
    """A place the robot passed while following, and how far it had driven and turned by then."""

    pose: Pose2
    distance_m: float
    turned_rad: float


class WallFollower:
    """Turns the obstacles near the robot into a wish: steering and speed along the wall."""

    def __init__(self, car: CarGeometry, config: WallFollowerConfig) -> None:
        self._car = car
        self._config = config
        self._steering, self._away, self._speed = config.rules.steering, config.rules.turn_away, config.rules.speed
        self._tracer = WallTracer(config.trace, config.side)
        self.reset()

    def reset(self) -> None:
        """Begin a new lap wherever the robot is."""
        self._state = WallState.SEARCH
        self._track: deque[_Mark] = deque(maxlen=self._config.track_length)
        self._last: Pose2 | None = None
        self._distance_m = 0.0
        self._turned_rad = 0.0
        self._leave_heading_rad = 0.0
        self._left_at_m = 0.0

    @property
    def state(self) -> WallState:
        return self._state

    def step(self, points_m: NDArray[np.float64], odom_from_robot: Pose2, clearance_ahead_m: float) -> WallStep:
        """`points_m`: (N, 2) obstacles, odom frame; `clearance_ahead_m`: how far the car can go as it steers now."""
        self._travel(odom_from_robot)
        if self._state is WallState.LEAVE and not self._has_crossed(odom_from_robot, clearance_ahead_m):
            return self._cross(odom_from_robot, clearance_ahead_m)
        trace = self._tracer.trace(points_m, odom_from_robot)
        if trace is None:
            return self._go_straight(clearance_ahead_m)
        step = self._follow(odom_from_robot.inverse().apply(trace.way_m), clearance_ahead_m)
        self._judge_lap(odom_from_robot)
        return step

    def _travel(self, pose: Pose2) -> None:
        if self._last is not None:
            self._distance_m += pose.distance_m(self._last)
            self._turned_rad += wrap_angle(pose.theta_rad - self._last.theta_rad)
        self._last = pose

    def _go_straight(self, clearance_ahead_m: float) -> WallStep:
        if self._state is WallState.FOLLOW:
            self._state = WallState.SEARCH
        speed = min(self._speed_mps(clearance_ahead_m, 0.0), self._config.medium_mps)
        return WallStep(Motion(speed, 0.0), self._state, None, 0.0, 0.0)

    def _follow(self, way_m: NDArray[np.float64], clearance_ahead_m: float) -> WallStep:
        """`way_m`: (N, 2), robot frame."""
        if self._state in {WallState.SEARCH, WallState.LEAVE}:
            self._state = WallState.FOLLOW
        ahead, error = self._carrot(way_m)
        angle = math.atan2(ahead[1], ahead[0] - self._config.middle_m)
        share = self._turn_away(way_m, error, self._steering(angle, error))
        speed = self._speed_mps(clearance_ahead_m, abs(share))
        motion = Motion(speed, share * self._car.max_steering_rad)
        return WallStep(motion, self._state, (float(ahead[0]), float(ahead[1])), error, angle)

    def _turn_away(self, way_m: NDArray[np.float64], error_m: float, share: float) -> float:
        """Steer away from the wall before an inner corner, so early that the car gets round it in one go.

        The circle that leaves the rear axle straight on and meets the way at (x, y) has the curvature
        2 y / (x² + y²); the sharpest one that the way ahead asks for tells how soon the turn must begin.
        """
        away = -self._config.side
        reach = way_m[: round(self._config.corner_m / self._config.trace.step_m)]
        reach = reach[(reach[:, 0] > 0.0) & (away * reach[:, 1] < self._config.corner_aside_m)]
        if len(reach) == 0:
            return share
        curvature = float(np.max(2 * away * reach[:, 1] / np.maximum((reach**2).sum(axis=1), 0.04)))
        turn = self._away(curvature * self._car.min_turning_radius_m, away * error_m)
        return float(away * (away * share + turn * (1.0 - away * share)))

    def _carrot(self, way_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """The point of the way to head for, and how far left of the way the car's middle is."""
        middle = np.array([self._config.middle_m, 0.0])
        gaps = np.hypot(*(way_m - middle).T)
        nearest = int(np.argmin(gaps[: max(2, len(way_m) // 2)]))
        beyond = np.flatnonzero(gaps[nearest:] >= self._config.look_ahead_m)
        ahead = way_m[nearest + int(beyond[0])] if len(beyond) else way_m[-1]
        a, b = way_m[max(nearest - 1, 0)], way_m[min(nearest + 1, len(way_m) - 1)]
        along = (b - a) / max(float(np.hypot(*(b - a))), 1e-6)
        offset = middle - way_m[nearest]
        return ahead, float(along[0] * offset[1] - along[1] * offset[0])

    def _speed_mps(self, clearance_ahead_m: float, turn: float) -> float:
        config = self._config
        level = self._speed(clearance_ahead_m, turn)
        return float(np.interp(level, (0, 1, 2, 3), (0.0, config.slow_mps, config.medium_mps, config.fast_mps)))

    def _judge_lap(self, pose: Pose2) -> None:
        """A lap of the room turns the robot once towards the open side; a lap of an island the other way."""
        if self._track and self._distance_m - self._track[-1].distance_m <= self._config.track_step_m:
            return
        self._track.append(_Mark(pose, self._distance_m, self._turned_rad))
        for mark in tuple(self._track):
            if self._distance_m - mark.distance_m < self._config.lap_distance_m:
                break
            heading_off = abs(wrap_angle(pose.theta_rad - mark.pose.theta_rad))
            if pose.distance_m(mark.pose) < self._config.lap_gate_m and heading_off < 1.0:
                self._close_lap(pose, -self._config.side * (self._turned_rad - mark.turned_rad) / math.tau)
                return

    def _close_lap(self, pose: Pose2, laps: float) -> None:
        if laps > 0.7:
            self._state = WallState.DONE
        elif laps < -0.7:
            self._begin_crossing(pose)

    def _begin_crossing(self, pose: Pose2) -> None:
        self._state = WallState.LEAVE
        self._track.clear()
        self._left_at_m = self._distance_m
        self._leave_heading_rad = pose.theta_rad - self._config.side * math.pi / 2

    def _has_crossed(self, pose: Pose2, clearance_ahead_m: float) -> bool:
        """Facing what stands at the other side; in any case after some way, however it went."""
        faces = abs(wrap_angle(self._leave_heading_rad - pose.theta_rad)) < 0.7
        reached = faces and 0.0 < clearance_ahead_m < self._config.crossed_m
        return reached or self._distance_m - self._left_at_m > self._config.leave_limit_m

    def _cross(self, pose: Pose2, clearance_ahead_m: float) -> WallStep:
        off = wrap_angle(self._leave_heading_rad - pose.theta_rad)
        steering = max(-1.0, min(1.0, 1.5 * off)) * self._car.max_steering_rad
        speed = self._speed_mps(clearance_ahead_m, abs(steering) / self._car.max_steering_rad)
        carrot = (self._config.middle_m + 0.5 * math.cos(off), 0.5 * math.sin(off))
        return WallStep(Motion(speed, steering), self._state, carrot, 0.0, off)
