"""Finds the way out where the car cannot go on: a stretch in reverse that lets it go on forward."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from robot_app.control.footprint import Footprint, Sweep
from shared.geometry.se2 import wrap_angle


@dataclass(frozen=True, slots=True)
class TurningConfig:
    steerings: int = 7  # tried in reverse and then forward, from full right to full left
    lengths_m: tuple[float, ...] = (0.08, 0.14, 0.20, 0.28, 0.36, 0.46)
    forward_m: float = 0.6  # looked at after the stretch in reverse
    least_gain_m: float = 0.10  # a way that gets no farther forward than this is none
    reverse_cost: float = 0.4  # a metre in reverse costs so many metres of distance to the carrot
    angle_cost_m: float = 0.30  # a radian off the carrot costs so many metres


@dataclass(frozen=True, slots=True)
class Turning:
    """Reverse by `reverse_m` with one steering, then go forward with another."""

    reverse_rad: float
    reverse_m: float
    forward_rad: float
    forward_m: float


def find_turning(
    footprint: Footprint,
    max_steering_rad: float,
    carrot_m: tuple[float, float] | None,
    config: TurningConfig,
) -> Turning | None:
    """The best of all pairs of arcs, or None. `carrot_m`: where the robot wants to get, robot frame."""
    steerings = np.linspace(-max_steering_rad, max_steering_rad, config.steerings)
    best, best_cost = None, math.inf
    for back_rad in steerings:
        for length in config.lengths_m:
            back = footprint.sweep(back_rad, back_rad, False, length)
            if back.free_m < length - 1e-6:
                break
            for on_rad in steerings:
                on = footprint.sweep(on_rad, on_rad, True, config.forward_m, back.end[:3].copy())
                cost = _cost(back, on, carrot_m, config)
                if on.free_m >= config.least_gain_m and cost < best_cost:
                    best = Turning(float(back_rad), length, float(on_rad), on.free_m)
                    best_cost = cost
    return best


def _cost(back: Sweep, on: Sweep, carrot_m: tuple[float, float] | None, config: TurningConfig) -> float:
    squeeze = max(0.0, 0.06 - min(back.clearance_m, on.clearance_m))
    cost = config.reverse_cost * back.free_m + 2.0 * squeeze - 0.5 * on.free_m
    if carrot_m is None:
        return cost
    dx, dy = carrot_m[0] - on.end[0], carrot_m[1] - on.end[1]
    return cost + math.hypot(dx, dy) + config.angle_cost_m * abs(wrap_angle(math.atan2(dy, dx) - float(on.end[2])))
