"""What the encoders say of the robot's way, for each kind of robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from robot_app.drivers.base import Count, EncoderCount, OmniCount
from shared.geometry.ackermann import CarGeometry
from shared.geometry.omni3 import OmniGeometry

Body = CarGeometry | OmniGeometry


@dataclass(frozen=True, slots=True)
class Rolled:
    """`ways_m`: of each motor's wheels. `x_m` forward and `y_m` to the left: of the robot; `way_m`: their length."""

    ways_m: tuple[float, ...]
    x_m: float
    y_m: float
    way_m: float


class Wheels(Protocol):
    def rolled(self, last: Count, count: Count) -> Rolled:
        """Between two counts."""
        ...

    def velocity_mps(self, wheels_mps: tuple[float, ...]) -> tuple[float, float]:
        """Of the robot, forward and to the left, from that of each motor's wheels."""
        ...


class CarWheels:
    """One motor on two rear wheels: their mean is the way."""

    def __init__(self, metres_per_tick: float) -> None:
        self._metres_per_tick = metres_per_tick

    def rolled(self, last: Count, count: Count) -> Rolled:
        assert isinstance(last, EncoderCount)
        assert isinstance(count, EncoderCount)
        step_m = (count.left - last.left + count.right - last.right) / 2 * self._metres_per_tick
        return Rolled((step_m,), step_m, 0.0, abs(step_m))

    def velocity_mps(self, wheels_mps: tuple[float, ...]) -> tuple[float, float]:
        return wheels_mps[0], 0.0


class OmniWheels:
    """Three wheels and motors (paper 2, eq 1). What they say of the turn is left to the gyro."""

    def __init__(self, metres_per_tick: float, omni: OmniGeometry) -> None:
        self._metres_per_tick = metres_per_tick
        self._omni = omni

    def rolled(self, last: Count, count: Count) -> Rolled:
        assert isinstance(last, OmniCount)
        assert isinstance(count, OmniCount)
        right, left, back = (
            (now - then) * self._metres_per_tick for now, then in zip(count.wheels, last.wheels, strict=True)
        )
        moved = self._omni.twist((right, left, back))
        return Rolled((right, left, back), moved.x_mps, moved.y_mps, moved.speed_mps)

    def velocity_mps(self, wheels_mps: tuple[float, ...]) -> tuple[float, float]:
        right, left, back = wheels_mps
        twist = self._omni.twist((right, left, back))
        return twist.x_mps, twist.y_mps


def wheels_of(body: Body, ticks_per_turn: float, distance_scale: float) -> Wheels:
    metres_per_tick = math.tau * body.wheel_radius_m / ticks_per_turn * distance_scale
    return CarWheels(metres_per_tick) if isinstance(body, CarGeometry) else OmniWheels(metres_per_tick, body)
