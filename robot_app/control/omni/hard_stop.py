"""Stops the omnidirectional robot on the shortest way that its wheels can hold.

A push that is too hard makes the wheels slip: the encoders say then that the robot is slow while it still slides. So
its speed is taken down along a straight line, just below what the wheels hold, with what the mass needs added; the
encoders correct what is wrong with that. Where they say nothing any more, the line alone has to do. On a floor that
holds less the wheels turn as the line says, and not backwards: they slip by what the floor lacks, and stand at the end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from shared.geometry.omni3 import OmniGeometry, Twist, Wheels


@dataclass(frozen=True, slots=True)
class HardStopConfig:
    deceleration_mps2: float = 3.8  # of the fastest wheel; with a third of the weight on each it slips at 0.5 g
    inertia_s: float = 0.160  # in which its speed fades by e with the motors shorted: its mass over their damping
    turn_inertia_s: float = 0.115  # the same of its turn
    friction_mps: float = 0.018  # what a motor is told before its wheel begins to turn
    feedback: float = 1.5  # of what a wheel is too fast by its encoder, added to what it is told …
    felt_feedback: float = 0.7  # … and by the IMU, whose sums know it to 0.04 m/s
    lag_s: float = 0.017  # of what the encoders say: half of their window, and more where the clock is not ours
    felt_lag_s: float = 0.005  # of what the IMU feels: half of its tick
    tick_s: float = 0.02  # of who brakes: a push lasts as long, and is right for its middle
    settles_s: float = 0.12  # for so long they correct what is left at the end of the line
    stands_mps: float = 0.02  # less is no tick within their window

    def __post_init__(self) -> None:
        if self.deceleration_mps2 <= 0 or self.tick_s <= 0:
            raise ValueError("deceleration_mps2 and tick_s must be positive")


class HardStop:
    """Says how fast each motor would have to turn without load."""

    def __init__(self, omni: OmniGeometry, config: HardStopConfig) -> None:
        self._omni = omni
        self._config = config
        self.begin(-math.inf, (0.0, 0.0, 0.0))

    def begin(self, now_s: float, wheels_mps: Wheels) -> None:
        """`wheels_mps`: how fast they roll now."""
        self._began_s = now_s
        self._from_mps = wheels_mps
        self._lasts_s = max(map(abs, wheels_mps)) / self._config.deceleration_mps2
        self._is_over = self._lasts_s == 0.0

    def step(self, now_s: float, wheels_mps: Wheels | None, are_felt: bool = False) -> Wheels | None:
        """`wheels_mps` as the encoders or, where `are_felt`, the IMU tell them, None where neither does.

        None once the braking is over.
        """
        config, elapsed_s = self._config, now_s - self._began_s
        feedback, lag_s = (config.felt_feedback, config.felt_lag_s) if are_felt else (config.feedback, config.lag_s)
        ends_s = self._lasts_s + (config.settles_s if wheels_mps is not None and not are_felt else 0.0)
        stands = wheels_mps is not None and max(map(abs, wheels_mps)) < config.stands_mps
        self._is_over |= not 0 <= elapsed_s < ends_s or (stands and elapsed_s >= self._lasts_s)
        if self._is_over:
            return None
        line, push = self._line(elapsed_s + config.tick_s / 2), self._push(elapsed_s)
        then = self._line(elapsed_s - lag_s)
        right, left, back = (
            a + b + (feedback * (c - now) if wheels_mps is not None else 0.0)
            for a, b, c, now in zip(line, push, then, wheels_mps or then, strict=True)
        )
        return right, left, back

    def _line(self, elapsed_s: float) -> Wheels:
        share = min(1.0, max(0.0, 1 - elapsed_s / self._lasts_s))
        right, left, back = self._from_mps
        return share * right, share * left, share * back

    def _push(self, elapsed_s: float) -> Wheels:
        """What slows the mass down, for the part of the coming tick in which it is still to be slowed down."""
        part = min(1.0, max(0.0, (self._lasts_s - elapsed_s) / self._config.tick_s)) / self._lasts_s
        was = self._omni.twist(self._from_mps)
        move, turn = -part * self._config.inertia_s, -part * self._config.turn_inertia_s
        push = self._omni.wheels_mps(Twist(move * was.x_mps, move * was.y_mps, turn * was.turn_radps))
        held_mps = min(1.0, part * self._lasts_s) * self._config.friction_mps
        right, left, back = (a + math.copysign(held_mps, b) for a, b in zip(push, self._from_mps, strict=True))
        return right, left, back
