from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from robot_app.drivers.base import DriveSetting
from tools.simulator.drivers import SimulatedHardware
from tools.simulator.gauges import SimulatedEncoders
from tools.simulator.scenario import EncoderParameters, Scenario, SlipParameters, Start
from tools.simulator.slip import WheelSlip
from tools.simulator.world import World

MakeRoom = Callable[..., Scenario]


def slipping(scenario: Scenario, slip: SlipParameters) -> Scenario:
    return replace(scenario, encoders=EncoderParameters(left_scale_error=0.0, right_scale_error=0.0, slip=slip))


def driven(scenario: Scenario, seed: int, seconds: float = 4.0) -> tuple[World, WheelSlip, SimulatedEncoders]:
    world = World(scenario, seed)
    slip = WheelSlip(world)
    world.add_observer(slip)
    encoders = SimulatedEncoders(world, slip)
    world.set_drive(DriveSetting(0.8, 0.0))
    world.advance_to(seconds)
    return world, slip, encoders


def test_wheels_hold_unless_the_scenario_says_otherwise(room: MakeRoom) -> None:
    world, slip, _ = driven(room(start=Start((0.6, 2.0))), seed=1)
    assert slip.angles_rad == world.wheel_angles_rad()
    assert slip.figures().mean_abs == (0.0, 0.0)


def test_a_steady_slip_miscounts_by_its_share_and_its_sign_is_drawn(room: MakeRoom) -> None:
    nets = []
    for seed in range(1, 7):
        world, slip, encoders = driven(slipping(room(start=Start((0.6, 2.0))), SlipParameters(steady=0.05)), seed)
        count, rolled = encoders.sample(), world.wheel_angles_rad()
        assert count.left / (rolled[0] * 80 / math.tau) == pytest.approx(1 + slip.figures().net[0], abs=0.01)
        nets.append(slip.figures().net[0])
    assert np.abs(nets) == pytest.approx(0.05)
    assert {math.copysign(1, net) for net in nets} == {1.0, -1.0}


def test_slip_is_no_mere_scale(room: MakeRoom) -> None:
    """It changes along the way and differs between the wheels, so that no calibration takes it away."""
    world = World(slipping(room(start=Start((0.6, 2.0))), SlipParameters.of(0.05)), seed=3)
    slip = WheelSlip(world)
    world.add_observer(slip)
    world.set_drive(DriveSetting(0.8, 0.0))
    seen = []
    for k in range(1, 40):
        world.advance_to(0.1 * k)
        seen.append(slip.slip)
    left, right = np.array(seen).T
    assert left.std() > 0.02
    assert abs(np.corrcoef(left, right)[0, 1]) < 0.9
    assert min(slip.figures().mean_abs) > 0.03


def test_a_wheel_spins_when_it_pulls_and_locks_when_it_brakes(room: MakeRoom) -> None:
    world = World(slipping(room(start=Start((0.6, 2.0))), SlipParameters(burst=0.3, bursts_hz=50.0)), seed=1)
    slip = WheelSlip(world)
    world.add_observer(slip)
    world.set_drive(DriveSetting(1.0, 0.0))
    world.advance_to(0.2)
    assert max(slip.slip) > 0.1
    world.advance_to(3.0)
    assert slip.slip == (0.0, 0.0)  # steadily on
    world.set_drive(DriveSetting(0.0, 0.0))
    world.advance_to(3.1)
    assert min(slip.slip) < -0.1


def test_the_same_seed_slips_the_same_and_another_one_differently(room: MakeRoom) -> None:
    scenario = slipping(room(start=Start((0.6, 2.0))), SlipParameters.of(0.05))
    first, again, other = (driven(scenario, seed, 1.0)[1].angles_rad for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_the_robots_encoders_slip_with_the_wheels(room: MakeRoom) -> None:
    world = World(slipping(room(start=Start((0.6, 2.0))), SlipParameters(steady=0.2)), seed=1)
    hardware = SimulatedHardware(world, waits=False)
    hardware.hardware.drive.set(DriveSetting(0.8, 0.0))
    world.advance_to(3.0)
    count = hardware.hardware.encoders.read(0.0)
    hardware.hardware.camera.close()
    assert count is not None
    net = count.left / (world.wheel_angles_rad()[0] * 80 / math.tau) - 1
    assert abs(net) == pytest.approx(0.2, abs=0.02)
