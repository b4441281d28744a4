"""Drives the omnidirectional robot: from the mission's behaviour down to the duty of each motor."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from robot_app.config import OmniControlConfig
from robot_app.control.motion import Motion
from robot_app.control.obstacle_memory import ObstacleMemory
from robot_app.control.omni.avoidance import OmniAvoidance, OmniAvoided, OmniWish
from robot_app.control.omni.hard_stop import HardStop
from robot_app.control.omni.homing import Homing, HomingState, Trail
from robot_app.control.omni.path_follower import OmniPathFollower
from robot_app.control.omni.wall_follower import OmniWallFollower
from robot_app.control.omni.wheel_speeds import OmniSpeedConfig, OmniSpeedController
from robot_app.control.path_follower import PathState
from robot_app.control.wall_follower import WallState
from robot_app.drivers.base import ImuSample, OmniCount, OmniSetting, RawScan
from robot_app.mission import Behaviour, Mission, MissionConfig, PathOrder
from robot_app.pilot import PilotState
from robot_app.sensing.odometry import Felt, Odometry, OdometryConfig, OdometryState
from shared.geometry.omni3 import STAND_STILL, OmniGeometry, Twist, Wheels
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry, Start

_WARM_UP_BEAMS, _WARM_UP_STEPS = 227, 60
_NO_WHEELS: Wheels = (0.0, 0.0, 0.0)
_FELT_MAX_AGE_S = 0.03
_TOLD_BEFORE_S = 0.15  # half of the window of the wheels' speeds, and the time until they count as too old


class OmniBrake:
    """Stops it hard. `moved`: the motion last asked of the wheels."""

    def __init__(
        self, omni: OmniGeometry, config: OmniSpeedConfig, odometry: Odometry, moved: Callable[[], Twist]
    ) -> None:
        self._omni = omni
        self._config = config
        self._odometry = odometry
        self._moved = moved
        self._stop = HardStop(omni, config.stop)
        self._began_s, self._from_mps = -math.inf, 0.0
        self._is_blind = False
        self._begins = False
        self._moves = STAND_STILL  # by what is felt, where the encoders do not tell it
        self._felt: Felt | None = None

    def begin(self, now_s: float, speed_mps: float, is_blind: bool = False) -> None:
        """`speed_mps` of the fastest wheel."""
        self._began_s, self._from_mps, self._is_blind = now_s, speed_mps, is_blind
        self._begins = True
        self._felt = None

    def push(self, now_s: float, speed_mps: float | None) -> OmniSetting | None:
        quick_mps = self._odometry.state.quick_mps
        known: Wheels | None = None
        if speed_mps is not None and not self._is_blind and quick_mps:
            known = (quick_mps[0], quick_mps[1], quick_mps[2])
        if self._begins:
            self._begins = False
            wheels_mps = (known or self._asked_mps()) if self._from_mps else _NO_WHEELS
            self._moves = self._omni.twist(wheels_mps)
            self._stop.begin(self._began_s, wheels_mps)
        felt = self._felt_mps(now_s) if known is None else None
        told_mps = self._stop.step(now_s, known or felt, are_felt=felt is not None)
        if told_mps is None:
            return None
        full_mps = self._config.wheel.full_duty_mps
        right, left, back = (max(-1.0, min(1.0, told / full_mps)) for told in told_mps)
        return OmniSetting((right, left, back))

    def _felt_mps(self, now_s: float) -> Wheels | None:
        """What the IMU makes of the motion that it had; None where it is silent too."""
        state, before = self._odometry.state, self._felt
        felt = self._felt = state.felt
        if felt is None or now_s - felt.stamp_s > _FELT_MAX_AGE_S:
            return None
        x, y, turn = self._moves.x_mps, self._moves.y_mps, state.yaw_rate_radps
        if before is not None:
            swept_rad = turn * (felt.stamp_s - before.stamp_s)  # the robot's axes turn under its way
            x, y = x + felt.x_mps - before.x_mps + swept_rad * y, y + felt.y_mps - before.y_mps - swept_rad * x
        self._moves = Twist(x, y, turn)
        return self._omni.wheels_mps(self._moves)

    def standing(self) -> OmniSetting:
        return OmniSetting(_NO_WHEELS)

    def _asked_mps(self) -> Wheels:
        """Where the encoders do not tell it: as was asked, but no faster than can have become of what they told."""
        asked = self._omni.wheels_mps(self._moved())
        gained_mps = self._config.acceleration_mps2 * _TOLD_BEFORE_S
        share = min(1.0, max(0.0, self._from_mps + gained_mps) / max(*map(abs, asked), 1e-9))
        right, left, back = (share * wheel for wheel in asked)
        return right, left, back


class OmniPilot:
    """Step it at 50 Hz. One thread."""

    def __init__(self, omni: OmniGeometry, config: OmniControlConfig, mission: Mission, odometry: Odometry) -> None:
        self._omni = omni
        self._config = config
        self._mission = mission
        self._odometry = odometry
        self._memory = ObstacleMemory(config.memory)
        self._wall = OmniWallFollower(config.wall)
        self._path: OmniPathFollower | None = None
        self._trail = Trail(config.homing)
        self._homing: Homing | None = None
        self._number = mission.number  # whose trail and round it is
        self._avoidance = OmniAvoidance(omni.radius_m, config.avoidance)
        self._speed = OmniSpeedController(omni, config.speed)
        self._behaviour = Behaviour.STAND
        self._order: PathOrder | None = None
        self._scan_stamp_s = -math.inf
        self._points_m: NDArray[np.float64] = np.zeros((0, 2))
        self._avoided = OmniAvoided(STAND_STILL, False, 0.0, 0.0)
        self._last_moved = STAND_STILL
        self._brake = OmniBrake(omni, config.speed, odometry, lambda: self._last_moved)

    @property
    def state(self) -> PilotState:
        """Its steering is the direction in which it moves, from where it faces."""
        order, moves = self._order, self._speed.reference
        direction = math.atan2(moves.y_mps, moves.x_mps) if moves.speed_mps > 0.01 else 0.0
        goal = order.goal_id if order is not None and self._behaviour is Behaviour.FOLLOW_PATH else 0
        return PilotState(direction, goal, self._avoided.is_blocked)

    def take_scan(self, scan: RawScan, geometry: ScanGeometry) -> None:
        """Remember what stands where."""
        seen = self._odometry.at(scan.stamp_s)
        if seen is None or scan.stamp_s <= self._scan_stamp_s:
            return
        self._scan_stamp_s = scan.stamp_s
        motion = seen.speed_mps, seen.yaw_rate_radps, seen.lateral_mps
        self._memory.add_scan(scan.stamp_s, scan.ranges_m, geometry, seen.odom_from_robot, *motion)

    def explore(self, now_s: float) -> None:
        """It plans nothing: the round along the walls is the whole observation, and the trail the way home."""

    def step(self, now_s: float, may_move: bool) -> OmniSetting:
        """What the motors are to do now."""
        state = self._odometry.state
        if self._mission.number != self._number:
            self._number = self._mission.number
            self._wall.reset()
            self._trail.clear()
        self._trail.add(state.odom_from_robot)
        behaviour = self._mission.behaviour(now_s) if may_move else Behaviour.STAND
        if behaviour is not self._behaviour:
            self._begin(behaviour)
        wanted = STAND_STILL if behaviour is Behaviour.STAND else self._drive(now_s, behaviour, state)
        right, left, back = state.wheels_mps or _NO_WHEELS
        if self._speed.reference != STAND_STILL:  # what the wheels were told until now: a hard brake begins with that
            self._last_moved = self._speed.reference
        duties = self._speed.step(now_s, wanted, (right, left, back))
        return OmniSetting(duties)

    @property
    def rolling_mps(self) -> float:
        """Of the fastest wheel, as measured; negative where the wheels roll against the motion last asked for."""
        now = self._odometry.state.wheels_mps or _NO_WHEELS
        along = sum(a * b for a, b in zip(now, self._omni.wheels_mps(self._last_moved), strict=True))
        return math.copysign(max(map(abs, now)), along)

    @property
    def brake(self) -> OmniBrake:
        return self._brake

    def cut(self) -> None:
        """The motors were cut from outside: forget what the speed loops have wound up."""
        self._speed.reset()

    def _begin(self, behaviour: Behaviour) -> None:
        self._behaviour = behaviour
        self._avoidance.reset()
        self._homing = None

    def _drive(self, now_s: float, behaviour: Behaviour, state: OdometryState) -> Twist:
        pose = state.odom_from_robot
        self._points_m = self._memory.points_m(now_s, pose)
        wish = self._limited(self._wish(now_s, behaviour, state))
        points = pose.inverse().apply(self._points_m)
        self._avoided = self._avoidance.step(wish, points, (state.speed_mps, state.lateral_mps))
        return self._avoided.twist

    def _limited(self, wish: OmniWish) -> OmniWish:
        twist, fastest = wish.twist, self._config.max_speed_mps
        if not twist.is_finite:
            raise ValueError(f"{self._behaviour.value} asks for {twist}, which is no motion")
        share = min(1.0, fastest / max(twist.speed_mps, 1e-9))
        return OmniWish(Twist(share * twist.x_mps, share * twist.y_mps, twist.turn_radps), wish.freedom_rad)

    def _wish(self, now_s: float, behaviour: Behaviour, state: OdometryState) -> OmniWish:
        if behaviour is Behaviour.BY_HAND:
            return self._hand_wish(self._mission.hand_motion(now_s))
        if behaviour is Behaviour.FOLLOW_PATH:
            return self._path_wish(now_s, state)
        if behaviour is Behaviour.FOLLOW_WALL:
            return self._wall_wish(state)
        if behaviour is Behaviour.GO_HOME:
            return self._home_wish(now_s, state)
        return OmniWish(STAND_STILL)  # the mission asks nobody to explore who does not say that he does

    def _hand_wish(self, motion: Motion | None) -> OmniWish:
        """The stick to the side turns the robot, also where it stands."""
        if motion is None:
            return OmniWish(STAND_STILL)
        return OmniWish(Twist(motion.speed_mps, 0.0, self._config.hand_turn_per_s * motion.steering_rad))

    def _wall_wish(self, state: OdometryState) -> OmniWish:
        step = self._wall.step(self._points_m, state.odom_from_robot, self._avoided.clearance_ahead_m)
        self._mission.observed(state.distance_m, step.state is WallState.DONE)
        return OmniWish(step.twist, self._config.wall_freedom_rad)

    def _home_wish(self, now_s: float, state: OdometryState) -> OmniWish:
        """The odometry has drifted since it came this way, so it may go beside it as it does along a wall."""
        if self._homing is None:
            home = self._mission.home or Pose2()
            self._homing = Homing(self._config.homing, self._config.path, self._omni.radius_m, home)
        pose, blocked = state.odom_from_robot, self._avoided.is_blocked
        step = self._homing.step(now_s, pose, self._trail, self._points_m, blocked)
        if step.state is not HomingState.UNDER_WAY:
            self._wall.reset()  # an observation that goes on from here begins a new round
            self._mission.returned(step.state is HomingState.HOME)
        return OmniWish(step.twist, self._config.wall_freedom_rad)

    def _path_wish(self, now_s: float, state: OdometryState) -> OmniWish:
        order = self._mission.order
        if order is None:
            return OmniWish(STAND_STILL)
        if order is not self._order or self._path is None:
            self._order = order
            self._path = OmniPathFollower(self._config.path, order.path)
        step = self._path.step(now_s, state.odom_from_robot)
        if step.state in {PathState.DONE, PathState.LOST}:
            self._mission.path_ended(order)
        return OmniWish(step.twist, self._config.path_freedom_rad)


def warm_up_omni(omni: OmniGeometry, config: OmniControlConfig, geometry: ScanGeometry) -> None:
    """Compile every kernel of the control by following the wall of a narrow imaginary yard."""
    mission, odometry = Mission(MissionConfig()), Odometry(OdometryConfig(), omni)
    mission.handle(Start(), 0.0)
    pilot = OmniPilot(omni, config, mission, odometry)
    ranges_m = np.full(_WARM_UP_BEAMS, 0.6, np.float32)
    ranges_m[::7] = np.nan
    for i in range(_WARM_UP_STEPS):
        now_s = 0.1 * i
        turn_radps = 2.5 if i < _WARM_UP_STEPS // 2 else 0.0  # the look round comes first
        odometry.update(OmniCount(now_s, (i, i, i)), ImuSample(now_s, (0.0, 0.0, turn_radps), (0.0, 0.0, 9.81)))
        pilot.take_scan(RawScan(now_s, ranges_m), geometry)
        pilot.step(now_s, may_move=True)
