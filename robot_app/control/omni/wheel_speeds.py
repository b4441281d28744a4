"""From the motion that is wanted to the duty of each motor: slewed as a whole, then closed loops on the encoders."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from robot_app.control.omni.hard_stop import HardStopConfig
from robot_app.control.speed import SpeedConfig, SpeedController
from shared.geometry.omni3 import STAND_STILL, WHEELS, OmniGeometry, Twist, Wheels

_REMEMBERED = 32


def _loop_of_wheel() -> SpeedConfig:
    """Its reference is slewed here already, so the loop's own limits lie far beyond that."""
    return SpeedConfig(
        friction_duty=0.025, proportional_per_mps=1.0, integral_per_m=2.5, acceleration_mps2=4.0, deceleration_mps2=8.0
    )


@dataclass(frozen=True, slots=True)
class OmniSpeedConfig:
    wheel: SpeedConfig = field(default_factory=_loop_of_wheel)
    acceleration_mps2: float = 0.8
    deceleration_mps2: float = 1.2
    turn_radps2: float = 4.0
    inertia_s: float = 0.10  # the robot follows its motors so late, where nothing pushes it on; mass over their damping
    turn_inertia_s: float = 0.05
    lag_s: float = 0.10  # of the measured speeds: half of the odometry's window, the tick and the motors
    fastest_wheel_mps: float = 0.60  # below what a wheel reaches at full duty; faster motions are scaled as a whole
    stop: HardStopConfig = field(default_factory=HardStopConfig)


class OmniSpeedController:
    """Step it at a steady 50 to 200 Hz."""

    def __init__(self, omni: OmniGeometry, config: OmniSpeedConfig) -> None:
        self._omni = omni
        self._config = config
        self._loops = [SpeedController(config.wheel) for _ in range(WHEELS)]
        self.reset()

    def reset(self) -> None:
        self._reference = STAND_STILL
        self._last_s: float | None = None
        self._asked: deque[tuple[float, Wheels]] = deque(maxlen=_REMEMBERED)  # when, and how fast the wheels were to be
        for loop in self._loops:
            loop.reset()

    @property
    def reference(self) -> Twist:
        """The motion that is asked of the wheels now."""
        return self._reference

    def step(self, now_s: float, wanted: Twist, measured_mps: Wheels) -> Wheels:
        """The duties; exactly 0 when the robot is to stand and stands. Raises `ValueError` for what is no number."""
        if not wanted.is_finite:
            raise ValueError(f"{wanted} is asked for, which is no motion")
        step_s = 0.0 if self._last_s is None else min(max(now_s - self._last_s, 0.0), 0.1)
        self._last_s = now_s
        was = self._reference
        self._reference = self._slewed(self._within_reach(wanted), step_s)
        pushes = self._omni.wheels_mps(self._push(was, step_s))
        targets = self._omni.wheels_mps(self._reference)
        self._asked.append((now_s, targets))
        then = self._asked_for(now_s - self._config.lag_s)
        right, left, back = (
            _within_1(loop.step(now_s, target, measured + target - before) + push / self._config.wheel.full_duty_mps)
            for loop, target, before, measured, push in zip(
                self._loops, targets, then, measured_mps, pushes, strict=True
            )
        )
        return right, left, back

    def _push(self, was: Twist, step_s: float) -> Twist:
        """What the motors must be ahead of the robot to speed it up as is asked."""
        config, now = self._config, self._reference
        if step_s <= 0:
            return STAND_STILL
        share, turn_share = config.inertia_s / step_s, config.turn_inertia_s / step_s
        return Twist(
            share * (now.x_mps - was.x_mps),
            share * (now.y_mps - was.y_mps),
            turn_share * (now.turn_radps - was.turn_radps),
        )

    def _asked_for(self, then_s: float) -> Wheels:
        """What is measured now is what was asked for a moment ago: else each change winds the loops up."""
        return next((wheels for at_s, wheels in reversed(self._asked) if at_s <= then_s), self._asked[0][1])

    def _within_reach(self, wanted: Twist) -> Twist:
        fastest = max(map(abs, self._omni.wheels_mps(wanted)))
        return wanted.scaled(min(1.0, self._config.fastest_wheel_mps / max(fastest, 1e-9)))

    def _slewed(self, wanted: Twist, step_s: float) -> Twist:
        was = self._reference
        dx, dy = wanted.x_mps - was.x_mps, wanted.y_mps - was.y_mps
        rate = self._config.deceleration_mps2 if wanted.speed_mps < was.speed_mps else self._config.acceleration_mps2
        share = min(1.0, rate * step_s / max(math.hypot(dx, dy), 1e-9))
        most = self._config.turn_radps2 * step_s
        turn = was.turn_radps + max(-most, min(most, wanted.turn_radps - was.turn_radps))
        if share == 1.0:
            return Twist(wanted.x_mps, wanted.y_mps, turn)
        return Twist(was.x_mps + share * dx, was.y_mps + share * dy, turn)


def _within_1(duty: float) -> float:
    return max(-1.0, min(1.0, duty))
