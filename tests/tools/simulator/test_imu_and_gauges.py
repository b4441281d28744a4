from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from robot_app.drivers.base import DriveSetting, ImuSample
from tools.simulator.gauges import SimulatedEncoders, SimulatedPowerMonitor, SimulatedThermometer
from tools.simulator.imu import SimulatedImu
from tools.simulator.scenario import Scenario, Start
from tools.simulator.slip import WheelSlip
from tools.simulator.world import World

MakeRoom = Callable[..., Scenario]
Quiet = Callable[[Scenario], Scenario]


def imu_samples(world: World, imu: SimulatedImu, seconds: float) -> list[ImuSample]:
    samples = []
    for _ in range(round(seconds / 0.002)):
        world.advance_to(world.time_s + 0.002)
        if (sample := imu.samples.take(0.0)) is not None:
            samples.append(sample)
    return samples


def with_imu(scenario: Scenario, seed: int = 1) -> tuple[World, SimulatedImu]:
    world = World(scenario, seed)
    imu = SimulatedImu(world)
    world.add_observer(imu)
    return world, imu


def test_the_imu_samples_at_100_hz(room: MakeRoom) -> None:
    world, imu = with_imu(room())
    stamps = np.array([sample.stamp_s for sample in imu_samples(world, imu, 1.0)])
    assert len(stamps) == 100
    assert np.diff(stamps) == pytest.approx(0.01)


def test_at_rest_the_imu_shows_gravity_its_bias_and_its_noise(room: MakeRoom) -> None:
    world, imu = with_imu(room())
    samples = imu_samples(world, imu, 4.0)
    gyro = np.array([sample.gyro_radps for sample in samples])
    assert gyro.mean(axis=0) == pytest.approx(imu.gyro_bias_radps, abs=2e-3)
    assert np.degrees(gyro.std(axis=0)) == pytest.approx(0.012 * math.sqrt(50), rel=0.2)
    assert np.array([s.acceleration_mps2 for s in samples]).mean(axis=0)[2] == pytest.approx(9.81, abs=0.7)


def test_the_bias_is_another_after_each_switching_on(room: MakeRoom) -> None:
    biases = [math.degrees(with_imu(room(), seed)[1].gyro_bias_radps[2]) for seed in range(5)]
    assert len(set(biases)) == 5
    assert 0.3 < np.abs(biases).max() < 8.0


def test_the_gyro_integrates_to_the_true_heading(room: MakeRoom) -> None:
    world, imu = with_imu(room(start=Start((2.0, 1.3))))
    world.set_drive(DriveSetting(0.5, 0.4))
    samples = imu_samples(world, imu, 4.0)
    turned = sum(s.gyro_radps[2] - imu.gyro_bias_radps[2] for s in samples) * 0.01
    assert turned == pytest.approx(world.room_from_robot().theta_rad, abs=0.02)


def test_ticks_agree_with_the_driven_distance(room: MakeRoom, quiet: Quiet) -> None:
    world = World(quiet(room(start=Start((0.6, 2.0)))), seed=1)
    encoders = SimulatedEncoders(world, WheelSlip(world))
    assert (encoders.sample().left, encoders.sample().right) == (0, 0)
    world.set_drive(DriveSetting(0.8, 0.0))
    world.advance_to(4.0)
    distance_m = world.room_from_robot().x_m - 0.6
    count = encoders.sample()
    per_tick_m = math.tau * 0.04 / 80
    assert count.left * per_tick_m == pytest.approx(distance_m, rel=0.01)
    assert abs(count.left - count.right) <= 1


def test_ticks_count_down_in_reverse_and_a_left_turn_turns_the_right_wheel_further(room: MakeRoom) -> None:
    world = World(room(start=Start((2.0, 2.0))), seed=1)
    encoders = SimulatedEncoders(world, WheelSlip(world))
    world.set_drive(DriveSetting(-0.5, 0.4))
    world.advance_to(2.0)
    count = encoders.sample()
    assert count.right < count.left < 0


def test_wheels_of_another_size_miscount(room: MakeRoom) -> None:
    world = World(room(start=Start((0.6, 2.0))), seed=1)
    encoders = SimulatedEncoders(world, WheelSlip(world))
    world.set_drive(DriveSetting(1.0, 0.0))
    world.advance_to(5.0)
    left, right = world.wheel_angles_rad()
    count = encoders.sample()
    assert count.left / (left * 80 / math.tau) == pytest.approx(1.003, abs=0.002)
    assert count.right / (right * 80 / math.tau) == pytest.approx(0.998, abs=0.002)


def test_the_power_monitor_reads_the_battery_with_noise(room: MakeRoom) -> None:
    world = World(room(), seed=1)
    monitor = SimulatedPowerMonitor(world)
    voltages = [monitor.sample().battery_v for _ in range(500)]
    assert np.mean(voltages) == pytest.approx(world.battery.voltage_v, abs=1e-3)
    assert 0.002 < np.std(voltages) < 0.006


def test_the_processor_warms_up(room: MakeRoom) -> None:
    world = World(room(), seed=1)
    thermometer = SimulatedThermometer(world)
    cold = np.mean([thermometer.sample().cpu_c for _ in range(50)])
    world.advance_to(20.0)
    warm = np.mean([thermometer.sample().cpu_c for _ in range(50)])
    assert cold == pytest.approx(24.0, abs=0.3)
    assert warm == pytest.approx(24 + 31 * (1 - math.exp(-20 / 240)), abs=0.3)
