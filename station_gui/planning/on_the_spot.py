"""The body to plan for of a robot that turns on the spot, as it tells it itself."""

from __future__ import annotations

import math

from shared.geometry.ackermann import CarGeometry
from shared.messages import Hello

_TURN_M = 0.10  # the planner draws arcs; a robot that can do more than follow them follows these too
_STEERING_RAD = 1.0
_SMALLEST_M, _LARGEST_M = 0.02, 3.0  # what else comes is no robot's size


def body_on_the_spot(hello: Hello) -> CarGeometry | None:
    """The rectangle round its footprint, on nearly no turning circle; None for a robot that must drive to turn."""
    corners = hello.footprint_m
    sizes = [abs(value) for corner in corners for value in corner]
    if hello.min_turning_radius_m != 0.0 or len(corners) < 3 or not all(map(math.isfinite, sizes)):
        return None
    front_m, rear_m = max(x for x, _ in corners), -min(x for x, _ in corners)
    half_m = max(abs(y) for _, y in corners)
    if min(front_m, rear_m, half_m) < _SMALLEST_M or max(front_m, rear_m, half_m) > _LARGEST_M:
        return None
    return CarGeometry(
        wheelbase_m=_TURN_M * math.tan(_STEERING_RAD),
        track_m=2 * half_m,
        wheel_radius_m=_SMALLEST_M,
        max_steering_rad=_STEERING_RAD,
        front_m=front_m,
        rear_m=rear_m,
        width_m=2 * half_m,
    )
