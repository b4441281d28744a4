"""Compares the three encoders with the gyro: can they be believed?

Each wheel drives along the circle round the robot's middle, so the sum of the three tells its turn (paper 2, eq 1),
and one encoder that has failed makes it differ from the gyro's at once, whatever way the robot goes.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_app.drivers.base import OmniCount, OmniSetting
from robot_app.safety.wheels import WheelFault
from shared.geometry.omni3 import WHEELS, OmniGeometry


@dataclass(frozen=True, slots=True)
class OmniWheelWatchConfig:
    pushing_duty: float = 0.10
    lone_s: float = 0.06  # a wheel that was pushed for so long without a tick has failed, where the turn is wrong
    yaw_drift_radps: float = 0.10  # gyro and wheels may differ by so much for ever: bias, 5.7 °/s …
    yaw_drift_per_m: float = 0.10  # … and by this with the way of the wheels: slip, or wheels of different sizes
    yaw_apart_rad: float = 0.10  # beyond that

    def __post_init__(self) -> None:
        if min(self.pushing_duty, self.lone_s, self.yaw_apart_rad) <= 0:
            raise ValueError("pushing_duty, lone_s and yaw_apart_rad must be positive")


class OmniWheelWatch:
    """One thread updates."""

    def __init__(self, config: OmniWheelWatchConfig, omni: OmniGeometry, metres_per_tick: float) -> None:
        self._config = config
        self._omni = omni
        self._metres_per_tick = metres_per_tick
        self._last: OmniCount | None = None
        self.speed_before_mps = 0.0  # of the fastest wheel, when all was well
        self.forget()

    def forget(self) -> None:
        """What was seen so far says nothing about what comes."""
        self._left_apart_rad = self._right_apart_rad = 0.0
        self._silent_s = [0.0] * WHEELS

    def update(
        self, count: OmniCount, yaw_rate_radps: float, speed_mps: float, applied: OmniSetting | None
    ) -> WheelFault | None:
        """`yaw_rate_radps` of the gyro, `speed_mps` of the fastest wheel, `applied` by the drive, None while cut."""
        last, self._last = self._last, count
        if last is None:
            return None
        elapsed_s = min(max(count.stamp_s - last.stamp_s, 0.0), 0.1)
        right, left, back = (
            (now - then) * self._metres_per_tick for now, then in zip(count.wheels, last.wheels, strict=True)
        )
        self._note_silence((right, left, back), elapsed_s, applied)
        turn_rad = self._omni.twist((right, left, back)).turn_radps
        self._sum_up(turn_rad - yaw_rate_radps * elapsed_s, elapsed_s, max(map(abs, (right, left, back))))
        apart_rad = max(self._left_apart_rad, self._right_apart_rad)
        if apart_rad == 0.0:
            self.speed_before_mps = speed_mps
        if apart_rad <= self._config.yaw_apart_rad:
            return None
        return WheelFault.LONE if max(self._silent_s) >= self._config.lone_s else WheelFault.GYRO

    def _note_silence(self, ways_m: tuple[float, ...], elapsed_s: float, applied: OmniSetting | None) -> None:
        duties = applied.duties if applied is not None else (0.0,) * WHEELS
        for i, (way_m, duty) in enumerate(zip(ways_m, duties, strict=True)):
            silent = way_m == 0.0 and abs(duty) >= self._config.pushing_duty
            self._silent_s[i] = self._silent_s[i] + elapsed_s if silent else 0.0

    def _sum_up(self, apart_rad: float, elapsed_s: float, way_m: float) -> None:
        """Two one-sided cumulative sums (Page, Biometrika 41, 1954)."""
        c = self._config
        allowed_rad = c.yaw_drift_radps * elapsed_s + c.yaw_drift_per_m * way_m
        self._left_apart_rad = max(0.0, self._left_apart_rad + apart_rad - allowed_rad)
        self._right_apart_rad = max(0.0, self._right_apart_rad - apart_rad - allowed_rad)
