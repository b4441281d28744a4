"""Drives: composes the controllers, from the mission's behaviour down to the motor's duty (paper 1, figure 4)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robot_app.config import ControlConfig
from robot_app.control.explorer import Explorer, Leg, LegEnd, Task
from robot_app.control.motion import STAND_STILL, Motion
from robot_app.control.obstacle_avoidance import AvoidanceState, Avoided, ObstacleAvoidance, Wish
from robot_app.control.obstacle_memory import ObstacleMemory
from robot_app.control.path_follower import PathFollower, PathState
from robot_app.control.round_watch import RoundWatch
from robot_app.control.seen_ground import SeenGround
from robot_app.control.speed import SpeedController
from robot_app.control.wall_follower import WallFollower, WallState
from robot_app.drivers.base import DriveSetting, EncoderCount, ImuSample, RawScan
from robot_app.mission import Behaviour, Mission, MissionConfig, PathOrder
from robot_app.safety.motors import HardBrake
from robot_app.sensing.odometry import Odometry, OdometryConfig, OdometryState
from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry, Start

_FREE_STEERING_RAD = 0.6  # the wall follower's steering may be changed as the obstacles ask
_PATH_STEERING_RAD = 0.12  # a planned path is free already; only small corrections are taken
_WARM_UP_BEAMS, _WARM_UP_STEPS = 227, 60
_TASKS = {Behaviour.EXPLORE: Task.EXPLORE, Behaviour.GO_HOME: Task.HOME}
_BLOCKED_S = 1.5  # a leg that is blocked for so long is given up
_HAND_STEERING_RAD = 0.0  # the operator steers; the car only refuses to hit things


@dataclass(frozen=True, slots=True)
class PilotState:
    """What telemetry shows."""

    steering_rad: float
    following_goal: int
    blocked: bool


class Pilot:
    """Step it at 50 Hz. One thread."""

    def __init__(self, car: CarGeometry, config: ControlConfig, mission: Mission, odometry: Odometry) -> None:
        self._car = car
        self._config = config
        self._mission = mission
        self._odometry = odometry
        self._memory = ObstacleMemory(config.memory)
        self._ground = SeenGround(car, config.ground)
        self._wall = WallFollower(car, config.wall)
        self._path: PathFollower | None = None
        self._avoidance = ObstacleAvoidance(car, config.avoidance)
        self._explorer = Explorer(car, config.explorer)
        self._round = RoundWatch(config.round)
        self._leg: Leg | None = None
        self._blocked_s: float | None = None
        self._seen_scan: tuple[RawScan, ScanGeometry] | None = None
        self._task = Task.NONE
        self._number = self._round_of = mission.number
        mission.explores = True
        self._speed = SpeedController(config.speed)
        self._brake = HardBrake(self._pushing)
        self._behaviour = Behaviour.STAND
        self._is_held = False
        self._order: PathOrder | None = None
        self._steering_rad = 0.0
        self._scan_stamp_s = -np.inf
        self._points_m: NDArray[np.float64] = np.zeros((0, 2))
        self._avoided = Avoided(STAND_STILL, AvoidanceState.CLEAR, 0.0, 0.0)

    @property
    def state(self) -> PilotState:
        order = self._order
        return PilotState(
            self._steering_rad,
            order.goal_id if order is not None and self._behaviour is Behaviour.FOLLOW_PATH else 0,
            self._avoided.state is AvoidanceState.BLOCKED,
        )

    def take_scan(self, scan: RawScan, geometry: ScanGeometry) -> None:
        """Remember what stands where."""
        seen = self._odometry.at(scan.stamp_s)
        if seen is None or scan.stamp_s <= self._scan_stamp_s:
            return
        self._scan_stamp_s = scan.stamp_s
        self._memory.add_scan(
            scan.stamp_s, scan.ranges_m, geometry, seen.odom_from_robot, seen.speed_mps, seen.yaw_rate_radps
        )
        self._ground.add_scan(scan.ranges_m, geometry, seen.odom_from_robot)
        self._seen_scan = scan, geometry

    def explore(self, now_s: float) -> None:
        """Note what was seen, and plan; a few times a second, in a thread of its own: a plan takes a while."""
        seen = self._seen_scan
        pose = self._odometry.at(seen[0].stamp_s) if seen is not None else None
        if seen is None or pose is None:
            return
        state = self._odometry.state
        if self._mission.number != self._number:
            self._number = self._mission.number
            self._explorer.clear()
        self._explorer.look(seen[0].ranges_m, seen[1], pose.odom_from_robot, state.distance_m)
        task = _TASKS.get(self._mission.behaviour(now_s), Task.NONE)
        if task is not self._task:
            self._explorer.begin(task, self._mission.home or Pose2())
            self._task = task
        self._explorer.step(state.odom_from_robot, state.speed_mps)

    def step(self, now_s: float, may_move: bool) -> DriveSetting:
        """What the motor and the servo are to do now."""
        state = self._odometry.state
        behaviour = self._mission.behaviour(now_s)
        if behaviour is not self._behaviour:
            self._begin(behaviour)
        elif may_move and self._is_held:  # the lap goes on, what was timed does not
            self._avoidance.reset()
            self._round.go_on()
            self._blocked_s = None
        self._is_held = not may_move
        if behaviour is Behaviour.STAND or not may_move:
            motion = Motion(0.0, self._steering_rad)
        else:
            motion = self._drive(now_s, behaviour, state)
        self._steering_rad = motion.steering_rad
        return DriveSetting(self._speed.step(now_s, motion.speed_mps, state.speed_mps), motion.steering_rad)

    @property
    def rolling_mps(self) -> float:
        """How fast the driven wheels roll, as measured."""
        return self._odometry.state.speed_mps

    @property
    def brake(self) -> HardBrake:
        return self._brake

    def _pushing(self, duty: float) -> DriveSetting:
        """With this duty, and the wheels steered as they are."""
        return DriveSetting(duty, self._steering_rad)

    def cut(self) -> None:
        """The motor was cut from outside: forget what the speed loop has wound up."""
        self._speed.reset()

    def _begin(self, behaviour: Behaviour) -> None:
        self._behaviour = behaviour
        if behaviour is not Behaviour.STAND:
            self._avoidance.reset()
        if behaviour is not Behaviour.FOLLOW_WALL:
            return
        self._round.go_on()
        if self._mission.number != self._round_of:  # a round that was paused, or stopped, goes on
            self._round_of = self._mission.number
            self._wall.reset()
            self._round.reset()

    def _drive(self, now_s: float, behaviour: Behaviour, state: OdometryState) -> Motion:
        pose = state.odom_from_robot
        self._points_m = self._memory.points_m(now_s, pose)
        if behaviour in _TASKS:
            self._points_m = np.vstack((self._points_m, self._explorer.things_m))
        wish = self._limited(self._wish(now_s, behaviour, state))
        unseen_m = self._ground.unseen_m(pose)
        self._avoided = self._avoidance.step(
            now_s, wish, self._points_m, pose, state.speed_mps, self._steering_rad, unseen_m
        )
        return self._avoided.motion

    def _limited(self, wish: Wish) -> Wish:
        if not (math.isfinite(wish.motion.speed_mps) and math.isfinite(wish.motion.steering_rad)):
            raise ValueError(f"{self._behaviour.value} asks for {wish.motion}, which is no motion")
        fastest, sharpest = self._config.max_speed_mps, self._car.max_steering_rad
        motion = Motion(
            max(-fastest, min(fastest, wish.motion.speed_mps)),
            max(-sharpest, min(sharpest, wish.motion.steering_rad)),
        )
        return replace(wish, motion=motion)

    def _wish(self, now_s: float, behaviour: Behaviour, state: OdometryState) -> Wish:
        if behaviour is Behaviour.BY_HAND:
            return Wish(self._mission.hand_motion(now_s) or STAND_STILL, _HAND_STEERING_RAD)
        if behaviour is Behaviour.FOLLOW_PATH:
            return self._path_wish(now_s, state)
        if behaviour in _TASKS:
            return self._leg_wish(now_s, state)
        return self._wall_wish(now_s, state)

    def _wall_wish(self, now_s: float, state: OdometryState) -> Wish:
        step = self._wall.step(self._points_m, state.odom_from_robot, self._avoided.clearance_ahead_m)
        blocked = self._avoided.state is AvoidanceState.BLOCKED
        seen_m2 = self._explorer.seen_m2
        brings_nothing = self._round.is_over(now_s, state.odom_from_robot, state.distance_m, blocked, seen_m2)
        self._mission.observed(state.distance_m, step.state is WallState.DONE, brings_nothing)
        return Wish(step.motion, _FREE_STEERING_RAD, step.carrot_m, may_reverse=True)

    def _leg_wish(self, now_s: float, state: OdometryState) -> Wish:
        """Along what the explorer has planned; it stands while there is nothing."""
        if self._explorer.finished and self._task is _TASKS[self._behaviour]:
            if self._task is Task.HOME:
                self._mission.returned(self._explorer.found_way)
            else:
                self._mission.explored()
        leg = self._explorer.leg
        if leg is None:
            return Wish(STAND_STILL)
        if leg is not self._leg or self._path is None:
            self._leg, self._blocked_s = leg, None
            self._path = PathFollower(self._car, self._config.path, leg.path)
        step = self._path.step(now_s, state.odom_from_robot, state.speed_mps)
        blocked = self._avoided.state is AvoidanceState.BLOCKED
        self._blocked_s = (self._blocked_s or now_s) if blocked else None
        if step.state is PathState.DONE:
            self._explorer.end(LegEnd(leg.number, arrived=True))
        elif step.state is PathState.LOST or (self._blocked_s is not None and now_s - self._blocked_s > _BLOCKED_S):
            self._explorer.end(LegEnd(leg.number, arrived=False))
        return Wish(step.motion, _PATH_STEERING_RAD)

    def _path_wish(self, now_s: float, state: OdometryState) -> Wish:
        order = self._mission.order
        if order is None:
            return Wish(STAND_STILL)
        if order is not self._order or self._path is None:
            self._order = order
            self._path = PathFollower(self._car, self._config.path, order.path)
        step = self._path.step(now_s, state.odom_from_robot, state.speed_mps)
        if step.state in {PathState.DONE, PathState.LOST}:
            self._mission.path_ended(order)
        return Wish(step.motion, _PATH_STEERING_RAD)


def warm_up(car: CarGeometry, config: ControlConfig, geometry: ScanGeometry) -> None:
    """Compile every kernel of the control by following the wall of a narrow imaginary yard."""
    mission, odometry = Mission(MissionConfig()), Odometry(OdometryConfig(), car)
    mission.handle(Start(), 0.0)
    pilot = Pilot(car, config, mission, odometry)
    ranges_m = np.full(_WARM_UP_BEAMS, 0.6, np.float32)
    ranges_m[::7] = np.nan
    for i in range(_WARM_UP_STEPS):
        now_s = 0.05 * i
        odometry.update(EncoderCount(now_s, i, i), ImuSample(now_s, (0.0, 0.0, 0.0), (0.0, 0.0, 9.81)))
        pilot.take_scan(RawScan(now_s, ranges_m), geometry)
        pilot.step(now_s, may_move=True)
    mission.observed(0.0, came_round=False, is_over=True)
    for _ in range(2):
        pilot.explore(now_s)
        pilot.step(now_s, may_move=True)
