"""A car that steers its front wheels."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CarGeometry:
    """Sizes of the car; its origin is on the floor under the middle of the rear axle."""

    wheelbase_m: float
    track_m: float
    wheel_radius_m: float
    max_steering_rad: float
    front_m: float  # from the rear axle to the front bumper
    rear_m: float  # from the rear axle to the rear bumper, positive
    width_m: float

    def __post_init__(self) -> None:
        for name in ("wheelbase_m", "track_m", "wheel_radius_m", "max_steering_rad", "front_m", "width_m"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} must be positive")

    def curvature_per_m(self, steering_rad: float) -> float:
        """Of the rear axle's path; positive to the left."""
        return math.tan(steering_rad) / self.wheelbase_m

    def steering_rad(self, curvature_per_m: float) -> float:
        """The steering for a curvature, within the limits."""
        wanted = math.atan(curvature_per_m * self.wheelbase_m)
        return max(-self.max_steering_rad, min(self.max_steering_rad, wanted))

    @property
    def min_turning_radius_m(self) -> float:
        return self.wheelbase_m / math.tan(self.max_steering_rad)

    def footprint_m(self) -> tuple[tuple[float, float], ...]:
        """The corners, counter-clockwise from the rear right."""
        half = self.width_m / 2
        return (-self.rear_m, -half), (self.front_m, -half), (self.front_m, half), (-self.rear_m, half)
