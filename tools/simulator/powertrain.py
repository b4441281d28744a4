"""What lies between a drive setting and the wheels: servo, H-bridge, motor and battery."""

from __future__ import annotations

import math

import numpy as np

from tools.simulator.scenario import BatteryParameters, CarParameters

# Open-circuit voltage of one LiFePO4 cell over its charge: a long plateau between two steep ends.
_CELL_CHARGE = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 0.97, 1.0])
_CELL_V = np.array([2.50, 2.95, 3.10, 3.20, 3.24, 3.28, 3.31, 3.34, 3.38, 3.50])


class SteeringServo:
    """Follows its target with a lag and a limited rate."""

    def __init__(self, car: CarParameters) -> None:
        self._car = car
        self.target_rad = 0.0
        self.angle_rad = 0.0

    def step(self, step_s: float) -> bool:
        """Move for one step; False when it stood still."""
        error = self.target_rad - self.angle_rad
        if error == 0.0:
            return False
        limit = self._car.servo_rate_radps * step_s
        move = max(-limit, min(limit, error * step_s / self._car.servo_lag_s))
        self.angle_rad = self.target_rad if abs(error) < 1e-5 else self.angle_rad + move
        return True

    def wheel_angles_rad(self) -> tuple[float, float]:
        """Left and right front wheel, so that all axes meet in one point."""
        t = math.tan(self.angle_rad)
        half = self._car.track_m / (2 * self._car.wheelbase_m)
        return math.atan(t / (1 - t * half)), math.atan(t / (1 + t * half))


class Battery:
    """Open-circuit voltage over charge, less the drop over the inner resistance."""

    def __init__(self, parameters: BatteryParameters) -> None:
        self._parameters = parameters
        self._charge = parameters.charge
        self.motor_current_a = 0.0
        self.voltage_v = self._voltage_v(parameters.idle_current_a)

    def step(self, step_s: float, motor_current_a: float, duty: float) -> None:
        """The bridge chops: the battery sees the motor's current for the share `duty` of the time."""
        self.motor_current_a = motor_current_a
        current_a = self._parameters.idle_current_a + abs(duty) * max(0.0, motor_current_a)
        self._charge = max(0.0, self._charge - current_a * step_s / 3600 / self._parameters.capacity_ah)
        self.voltage_v = self._voltage_v(current_a)

    def _voltage_v(self, current_a: float) -> float:
        open_circuit_v = 2 * float(np.interp(self._charge, _CELL_CHARGE, _CELL_V))
        return open_circuit_v - self._parameters.resistance_ohm * current_a
