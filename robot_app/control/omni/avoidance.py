"""Keeps the disc from touching anything, whatever is asked of it.

Turning sweeps no ground, so it is always free. Among the directions near the wanted one it takes the one that is free
for long enough, and never goes faster than it can stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.omni3 import Twist

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class OmniAvoidanceConfig:
    margin_m: float = 0.03  # no point may come nearer to the body
    step_rad: float = 0.12  # between the directions that are tried
    farthest_rad: float = 1.9  # from straight ahead: beyond it the scanner sees nothing
    horizon_m: float = 0.9
    comfortable_m: float = 0.6  # a direction free for this long is as good as any
    comfortable_clearance_m: float = 0.08
    latency_s: float = 0.2  # scan, control and motors
    deceleration_mps2: float = 0.8
    blocked_m: float = 0.02  # a direction that is free for less is none
    tight_mps: float = 0.10  # at no clearance at all …
    tight_per_m: float = 2.5  # … and faster by this where there is more
    standing_mps: float = 0.03

    def __post_init__(self) -> None:
        if min(self.step_rad, self.horizon_m, self.deceleration_mps2) <= 0 or self.margin_m < 0:
            raise ValueError("step_rad, horizon_m and deceleration_mps2 must be positive, margin_m not negative")


@dataclass(frozen=True, slots=True)
class OmniWish:
    """What a controller wants. `freedom_rad`: how far the direction may be changed."""

    twist: Twist
    freedom_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class OmniAvoided:
    """`clearance_ahead_m`: how far it can go the way it goes; `clearance_m`: to the nearest thing beside that."""

    twist: Twist
    is_blocked: bool
    clearance_ahead_m: float
    clearance_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Lanes:
    """For each of D directions: how far it is free, and how near anything comes on the way. Both (D,)."""

    free_m: Floats
    clearance_m: Floats


def lanes(points_m: Floats, directions_rad: Floats, radius_m: float, margin_m: float, horizon_m: float) -> Lanes:
    """Where a disc can go. `points_m`: (N, 2), robot frame. What is within the margin must not come nearer."""
    distance = np.hypot(points_m[:, 0], points_m[:, 1])
    reach = np.minimum(radius_m + margin_m, np.maximum(distance - 0.004, 0.0))
    c, s = np.cos(directions_rad)[:, None], np.sin(directions_rad)[:, None]
    along = c * points_m[:, 0] + s * points_m[:, 1]
    aside = np.abs(c * points_m[:, 1] - s * points_m[:, 0])
    hit = (aside < reach) & (along > 0)
    before = along - np.sqrt(np.maximum(reach**2 - aside**2, 0.0))
    free = np.where(hit, before, horizon_m).min(axis=1, initial=horizon_m)
    free = np.maximum(free, 0.0)
    passed = (along > 0) & (along < free[:, None] + radius_m)
    clearance = np.where(passed, aside, math.inf).min(axis=1, initial=math.inf) - radius_m
    return Lanes(free, np.maximum(clearance, 0.0))


class OmniAvoidance:
    """The last word on every motion. Step it at least 20 times a second."""

    def __init__(self, radius_m: float, config: OmniAvoidanceConfig) -> None:
        self._radius_m = radius_m
        self._config = config
        self._last_rad: float | None = None

    def reset(self) -> None:
        self._last_rad = None

    def step(self, wish: OmniWish, points_m: Floats, velocity_mps: tuple[float, float]) -> OmniAvoided:
        """`points_m`: (N, 2) obstacles, robot frame; `velocity_mps`: forward and to the left, as measured."""
        wanted = wish.twist
        if wanted.speed_mps < 1e-6:
            self._last_rad = None
            return OmniAvoided(wanted, False, 0.0, math.inf)
        wanted_rad = math.atan2(wanted.y_mps, wanted.x_mps)
        directions = self._directions(wanted_rad, wish.freedom_rad)
        found = self._lanes(points_m, directions)
        best = int(np.argmin(self._costs(found, directions, wanted_rad)))
        free_m, clearance_m = float(found.free_m[best]), float(found.clearance_m[best])
        if free_m < self._config.blocked_m:
            self._last_rad = None
            return OmniAvoided(Twist(0.0, 0.0, wanted.turn_radps), True, free_m, clearance_m)
        direction = float(directions[best])
        speed = min(wanted.speed_mps, self._safe_mps(free_m, clearance_m))
        speed *= self._braking(points_m, velocity_mps)
        self._last_rad = direction
        twist = Twist(speed * math.cos(direction), speed * math.sin(direction), wanted.turn_radps)
        return OmniAvoided(twist, False, free_m, clearance_m)

    def _directions(self, wanted_rad: float, freedom_rad: float) -> Floats:
        """The wanted one first, which alone may lead to where the scanner does not see."""
        steps = int(freedom_rad / self._config.step_rad)
        around = wanted_rad + self._config.step_rad * np.arange(-steps, steps + 1)
        around = np.mod(around + math.pi, math.tau) - math.pi
        seen: Floats = around[np.abs(around) <= self._config.farthest_rad]
        return np.concatenate(([wanted_rad], seen)) if freedom_rad == 0.0 or not len(seen) else seen

    def _lanes(self, points_m: Floats, directions_rad: Floats) -> Lanes:
        config = self._config
        return lanes(points_m, directions_rad, self._radius_m, config.margin_m, config.horizon_m)

    def _costs(self, found: Lanes, directions_rad: Floats, wanted_rad: float) -> Floats:
        config = self._config
        short = np.maximum(0.0, 1.0 - found.free_m / config.comfortable_m)
        tight = np.maximum(0.0, 1.0 - found.clearance_m / config.comfortable_clearance_m)
        costs: Floats = _apart(directions_rad, wanted_rad) + 2.0 * short + 0.5 * tight
        if self._last_rad is not None:
            costs += 0.15 * _apart(directions_rad, self._last_rad)
        return costs

    def _safe_mps(self, free_m: float, clearance_m: float) -> float:
        """The speed from which it stops within `free_m`, its latency included; slower where it is tight."""
        config = self._config
        a, t = config.deceleration_mps2, config.latency_s
        stopping = math.sqrt((a * t) ** 2 + 2 * a * max(free_m - 0.01, 0.0)) - a * t
        return min(stopping, config.tight_mps + config.tight_per_m * clearance_m)

    def _braking(self, points_m: Floats, velocity_mps: tuple[float, float]) -> float:
        """Less than 1 where what is left of the motion so far leads too near to something."""
        x, y = velocity_mps
        speed = math.hypot(x, y)
        if speed < self._config.standing_mps:
            return 1.0
        ahead = self._lanes(points_m, np.array([math.atan2(y, x)]))
        return min(1.0, self._safe_mps(float(ahead.free_m[0]), math.inf) / speed)


def _apart(a_rad: Floats, b_rad: float) -> Floats:
    return np.abs(np.mod(a_rad - b_rad + math.pi, math.tau) - math.pi)
