from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from robot_app.config import OMNI_PATH, OmniRobotConfig, load_any_config
from robot_app.control.omni.wheel_speeds import OmniSpeedConfig, OmniSpeedController
from robot_app.drivers.base import OmniSetting
from robot_app.sensing.odometry import Odometry
from shared.geometry.omni3 import STAND_STILL, OmniGeometry, Twist
from shared.geometry.se2 import Pose2
from tools.simulator.drivers import SimulatedHardware
from tools.simulator.scenario import find_scenario
from tools.simulator.world import World

OMNI = OmniGeometry(0.13, 0.04, 0.17)
STANDS = (0.0, 0.0, 0.0)


def test_the_true_robot_takes_on_each_motion_and_does_not_overshoot() -> None:
    """In the physics, with encoders and their delay."""
    config = load_any_config(OMNI_PATH)
    assert isinstance(config, OmniRobotConfig)
    world = World(replace(find_scenario("lab"), robot="omni", items=()), 1)
    world.place(Pose2(0.5, 2.0, 0.0))
    hardware = SimulatedHardware(world, waits=False).hardware
    odometry = Odometry(config.odometry, config.omni)
    controller = OmniSpeedController(config.omni, config.control.speed)
    for wanted in (Twist(0.4, 0.0, 0.0), STAND_STILL, Twist(0.0, 0.25, 0.0), Twist(0.0, -0.2, 0.8), STAND_STILL):
        seen = []
        for k in range(120):
            world.advance_to(world.time_s + 0.01)
            odometry.update(hardware.encoders.read(0.0), hardware.imu.read(0.0))
            if k % 2:
                right, left, back = odometry.state.wheels_mps or STANDS
                hardware.drive.set(OmniSetting(controller.step(world.time_s, wanted, (right, left, back))))
            theta, (vx, vy) = world.room_from_robot().theta_rad, world.data.qvel[:2].tolist()
            c, s = math.cos(theta), math.sin(theta)
            seen.append((c * vx + s * vy, c * vy - s * vx, float(world.data.qvel[5])))
        x, y, turn = np.array(seen)[-20:].mean(axis=0).tolist()
        assert (x, y) == pytest.approx((wanted.x_mps, wanted.y_mps), abs=0.03)
        assert turn == pytest.approx(wanted.turn_radps, abs=0.12)
        fastest = np.hypot(*np.array(seen)[80:, :2].T).max()
        assert fastest <= wanted.speed_mps + 0.04
    assert world.collisions.count == 0


def test_too_fast_a_motion_is_scaled_as_a_whole() -> None:
    controller = OmniSpeedController(OMNI, OmniSpeedConfig(acceleration_mps2=100.0, turn_radps2=1e4))
    for k in range(10):
        controller.step(0.1 * k, Twist(2.0, 1.0, 4.0), STANDS)
    reference = controller.reference
    assert max(map(abs, OMNI.wheels_mps(reference))) == pytest.approx(0.60)
    assert (reference.y_mps / reference.x_mps, reference.turn_radps / reference.x_mps) == pytest.approx((0.5, 2.0))


def test_who_is_to_stand_and_stands_gets_no_duty() -> None:
    controller = OmniSpeedController(OMNI, OmniSpeedConfig())
    assert [controller.step(0.02 * k, STAND_STILL, STANDS) for k in range(3)] == [STANDS] * 3


def test_after_a_cut_it_begins_from_standing() -> None:
    controller = OmniSpeedController(OMNI, OmniSpeedConfig())
    for k in range(50):
        controller.step(0.02 * k, Twist(0.4, 0.0, 0.0), STANDS)
    controller.reset()
    assert controller.reference == STAND_STILL
    assert controller.step(2.0, STAND_STILL, STANDS) == STANDS


def test_what_is_no_number_is_refused() -> None:
    controller = OmniSpeedController(OMNI, OmniSpeedConfig())
    with pytest.raises(ValueError, match="no motion"):
        controller.step(0.0, Twist(math.nan, 0.0, 0.0), STANDS)
