"""Where the robot thinks it is: distance from the rear encoders, heading from the gyro.

A wheel that slips turns the encoders' heading at once and the gyro's not at all, so the heading is the gyro's.
Its bias is measured whenever the car stands still.
"""

from __future__ import annotations

import math
import threading
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass

from robot_app.drivers.base import EncoderCount, ImuSample
from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2, interpolate, wrap_angle


@dataclass(frozen=True, slots=True)
class OdometryConfig:
    ticks_per_turn: float = 80.0  # SG2A174 encoder, paper 1, table 1
    distance_scale: float = 1.0  # true distance over measured one, from calibration
    speed_window_s: float = 0.10  # 3 mm ticks make a shorter window jump
    standing_s: float = 0.30  # without a tick for so long, the car stands and the gyro's bias is learnt
    bias_time_constant_s: float = 2.0
    max_bias_radps: float = 0.35  # LSM9DS1: zero-rate level up to 30 °/s at 500 °/s full scale, less at 245
    history_s: float = 1.0

    def __post_init__(self) -> None:
        if self.ticks_per_turn <= 0 or self.distance_scale <= 0 or self.bias_time_constant_s <= 0:
            raise ValueError("ticks_per_turn, distance_scale and bias_time_constant_s must be positive")


@dataclass(frozen=True, slots=True)
class OdometryState:
    """`speed_mps` forward along the heading; `distance_m` counts both directions up."""

    stamp_s: float
    odom_from_robot: Pose2
    speed_mps: float
    yaw_rate_radps: float
    distance_m: float


class Odometry:
    """Integrates ticks and yaw rate; one thread updates, any thread reads."""

    def __init__(self, config: OdometryConfig, car: CarGeometry) -> None:
        self._config = config
        self._metres_per_tick = math.tau * car.wheel_radius_m / config.ticks_per_turn * config.distance_scale
        self._lock = threading.Lock()
        self._history: deque[OdometryState] = deque(maxlen=max(2, int(config.history_s * 200)))
        self._state = OdometryState(0.0, Pose2(), 0.0, 0.0, 0.0)
        self._last_count: EncoderCount | None = None
        self._last_gyro_s: float | None = None
        self._last_tick_s = -math.inf
        self._recent: deque[tuple[float, float]] = deque(maxlen=64)  # stamp, signed distance so far
        self._signed_m = 0.0
        self._bias_radps = 0.0
        self._standing_samples_s = 0.0

    @property
    def state(self) -> OdometryState:
        return self._state

    def age_s(self, now_s: float) -> float:
        """Of the older of its two inputs: without either the pose is worth nothing. Infinite before both have come."""
        count, gyro_s = self._last_count, self._last_gyro_s
        if count is None or gyro_s is None:
            return math.inf
        return now_s - min(count.stamp_s, gyro_s)

    @property
    def gyro_bias_radps(self) -> float:
        return self._bias_radps

    @property
    def is_calibrated(self) -> bool:
        """True once the gyro's bias was seen for as long as its time constant."""
        return self._standing_samples_s >= self._config.bias_time_constant_s

    def update(self, count: EncoderCount | None, imu: ImuSample | None) -> None:
        """Take what came in since the last call; either may be missing."""
        if count is None and imu is None:
            return
        step_m = self._take_count(count) if count is not None else 0.0
        turn_rad, yaw_rate = self._take_gyro(imu) if imu is not None else (0.0, self._state.yaw_rate_radps)
        last = self._state
        middle_rad = last.odom_from_robot.theta_rad + turn_rad / 2
        pose = Pose2(
            last.odom_from_robot.x_m + step_m * math.cos(middle_rad),
            last.odom_from_robot.y_m + step_m * math.sin(middle_rad),
            wrap_angle(last.odom_from_robot.theta_rad + turn_rad),
        )
        stamp_s = max(s.stamp_s for s in (count, imu) if s is not None)
        state = OdometryState(stamp_s, pose, self._speed_mps(), yaw_rate, last.distance_m + abs(step_m))
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
        )

    def _take_count(self, count: EncoderCount) -> float:
        last, self._last_count = self._last_count, count
        if last is None:
            self._last_tick_s = count.stamp_s
            return 0.0
        ticks = (count.left - last.left + count.right - last.right) / 2
        if ticks:
            self._last_tick_s = count.stamp_s
        step_m = ticks * self._metres_per_tick
        self._signed_m += step_m
        self._recent.append((count.stamp_s, self._signed_m))
        return step_m

    def _take_gyro(self, imu: ImuSample) -> tuple[float, float]:
        last_s, self._last_gyro_s = self._last_gyro_s, imu.stamp_s
        if last_s is None:
            return 0.0, 0.0
        elapsed_s = min(max(imu.stamp_s - last_s, 0.0), 0.1)  # after a gap the old rate says nothing
        raw_radps = imu.gyro_radps[2]
        if self._last_count is not None and self._last_count.stamp_s - self._last_tick_s > self._config.standing_s:
            self._learn_bias(raw_radps, elapsed_s)
            return 0.0, 0.0
        rate = raw_radps - self._bias_radps
        return rate * elapsed_s, rate

    def _learn_bias(self, raw_radps: float, elapsed_s: float) -> None:
        if abs(raw_radps - self._bias_radps) > self._config.max_bias_radps:
            return  # somebody is carrying the robot
        self._standing_samples_s += elapsed_s
        window_s = min(self._standing_samples_s, self._config.bias_time_constant_s)
        self._bias_radps += (raw_radps - self._bias_radps) * min(1.0, elapsed_s / max(window_s, 1e-3))

    def _speed_mps(self) -> float:
        if len(self._recent) < 2:
            return 0.0
        now_s, now_m = self._recent[-1]
        for then_s, then_m in reversed(self._recent):
            if now_s - then_s >= self._config.speed_window_s:
                return (now_m - then_m) / (now_s - then_s)
        return 0.0


def _extrapolate(state: OdometryState, stamp_s: float) -> OdometryState:
    """Constant motion past the newest state; a scan is at most a few milliseconds ahead of it."""
    ahead_s = min(stamp_s - state.stamp_s, 0.05)
    pose = state.odom_from_robot @ Pose2(state.speed_mps * ahead_s, 0.0, state.yaw_rate_radps * ahead_s)
    return OdometryState(stamp_s, pose, state.speed_mps, state.yaw_rate_radps, state.distance_m)
