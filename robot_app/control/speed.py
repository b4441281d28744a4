"""Closed-loop speed of the motor: feed-forward, proportional and integral, within the H-bridge's limits."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SpeedConfig:
    full_duty_mps: float = 0.70  # speed without load at full duty
    friction_duty: float = 0.03  # what it takes to begin to turn
    proportional_per_mps: float = 1.2
    integral_per_m: float = 4.0
    max_integral_duty: float = 0.4
    acceleration_mps2: float = 0.8  # of the reference, so that the wheels do not slip
    deceleration_mps2: float = 1.5
    standing_mps: float = 0.015


class SpeedController:
    """Turns a wanted speed and the encoders' speed into a duty. Step it at a steady 50 to 200 Hz."""

    def __init__(self, config: SpeedConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        self._reference_mps = 0.0
        self._integral_duty = 0.0
        self._last_s: float | None = None

    def step(self, now_s: float, target_mps: float, measured_mps: float) -> float:
        """The duty in [-1, 1]; exactly 0 when the car is to stand and stands.

        Raises `ValueError` for what is no number: clamping would make full power of it.
        """
        if not (math.isfinite(target_mps) and math.isfinite(measured_mps)):
            raise ValueError(f"a speed of {target_mps} m/s is asked for and one of {measured_mps} m/s measured")
        step_s = 0.0 if self._last_s is None else min(max(now_s - self._last_s, 0.0), 0.1)
        self._last_s = now_s
        self._reference_mps = self._slew(target_mps, step_s)
        if target_mps == 0.0 and abs(measured_mps) < self._config.standing_mps and self._reference_mps == 0.0:
            self._integral_duty = 0.0
            return 0.0
        return self._control(self._reference_mps - measured_mps, step_s)

    def _slew(self, target_mps: float, step_s: float) -> float:
        reference = self._reference_mps
        slowing = abs(target_mps) < abs(reference) or target_mps * reference < 0
        rate = self._config.deceleration_mps2 if slowing else self._config.acceleration_mps2
        return reference + max(-rate * step_s, min(rate * step_s, target_mps - reference))

    def _control(self, error_mps: float, step_s: float) -> float:
        config = self._config
        reference = self._reference_mps
        forward = reference / config.full_duty_mps
        if reference != 0.0:
            forward += math.copysign(config.friction_duty, reference)
        duty = forward + config.proportional_per_mps * error_mps + self._integral_duty
        pushes_out = abs(duty) > 1.0 and duty * error_mps > 0
        if not pushes_out:  # no wind-up at the limits
            integral = self._integral_duty + config.integral_per_m * error_mps * step_s
            self._integral_duty = max(-config.max_integral_duty, min(config.max_integral_duty, integral))
        return max(-1.0, min(1.0, duty))
