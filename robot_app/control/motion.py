"""What the controllers ask of the car."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Motion:
    """`speed_mps` of the rear axle, negative in reverse; `steering_rad` of the front wheels, positive to the left."""

    speed_mps: float
    steering_rad: float


STAND_STILL = Motion(0.0, 0.0)
