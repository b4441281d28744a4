"""Sensors that answer when asked: encoders, battery and motor current, processor temperature."""

from __future__ import annotations

import math

from robot_app.drivers.base import Count, EncoderCount, OmniCount, PowerSample, TemperatureSample
from tools.simulator.slip import WheelSlip
from tools.simulator.world import World


class SimulatedEncoders:
    """Ticks since its making; a wheel that is larger than its drawing turns less often, one that slips more often."""

    def __init__(self, world: World, slip: WheelSlip) -> None:
        self._world = world
        self._slip = slip
        p, omni = world.scenario.encoders, world.scenario.omni
        if world.scenario.robot == "car":
            self._per_rad = p.ticks_per_turn / math.tau
            errors: tuple[float, ...] = (p.left_scale_error, p.right_scale_error)
        else:
            self._per_rad = omni.ticks_per_turn / math.tau
            errors = omni.wheel_scale_errors
        self._scale = [1 + error for error in errors]
        # The discs stand anywhere at the start: the first tick of one wheel comes before that of the other.
        self._phase: list[float] = world.random("encoders").random(len(errors)).tolist()
        self._zero_rad = slip.angles_rad

    def sample(self) -> Count:
        angles = self._slip.angles_rad
        ticks = [
            math.floor((angle - zero) * scale * self._per_rad + phase)
            for angle, zero, scale, phase in zip(angles, self._zero_rad, self._scale, self._phase, strict=True)
        ]
        if len(ticks) == 2:
            return EncoderCount(self._world.time_s, *ticks)
        return OmniCount(self._world.time_s, (ticks[0], ticks[1], ticks[2]))


class SimulatedPowerMonitor:
    def __init__(self, world: World) -> None:
        self._world = world
        self._random = world.random("power")

    def sample(self) -> PowerSample:
        battery, sigma_v = self._world.battery, self._world.scenario.battery.noise_v
        voltage_v = battery.voltage_v + sigma_v * self._random.standard_normal()
        current_a = max(0.0, battery.motor_current_a + 0.01 * self._random.standard_normal())
        return PowerSample(self._world.time_s, float(voltage_v), float(current_a))


class SimulatedThermometer:
    """A busy processor warms up towards its final temperature."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._random = world.random("thermometer")

    def sample(self) -> TemperatureSample:
        p = self._world.scenario.temperature
        warm_c = p.ambient_c + p.rise_c * -math.expm1(-self._world.elapsed_s / p.time_constant_s)
        return TemperatureSample(self._world.time_s, float(warm_c + p.noise_c * self._random.standard_normal()))
