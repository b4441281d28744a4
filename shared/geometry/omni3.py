"""A robot on three omnidirectional wheels, 120° apart (paper 2, section III-A).

Its origin is on the floor under its middle. Seen from there the wheels are at the front right, at the front left and
at the back, and each drives along the circle round the middle: all three forward turn the robot to the left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_HALF_ALPHA_RAD = math.radians(60.0)  # half of the angle between two wheels
_SIN, _COS = math.sin(_HALF_ALPHA_RAD), math.cos(_HALF_ALPHA_RAD)
WHEELS = 3
WHEEL_ANGLES_RAD = (-_HALF_ALPHA_RAD, _HALF_ALPHA_RAD, math.pi)  # where each wheel is, from straight ahead
_OUTLINE_CORNERS = 16

Wheels = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity in the robot's frame: forward, to the left, turning to the left. Of a short way: metres and radians."""

    x_mps: float
    y_mps: float
    turn_radps: float

    @property
    def speed_mps(self) -> float:
        """In whatever direction."""
        return math.hypot(self.x_mps, self.y_mps)

    @property
    def is_finite(self) -> bool:
        return all(map(math.isfinite, (self.x_mps, self.y_mps, self.turn_radps)))

    def scaled(self, share: float) -> Twist:
        return Twist(share * self.x_mps, share * self.y_mps, share * self.turn_radps)


STAND_STILL = Twist(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class OmniGeometry:
    """Sizes of the robot."""

    wheel_distance_m: float  # L: from the middle to where a wheel touches the floor
    wheel_radius_m: float
    radius_m: float  # of the disc that the body is, its wheels included

    def __post_init__(self) -> None:
        for name in ("wheel_distance_m", "wheel_radius_m", "radius_m"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} must be positive")
        if self.radius_m < self.wheel_distance_m:
            raise ValueError("radius_m must be at least wheel_distance_m")

    def wheels_mps(self, twist: Twist) -> Wheels:
        """How fast each wheel rolls (paper 2, eq 1)."""
        turn = self.wheel_distance_m * twist.turn_radps
        return (
            _SIN * twist.x_mps + _COS * twist.y_mps + turn,
            -_SIN * twist.x_mps + _COS * twist.y_mps + turn,
            -twist.y_mps + turn,
        )

    def twist(self, wheels_mps: Wheels) -> Twist:
        """The motion of wheels that do not slip: eq 1 solved for it."""
        right, left, back = wheels_mps
        return Twist(
            (right - left) / (2 * _SIN),
            (right + left - 2 * back) / 3,
            (right + left + back) / (3 * self.wheel_distance_m),
        )

    def wheels_in_room_mps(self, heading_rad: float, x_mps: float, y_mps: float, turn_radps: float) -> Wheels:
        """How fast each wheel rolls for a velocity in the room (paper 2, eqs 2 and 3)."""
        c, s = math.cos(heading_rad), math.sin(heading_rad)
        return self.wheels_mps(Twist(c * x_mps + s * y_mps, -s * x_mps + c * y_mps, turn_radps))

    @property
    def track_m(self) -> float:
        """Of the circle on which the wheels are."""
        return 2 * self.wheel_distance_m

    @property
    def min_turning_radius_m(self) -> float:
        """It turns on the spot."""
        return 0.0

    def footprint_m(self) -> tuple[tuple[float, float], ...]:
        """The corners of a polygon round the disc, counter-clockwise from the rear right."""
        out = self.radius_m / math.cos(math.pi / _OUTLINE_CORNERS)
        first = -math.pi + math.pi / _OUTLINE_CORNERS
        angles = [first + math.tau * k / _OUTLINE_CORNERS for k in range(_OUTLINE_CORNERS)]
        return tuple((out * math.cos(a), out * math.sin(a)) for a in angles)
