"""Keeps the car from touching anything, whatever is asked of it (paper 1, section 2.2).

Among the steerings near the wanted one it takes the one whose swept ground is free for long enough, and never
drives faster than it can stop. Where no steering leads on, it reverses out, the way `turning` finds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from robot_app.control.footprint import NONE, Footprint, Sweep, SweepConfig
from robot_app.control.motion import STAND_STILL, Motion
from robot_app.control.turning import Turning, TurningConfig, find_turning
from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2


class AvoidanceState(IntEnum):
    CLEAR = 0
    REVERSING = 1  # backs out, or goes on forward after that
    BLOCKED = 2  # stands: there is no way on


@dataclass(frozen=True, slots=True)
class AvoidanceConfig:
    sweep: SweepConfig = field(default_factory=SweepConfig)
    turning: TurningConfig = field(default_factory=TurningConfig)
    steerings: int = 17  # tried between full right and full left
    horizon_m: float = 0.9
    comfortable_m: float = 0.6  # a steering free for this long is as good as any
    comfortable_clearance_m: float = 0.08
    latency_s: float = 0.2  # scan, control and servo
    deceleration_mps2: float = 0.8
    stuck_free_m: float = 0.08  # shorter ways on are not worth it to a wish that may reverse instead
    creep_mps: float = 0.03  # stands within a centimetre
    reverse_mps: float = 0.18
    stopping_mps2: float = 0.25  # towards the end of a stretch in reverse
    blind_mps: float = 0.06  # into ground that nobody has seen
    blind_m: float = 0.15  # no farther at once than this
    standing_mps: float = 0.02
    settle_s: float = 0.15  # for the wheels to turn before the car moves
    phase_timeout_s: float = 6.0
    attempts: int = 12  # reversals without getting anywhere
    progress_m: float = 0.6  # getting somewhere
    retry_s: float = 2.0  # how often a blocked robot looks again


@dataclass(frozen=True, slots=True)
class Wish:
    """What a controller wants.

    `freedom_rad`: how far the steering may be changed. `carrot_m`: where it wants to get, robot frame.
    `may_reverse`: whether a stretch in reverse may be put in when there is no way on.
    """

    motion: Motion
    freedom_rad: float = 0.0
    carrot_m: tuple[float, float] | None = None
    may_reverse: bool = False


@dataclass(frozen=True, slots=True)
class Avoided:
    """`clearance_ahead_m`: how far the car can go as it is steered; `clearance_m`: to the nearest thing on that way."""

    motion: Motion
    state: AvoidanceState
    clearance_ahead_m: float
    clearance_m: float


class _Phase(IntEnum):
    STOP = 0
    REVERSE = 1
    TURN_WHEELS = 2
    GO_ON = 3


@dataclass(slots=True)
class _Manoeuvre:
    turning: Turning
    phase: _Phase
    since_s: float
    begin: Pose2


class ObstacleAvoidance:
    """The last word on every motion. Step it at least 20 times a second."""

    def __init__(self, car: CarGeometry, config: AvoidanceConfig) -> None:
        self._car = car
        self._config = config
        self._steerings = np.linspace(-car.max_steering_rad, car.max_steering_rad, config.steerings)
        self.reset()

    def reset(self) -> None:
        self._manoeuvre: _Manoeuvre | None = None
        self._attempts = 0
        self._cautious = Footprint(self._car, self._config.sweep, NONE)
        self._anchor: Pose2 | None = None
        self._blocked_until_s = -math.inf
        self._last_rad = 0.0
        self._blind = False

    def step(
        self,
        now_s: float,
        wish: Wish,
        points_m: NDArray[np.float64],
        odom_from_robot: Pose2,
        speed_mps: float,
        steering_rad: float,
        unseen_m: NDArray[np.float64] = NONE,
    ) -> Avoided:
        """`points_m`: (N, 2) obstacles, odom frame; `speed_mps` measured; `steering_rad` as it was last commanded.

        `unseen_m`: (M, 2), odom frame, ground behind the car that nobody has seen (`SeenGround`): a reversal that
        is put in does not go there, unless no other leads on; then it creeps a short way.
        """
        robot_from_odom = odom_from_robot.inverse()
        points = robot_from_odom.apply(points_m)
        footprint = Footprint(self._car, self._config.sweep, points)
        self._cautious = Footprint(self._car, self._config.sweep, points, robot_from_odom.apply(unseen_m))
        self._note_progress(odom_from_robot)
        if self._manoeuvre is not None and wish.may_reverse:
            avoided = self._continue(now_s, footprint, odom_from_robot, speed_mps, self._manoeuvre)
        else:
            self._manoeuvre = None
            avoided = self._drive(now_s, wish, footprint, odom_from_robot, speed_mps, steering_rad)
        self._last_rad = avoided.motion.steering_rad
        return avoided

    def _note_progress(self, pose: Pose2) -> None:
        if self._anchor is None or pose.distance_m(self._anchor) > self._config.progress_m:
            self._anchor = pose
            self._attempts = 0

    def _drive(
        self,
        now_s: float,
        wish: Wish,
        footprint: Footprint,
        pose: Pose2,
        speed_mps: float,
        steering_rad: float,
    ) -> Avoided:
        if wish.motion.speed_mps == 0.0:
            return Avoided(wish.motion, AvoidanceState.CLEAR, 0.0, math.inf)
        forward = wish.motion.speed_mps > 0
        best = self._best(footprint, wish, steering_rad, forward)
        if best.free_m < (self._config.stuck_free_m if wish.may_reverse else self._config.sweep.step_m):
            return self._stuck(now_s, wish, footprint, pose, best)
        speed = min(abs(wish.motion.speed_mps), self._safe_speed_mps(best))
        motion = Motion(speed if forward else -speed, best.steering_rad)
        return Avoided(motion, AvoidanceState.CLEAR, best.free_m, best.clearance_m)

    def _best(self, footprint: Footprint, wish: Wish, steering_rad: float, forward: bool) -> Sweep:
        wanted = wish.motion.steering_rad
        near = [float(s) for s in self._steerings if abs(s - wanted) <= wish.freedom_rad]
        sweeps = [footprint.sweep(steering_rad, s, forward, self._config.horizon_m) for s in [wanted, *near]]
        return min(sweeps, key=lambda s: self._cost(s, wanted))

    def _cost(self, sweep: Sweep, wanted_rad: float) -> float:
        config = self._config
        short = max(0.0, 1.0 - sweep.free_m / config.comfortable_m)
        tight = max(0.0, 1.0 - sweep.clearance_m / config.comfortable_clearance_m)
        swerve = abs(sweep.steering_rad - wanted_rad)
        return swerve + 1.6 * short + 0.5 * tight + 0.15 * abs(sweep.steering_rad - self._last_rad)

    def _safe_speed_mps(self, sweep: Sweep) -> float:
        """The speed from which the car stops within `free_m`, its latency included; slower where it is tight."""
        a, t = self._config.deceleration_mps2, self._config.latency_s
        stopping = math.sqrt((a * t) ** 2 + 2 * a * max(sweep.free_m - 0.02, 0.0)) - a * t
        return min(max(stopping, self._config.creep_mps), 0.10 + 2.5 * sweep.clearance_m)

    def _stuck(self, now_s: float, wish: Wish, footprint: Footprint, pose: Pose2, best: Sweep) -> Avoided:
        stand = Motion(0.0, best.steering_rad)
        blocked = Avoided(stand, AvoidanceState.BLOCKED, best.free_m, best.clearance_m)
        if not wish.may_reverse or now_s < self._blocked_until_s:
            return blocked
        turning = None
        if self._attempts < self._config.attempts:
            turning = self._find_turning(footprint, wish.carrot_m)
        if turning is None:
            self._blocked_until_s = now_s + self._config.retry_s
            self._attempts = 0
            return blocked
        self._attempts += 1
        self._manoeuvre = _Manoeuvre(turning, _Phase.STOP, now_s, pose)
        return Avoided(Motion(0.0, turning.reverse_rad), AvoidanceState.REVERSING, best.free_m, best.clearance_m)

    def _find_turning(self, footprint: Footprint, carrot_m: tuple[float, float] | None) -> Turning | None:
        limit, config = self._car.max_steering_rad, self._config.turning
        self._blind = False
        turning = find_turning(self._cautious, limit, carrot_m, config)
        if turning is None:
            self._blind = True
            short = tuple(length for length in config.lengths_m if length <= self._config.blind_m)
            turning = find_turning(footprint, limit, carrot_m, replace(config, lengths_m=short))
        return turning

    def _continue(self, now_s: float, footprint: Footprint, pose: Pose2, speed_mps: float, m: _Manoeuvre) -> Avoided:
        """One step of the way out: stop, reverse, stop, go on."""
        if now_s - m.since_s > self._config.phase_timeout_s:
            self._manoeuvre = None
            return Avoided(STAND_STILL, AvoidanceState.REVERSING, 0.0, 0.0)
        if m.phase in {_Phase.STOP, _Phase.TURN_WHEELS}:
            return self._settle(now_s, pose, speed_mps, m)
        forward, config = m.phase is _Phase.GO_ON, self._config
        steering = m.turning.forward_rad if forward else m.turning.reverse_rad
        length = 0.5 * m.turning.forward_m if forward else m.turning.reverse_m
        among = footprint if forward or self._blind else self._cautious
        sweep = among.sweep(steering, steering, forward, 0.4)
        left = length - pose.distance_m(m.begin)
        if left <= 0.01 or sweep.free_m < config.sweep.step_m:
            self._next_phase(now_s, pose, m)
            return Avoided(Motion(0.0, steering), AvoidanceState.REVERSING, sweep.free_m, sweep.clearance_m)
        fastest = config.blind_mps if self._blind and not forward else config.reverse_mps
        speed = min(fastest, self._safe_speed_mps(sweep))
        if not forward:  # forward it goes on beyond the stretch
            speed = min(speed, config.creep_mps + math.sqrt(2 * config.stopping_mps2 * left))
        motion = Motion(speed if forward else -speed, steering)
        return Avoided(motion, AvoidanceState.REVERSING, sweep.free_m, sweep.clearance_m)

    def _settle(self, now_s: float, pose: Pose2, speed_mps: float, m: _Manoeuvre) -> Avoided:
        steering = m.turning.reverse_rad if m.phase is _Phase.STOP else m.turning.forward_rad
        if now_s - m.since_s > self._config.settle_s and abs(speed_mps) < self._config.standing_mps:
            self._next_phase(now_s, pose, m)
        return Avoided(Motion(0.0, steering), AvoidanceState.REVERSING, 0.0, math.inf)

    def _next_phase(self, now_s: float, pose: Pose2, m: _Manoeuvre) -> None:
        if m.phase is _Phase.GO_ON:
            self._manoeuvre = None
        else:
            self._manoeuvre = _Manoeuvre(m.turning, _Phase(m.phase + 1), now_s, pose)
