"""Notices a robot that lies on its side or is being carried away: where does gravity point?"""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot_app.drivers.base import ImuSample


@dataclass(frozen=True, slots=True)
class TiltConfig:
    limit_rad: float = 0.45  # 26°; braking at 2 m/s² looks like 12°, a ramp for wheelchairs has 5°
    smoothing_s: float = 0.10  # a bump is no tilt

    def __post_init__(self) -> None:
        if not (0.25 <= self.limit_rad <= 1.2 and 0 < self.smoothing_s <= 1):
            raise ValueError("limit_rad must be from 0.25 to 1.2, smoothing_s above 0 and at most 1")


class TiltWatch:
    def __init__(self, config: TiltConfig) -> None:
        self._config = config
        self._up: tuple[float, float, float] = (0.0, 0.0, 9.81)  # smoothed, robot frame
        self._last_s = math.nan

    def update(self, imu: ImuSample) -> bool:
        """Whether it is tilted."""
        step_s = imu.stamp_s - self._last_s
        self._last_s = imu.stamp_s
        share = 1.0 if not 0 <= step_s < 1 else step_s / (step_s + self._config.smoothing_s)
        x, y, z = (old + share * (new - old) for old, new in zip(self._up, imu.acceleration_mps2, strict=True))
        self._up = x, y, z
        return math.atan2(math.hypot(x, y), z) > self._config.limit_rad
