"""Wheels that turn further, or less far, than they roll.

What an encoder counts is the way that its wheel rolled times 1 + slip. The slip of a wheel has three parts:

- steady: of the same sign for both wheels, drawn once: a soft floor, a worn tyre. Nothing on board can see it.
- wandering: drawn for each wheel by itself, exponentially correlated along the way: dust, joints, bumps.
- bursts: while the car speeds up, brakes or steers a wheel now and then spins or locks for a moment, by much more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.simulator.mjcf import STEP_S
from tools.simulator.world import World

_EVERY = 5  # steps: 100 Hz
_PERIOD_S = _EVERY * STEP_S
_SMOOTH_S = 0.05  # of the wheels' speed, which the acceleration is seen from


@dataclass(frozen=True, slots=True)
class SlipFigures:
    """What the encoder of each wheel really counted, against the way that the wheel rolled."""

    net: tuple[float, ...]  # (counted - rolled) / rolled
    mean_abs: tuple[float, ...]  # of the slip, over the way


class WheelSlip:
    """Looks at the world after each step; `angles_rad` is what the encoders' discs have turned."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._parameters = world.scenario.encoders.slip
        self._random = world.random("slip")
        wheels = len(world.wheel_angles_rad())
        sign = 1.0 if self._random.random() < 0.5 else -1.0
        spread = self._parameters.wheels_differ * self._random.uniform(-1.0, 1.0)
        self._steady = sign * self._parameters.steady * np.array([1.0 + spread, 1.0 - spread, 1.0])[:wheels]
        self._wander = self._parameters.wander * self._random.standard_normal(wheels)
        self._burst = np.zeros(wheels)
        self._burst_until_s = np.zeros(wheels)
        self._rolled_rad = np.array(world.wheel_angles_rad())
        self._extra_rad = np.zeros(wheels)
        self._way_rad, self._slipped_rad = np.zeros(wheels), np.zeros(wheels)
        self._speed_mps, self._smooth_mps = 0.0, 0.0
        self._steering_rad = world.steering_rad

    @property
    def angles_rad(self) -> tuple[float, ...]:
        """Of each wheel, since the world began."""
        rolled = self._world.wheel_angles_rad()
        return tuple(angle + extra for angle, extra in zip(rolled, self._extra_rad.tolist(), strict=True))

    @property
    def slip(self) -> tuple[float, ...]:
        """Of each wheel now."""
        return tuple((self._steady + self._wander + self._burst).tolist())

    def figures(self) -> SlipFigures:
        way = np.maximum(self._way_rad, 1e-9)
        return SlipFigures(tuple((self._extra_rad / way).tolist()), tuple((self._slipped_rad / way).tolist()))

    def after_step(self) -> None:
        if self._world.steps % _EVERY or not self._parameters.is_any:
            return
        rolled_rad = np.array(self._world.wheel_angles_rad())
        step_rad = rolled_rad - self._rolled_rad
        self._rolled_rad = rolled_rad
        self._draw(step_rad)
        extra_rad = step_rad * (self._steady + self._wander + self._burst)
        self._extra_rad += extra_rad
        self._way_rad += np.abs(step_rad)
        self._slipped_rad += np.abs(extra_rad)

    def _draw(self, step_rad: NDArray[np.float64]) -> None:
        p = self._parameters
        radius_m = self._world.scenario.body.wheel_radius_m
        kept = np.exp(-np.abs(step_rad) * radius_m / p.wander_way_m)
        self._wander = kept * self._wander + p.wander * np.sqrt(1 - kept**2) * self._random.standard_normal(len(kept))
        self._smooth_mps += (float(step_rad.mean()) * radius_m / _PERIOD_S - self._smooth_mps) * _PERIOD_S / _SMOOTH_S
        gaining_mps2 = (abs(self._smooth_mps) - abs(self._speed_mps)) / _PERIOD_S
        steered_radps = abs(self._world.steering_rad - self._steering_rad) / _PERIOD_S
        self._speed_mps, self._steering_rad = self._smooth_mps, self._world.steering_rad
        self._draw_bursts(gaining_mps2, steered_radps)

    def _draw_bursts(self, gaining_mps2: float, steered_radps: float) -> None:
        """A wheel that pulls spins, one that brakes locks, one that is steered does the one or the other."""
        p, now_s = self._parameters, self._world.elapsed_s
        draws = self._random.random((len(self._burst), 4))
        pulls = abs(gaining_mps2) > p.burst_above_mps2
        begins = draws[:, 0] < -math.expm1(-p.bursts_hz * _PERIOD_S)
        begins &= (pulls or steered_radps > p.burst_above_radps) & (now_s >= self._burst_until_s)
        sign = np.sign(gaining_mps2) if pulls else np.where(draws[:, 1] < 0.5, -1.0, 1.0)
        size = p.burst * (0.5 + draws[:, 2])
        until_s = now_s + p.burst_s * (0.5 + draws[:, 3])
        self._burst = np.where(begins, sign * size, np.where(now_s < self._burst_until_s, self._burst, 0.0))
        self._burst_until_s = np.where(begins, until_s, self._burst_until_s)
