"""Compares the two encoders with each other, with the gyro and with the motor: which of them can be believed?

The inner wheel of a car turns at least 0.7 times as far as the outer one, so one that counts nothing while the other
goes on is not turning slowly: its encoder has failed. Both together cannot fall silent within a tick or two while the
motor pushes. And the way by the encoders along the arc of the steering must turn the car as the gyro says. (What the
difference of the encoders says of the turn is worth little on a slippery floor: 0.23 rad/s at a slip of 14 %.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from robot_app.drivers.base import DriveSetting, EncoderCount

_ROUNDING_S = 1e-6


@dataclass(frozen=True, slots=True)
class WheelWatchConfig:
    lone_ticks: int = 8  # of one wheel while the other counts nothing: 25 mm
    silent_ticks: float = 5.0  # that were due from both wheels together, by the last speed, and did not come …
    silent_s: float = 0.03  # … and for so long at least
    silent_above_mps: float = 0.08  # slower ticks come too far apart to be missed
    pushing_duty: float = 0.15
    servo_lag_s: float = 0.06
    yaw_drift_radps: float = 0.06  # gyro and steering may differ by so much for ever: bias, 3.4 °/s …
    yaw_drift_per_m: float = 0.25  # … and by this with the way: 3.7° of trim, or wheels that slip in a turn
    yaw_apart_rad: float = 0.20  # beyond that; a servo that is late by as much as it may be is 0.05

    def __post_init__(self) -> None:
        if self.lone_ticks < 3 or min(self.silent_ticks, self.silent_s, self.silent_above_mps) <= 0:
            raise ValueError("lone_ticks must be at least 3, and silent_ticks, silent_s, silent_above_mps above 0")
        if not 0.05 <= self.yaw_apart_rad <= 1:
            raise ValueError("yaw_apart_rad must be from 0.05 to 1")


class WheelFault(Enum):
    """The value is what the operator reads."""

    LEFT = "the left encoder does not count"
    RIGHT = "the right encoder does not count"
    SILENT = "the encoders do not count while the motor pushes, or the wheels are stuck"
    TURNING = "the gyro and the steering do not agree on how it turns"
    JUMPED = "the gyro begins to turn as fast as no car can"
    LONE = "an encoder does not count"
    GYRO = "the gyro and the encoders do not agree on how it turns"


class WheelWatch:
    """One thread updates."""

    def __init__(self, config: WheelWatchConfig, wheelbase_m: float, metres_per_tick: float) -> None:
        self._config = config
        self._wheelbase_m = wheelbase_m
        self._metres_per_tick = metres_per_tick
        self._last: EncoderCount | None = None
        self._steering_rad = 0.0  # of the wheels, behind that of the servo
        self.speed_before_mps = 0.0  # the last that both encoders told
        self.forget()

    def forget(self) -> None:
        """What was seen so far says nothing about what comes."""
        self._lone_left = self._lone_right = 0
        self._silence_began_s, self._silent_limit_s = math.nan, math.inf
        self._left_apart_rad = self._right_apart_rad = 0.0

    def update(
        self, count: EncoderCount, yaw_rate_radps: float, speed_mps: float, setting: DriveSetting | None
    ) -> WheelFault | None:
        """`yaw_rate_radps` of the gyro, `speed_mps` of the encoders over the last moment; `setting` as it was applied,
        None while the motor is cut: the servo stays where it is.
        """
        last, self._last = self._last, count
        if last is None:
            return None
        left, right = count.left - last.left, count.right - last.right
        elapsed_s = min(max(count.stamp_s - last.stamp_s, 0.0), 0.1)
        fault = self._lone(left, right, speed_mps) or self._silent(count.stamp_s, left, right, speed_mps, setting)
        if fault is None and self._are_apart((left + right) / 2, setting, yaw_rate_radps, elapsed_s):
            fault = WheelFault.TURNING
        return fault

    def _lone(self, left: int, right: int, speed_mps: float) -> WheelFault | None:
        if not (self._lone_left or self._lone_right) and math.isnan(self._silence_began_s):
            self.speed_before_mps = speed_mps
        # With their signs: a car that stands on the edge of a tick counts it to and fro.
        self._lone_left = 0 if right else self._lone_left + left
        self._lone_right = 0 if left else self._lone_right + right
        if abs(self._lone_right) >= self._config.lone_ticks:
            return WheelFault.LEFT
        return WheelFault.RIGHT if abs(self._lone_left) >= self._config.lone_ticks else None

    def _silent(
        self, now_s: float, left: int, right: int, speed_mps: float, setting: DriveSetting | None
    ) -> WheelFault | None:
        """The speed is an average, so at the beginning of the silence it is still the one from before."""
        c, duty = self._config, setting.duty if setting is not None else 0.0
        if left or right or duty * speed_mps < 0 or abs(duty) < c.pushing_duty:
            self._silence_began_s = math.nan
            return None
        if math.isnan(self._silence_began_s):
            if abs(speed_mps) < c.silent_above_mps:
                return None
            self._silence_began_s, self.speed_before_mps = now_s, speed_mps
            tick_s = self._metres_per_tick / (2 * abs(speed_mps))
            self._silent_limit_s = max(c.silent_s, c.silent_ticks * tick_s)
        return WheelFault.SILENT if now_s - self._silence_began_s > self._silent_limit_s - _ROUNDING_S else None

    def _are_apart(self, ticks: float, setting: DriveSetting | None, yaw_rate_radps: float, elapsed_s: float) -> bool:
        """Two one-sided cumulative sums (Page, Biometrika 41, 1954): as late as is needed, as soon as can be."""
        c = self._config
        steering_rad = self._steering_rad if setting is None else setting.steering_rad
        self._steering_rad += (steering_rad - self._steering_rad) * elapsed_s / (elapsed_s + c.servo_lag_s)
        way_m = ticks * self._metres_per_tick
        apart_rad = way_m * math.tan(self._steering_rad) / self._wheelbase_m - yaw_rate_radps * elapsed_s
        allowed_rad = c.yaw_drift_radps * elapsed_s + c.yaw_drift_per_m * abs(way_m)
        self._left_apart_rad = max(0.0, self._left_apart_rad + apart_rad - allowed_rad)
        self._right_apart_rad = max(0.0, self._right_apart_rad - apart_rad - allowed_rad)
        return max(self._left_apart_rad, self._right_apart_rad) > c.yaw_apart_rad
