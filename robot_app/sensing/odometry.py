"""Where the robot thinks it is: distance from the encoders, heading from the gyro.

A wheel that slips turns the encoders' heading at once and the gyro's not at all, so the heading is the gyro's.
Its bias is measured whenever the car stands still.
"""

from __future__ import annotations

import math
import threading
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, replace
from operator import add

from robot_app.drivers.base import Count, ImuSample
from robot_app.sensing.wheels import Body, Rolled, wheels_of
from shared.geometry.se2 import Pose2, interpolate, wrap_angle

_NO_STEP = Rolled((), 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class OdometryConfig:
    ticks_per_turn: float = 80.0  # SG2A174 encoder, paper 1, table 1
    distance_scale: float = 1.0  # true distance over measured one, from calibration
    speed_window_s: float = 0.10  # 3 mm ticks make a shorter window jump
    quick_window_s: float = 0.025  # for who brakes and cannot wait
    standing_s: float = 0.30  # without a tick for so long, the car stands and the gyro's bias is learnt
    surely_standing_s: float = 1.0  # … and so much longer where the gyro says that it turns
    creeping_radps: float = 0.01  # five times the noise of a sample of the gyro
    bias_time_constant_s: float = 2.0
    max_bias_radps: float = 0.35  # LSM9DS1: zero-rate level up to 30 °/s at 500 °/s full scale, less at 245
    history_s: float = 1.0

    def metres_per_tick(self, wheel_radius_m: float) -> float:
        return math.tau * wheel_radius_m / self.ticks_per_turn * self.distance_scale

    def __post_init__(self) -> None:
        if self.ticks_per_turn <= 0 or self.distance_scale <= 0 or self.bias_time_constant_s <= 0:
            raise ValueError("ticks_per_turn, distance_scale and bias_time_constant_s must be positive")


@dataclass(frozen=True, slots=True)
class Felt:
    """The accelerations summed up, forward and to the left, less what was felt while the robot stood: the difference of
    two moments tells how its speed has changed, for a moment."""

    stamp_s: float
    x_mps: float
    y_mps: float
    ax_mps2: float  # now
    ay_mps2: float


@dataclass(frozen=True, slots=True)
class OdometryState:
    """`speed_mps` forward along the heading, `lateral_mps` to its left; `distance_m` counts all directions up.

    `wheels_mps`: how fast the wheels of each motor roll; `quick_mps`: the same over a shorter time, so that it jumps.
    """

    stamp_s: float
    odom_from_robot: Pose2
    speed_mps: float
    yaw_rate_radps: float
    distance_m: float
    lateral_mps: float = 0.0
    wheels_mps: tuple[float, ...] = ()
    quick_mps: tuple[float, ...] = ()
    felt: Felt | None = None  # before it has stood


class Odometry:
    """Integrates ticks and yaw rate; one thread updates, any thread reads."""

    def __init__(self, config: OdometryConfig, body: Body) -> None:
        self._config = config
        self._wheels = wheels_of(body, config.ticks_per_turn, config.distance_scale)
        self._lock = threading.Lock()
        self._history: deque[OdometryState] = deque(maxlen=max(2, int(config.history_s * 200)))
        self._state = OdometryState(0.0, Pose2(), 0.0, 0.0, 0.0)
        self._last_count: Count | None = None
        self._last_gyro_s: float | None = None
        self._last_tick_s = -math.inf
        self._recent: deque[tuple[float, tuple[float, ...]]] = deque(maxlen=64)  # stamp, ways of the wheels so far
        self._ways_m: tuple[float, ...] = ()
        self._bias_radps = 0.0
        self._resting_mps2: tuple[float, float] | None = None
        self._felt: Felt | None = None
        self._standing_samples_s = 0.0
        self._turning_s = 0.0  # by the gyro, without a tick

    @property
    def state(self) -> OdometryState:
        return self._state

    def age_s(self, now_s: float) -> float:
        """Of the older of its two inputs: without either the pose is worth nothing. Infinite before both have come."""
        count, gyro_s = self._last_count, self._last_gyro_s
        if count is None or gyro_s is None:
            return math.inf
        return now_s - min(count.stamp_s, gyro_s)

    def speed_age_s(self, now_s: float) -> float:
        """Of the last count: without one the speed is not known. Infinite before the first."""
        return math.inf if self._last_count is None else now_s - self._last_count.stamp_s

    def doubt_bias(self) -> None:
        """The gyro's bias is not what it was: learn it anew, from the next time on that the robot stands."""
        self._standing_samples_s = 0.0

    @property
    def gyro_bias_radps(self) -> float:
        return self._bias_radps

    @property
    def is_calibrated(self) -> bool:
        """True once the gyro's bias was seen for as long as its time constant."""
        return self._standing_samples_s >= self._config.bias_time_constant_s

    def update(self, count: Count | None, imu: ImuSample | None) -> None:
        """Take what came in since the last call; either may be missing."""
        if count is None and imu is None:
            return
        step = self._take_count(count) if count is not None else _NO_STEP
        turn_rad, yaw_rate = self._take_gyro(imu) if imu is not None else (0.0, self._state.yaw_rate_radps)
        last = self._state
        middle_rad = last.odom_from_robot.theta_rad + turn_rad / 2
        c, s = math.cos(middle_rad), math.sin(middle_rad)
        pose = Pose2(
            last.odom_from_robot.x_m + (step.x_m * c - step.y_m * s),
            last.odom_from_robot.y_m + (step.x_m * s + step.y_m * c),
            wrap_angle(last.odom_from_robot.theta_rad + turn_rad),
        )
        stamp_s = max(sample.stamp_s for sample in (count, imu) if sample is not None)
        wheels_mps, quick_mps = (
            self._wheels_mps(s) for s in (self._config.speed_window_s, self._config.quick_window_s)
        )
        speed, lateral = self._wheels.velocity_mps(wheels_mps) if wheels_mps else (0.0, 0.0)
        way_m = last.distance_m + step.way_m
        state = OdometryState(stamp_s, pose, speed, yaw_rate, way_m, lateral, wheels_mps, quick_mps, self._felt)
        with self._lock:
            self._state = state
            self._history.append(state)

    def at(self, stamp_s: float) -> OdometryState | None:
        """The state at a moment of the last second, interpolated; None outside of what is known."""
        with self._lock:
            states = list(self._history)
        if not states or stamp_s < states[0].stamp_s:
            return None
        after = bisect_right(states, stamp_s, key=lambda s: s.stamp_s)
        if after == len(states):
            return _extrapolate(states[-1], stamp_s)
        before, later = states[after - 1], states[after]
        span_s = later.stamp_s - before.stamp_s
        fraction = 0.0 if span_s <= 0 else (stamp_s - before.stamp_s) / span_s
        return OdometryState(
            stamp_s,
            interpolate(before.odom_from_robot, later.odom_from_robot, fraction),
            before.speed_mps + fraction * (later.speed_mps - before.speed_mps),
            before.yaw_rate_radps + fraction * (later.yaw_rate_radps - before.yaw_rate_radps),
            before.distance_m,
            before.lateral_mps + fraction * (later.lateral_mps - before.lateral_mps),
            before.wheels_mps,
            before.quick_mps,
        )

    def _take_count(self, count: Count) -> Rolled:
        last, self._last_count = self._last_count, count
        if last is None:
            self._last_tick_s = count.stamp_s
            return _NO_STEP
        rolled = self._wheels.rolled(last, count)
        if any(rolled.ways_m):
            self._last_tick_s = count.stamp_s
        so_far = self._ways_m or (0.0,) * len(rolled.ways_m)
        self._ways_m = tuple(map(add, so_far, rolled.ways_m))
        self._recent.append((count.stamp_s, self._ways_m))
        return rolled

    def _take_gyro(self, imu: ImuSample) -> tuple[float, float]:
        last_s, self._last_gyro_s = self._last_gyro_s, imu.stamp_s
        if last_s is None:
            return 0.0, 0.0
        elapsed_s = min(max(imu.stamp_s - last_s, 0.0), 0.1)  # after a gap the old rate says nothing
        raw_radps = imu.gyro_radps[2]
        rate = raw_radps - self._bias_radps
        self._feel(imu, elapsed_s)
        if self._stands(rate, elapsed_s):
            self._learn_bias(imu, elapsed_s)
            return 0.0, 0.0
        return rate * elapsed_s, rate

    def _stands(self, rate_radps: float, elapsed_s: float) -> bool:
        """Without a tick for long enough; one that sets off or creeps round a bend has turned before the next tick."""
        config = self._config
        if self._last_count is None or self._last_count.stamp_s - self._last_tick_s <= config.standing_s:
            self._turning_s = 0.0
            return False
        turns = self.is_calibrated and abs(rate_radps) > config.creeping_radps
        self._turning_s = self._turning_s + elapsed_s if turns else 0.0
        return not turns or self._turning_s > config.surely_standing_s

    def _feel(self, imu: ImuSample, elapsed_s: float) -> None:
        if self._resting_mps2 is None:
            return
        (ax, ay, _), (rest_x, rest_y) = imu.acceleration_mps2, self._resting_mps2
        ax, ay = ax - rest_x, ay - rest_y
        last = self._felt or Felt(imu.stamp_s, 0.0, 0.0, ax, ay)
        x_mps, y_mps = ((last.ax_mps2 + ax) / 2 * elapsed_s, (last.ay_mps2 + ay) / 2 * elapsed_s)
        self._felt = Felt(imu.stamp_s, last.x_mps + x_mps, last.y_mps + y_mps, ax, ay)

    def _learn_bias(self, imu: ImuSample, elapsed_s: float) -> None:
        raw_radps = imu.gyro_radps[2]
        if abs(raw_radps - self._bias_radps) > self._config.max_bias_radps:
            return  # somebody is carrying the robot
        self._standing_samples_s += elapsed_s
        window_s = min(self._standing_samples_s, self._config.bias_time_constant_s)
        share = min(1.0, elapsed_s / max(window_s, 1e-3))
        self._bias_radps += (raw_radps - self._bias_radps) * share
        (ax, ay, _), (rest_x, rest_y) = imu.acceleration_mps2, self._resting_mps2 or imu.acceleration_mps2[:2]
        self._resting_mps2 = (rest_x + (ax - rest_x) * share, rest_y + (ay - rest_y) * share)

    def _wheels_mps(self, window_s: float) -> tuple[float, ...]:
        """Nothing before that time has passed."""
        if len(self._recent) < 2:
            return ()
        now_s, now_m = self._recent[-1]
        for then_s, then_m in reversed(self._recent):
            if now_s - then_s >= window_s:
                return tuple((now - then) / (now_s - then_s) for now, then in zip(now_m, then_m, strict=True))
        return ()


def _extrapolate(state: OdometryState, stamp_s: float) -> OdometryState:
    """Constant motion past the newest state; a scan is at most a few milliseconds ahead of it."""
    ahead_s = min(stamp_s - state.stamp_s, 0.05)
    moved = Pose2(state.speed_mps * ahead_s, state.lateral_mps * ahead_s, state.yaw_rate_radps * ahead_s)
    return replace(state, stamp_s=stamp_s, odom_from_robot=state.odom_from_robot @ moved)
