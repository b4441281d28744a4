from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from robot_app.config import OMNI_PATH, OmniRobotConfig
from robot_app.drivers.base import OmniSetting
from shared.config import ConfigError
from shared.geometry.omni3 import OmniGeometry, Twist
from shared.geometry.se2 import Pose2
from tools.evaluate.goals.reachable import DiscReachable
from tools.simulator.robots import with_robot, with_robot_of
from tools.simulator.scenario import Item, Room, Scenario, Start, find_scenario
from tools.simulator.world import World

OMNI = OmniGeometry(0.13, 0.04, 0.17)


def yard(*items: Item, friction: float = 1.0) -> Scenario:
    return Scenario("yard", Start((1.0, 1.0)), Room(4.0, 2.0), items, floor_friction=friction, robot="omni")


@pytest.mark.parametrize("twist", [Twist(0.3, 0.0, 0.0), Twist(0.0, 0.3, 0.0), Twist(0.0, 0.0, 1.5)])
def test_the_wheels_turn_as_the_robot_moves(twist: Twist) -> None:
    world = World(yard(), seed=1)
    right, left, back = (speed / 0.7 for speed in OMNI.wheels_mps(twist))
    world.set_drive(OmniSetting((right, left, back)))
    world.advance_to(1.0)
    moved = world.scenario.start.room_from_robot.inverse() @ world.room_from_robot()
    right, left, back = (angle * 0.04 for angle in world.wheel_angles_rad())
    told = OMNI.twist((right, left, back))
    assert (told.x_mps, told.y_mps, told.turn_radps) == pytest.approx((moved.x_m, moved.y_m, moved.theta_rad), abs=0.02)
    assert max(moved.x_m, moved.y_m, 0.2 * moved.theta_rad) > 0.2
    assert world.collisions.count == 0


def test_on_a_slippery_floor_the_wheels_spin() -> None:
    world = World(yard(friction=0.05), seed=1)
    world.set_drive(OmniSetting((1.0, -1.0, 0.0)))
    world.advance_to(0.5)
    right, left, back = (angle * 0.04 for angle in world.wheel_angles_rad())
    way_m = world.room_from_robot().x_m - 1.0
    assert OMNI.twist((right, left, back)).x_mps > 1.5 * way_m
    assert way_m == pytest.approx(0.5 * 0.05 * 9.81 / 3 * 2 * math.sin(math.radians(60)) * 0.5**2, rel=0.15)


def test_a_wall_stops_it_and_counts() -> None:
    world = World(yard(), seed=1)
    world.set_drive(OmniSetting((-0.6, 0.6, 0.0)))
    world.advance_to(3.0)
    assert world.room_from_robot().x_m == pytest.approx(0.17, abs=0.01)
    assert [c.thing for c in world.collisions.recorded] == ["wall_west"]


def test_a_disc_reaches_what_is_wide_enough_for_it() -> None:
    """A wall across the room with a gap of 0.4 m."""
    lower, upper = (
        Item("lower", (2.0, 0.4), (0.1, 0.8, 0.5), "wall"),
        Item("upper", (2.0, 1.6), (0.1, 0.8, 0.5), "wall"),
    )
    room = yard(lower, upper)
    through = DiscReachable(room, OMNI, Pose2(1.0, 1.0), 0.02)
    kept_out = DiscReachable(room, OMNI, Pose2(1.0, 1.0), 0.05)
    assert through.poses_m()[:, 0].max() > 3.0
    assert kept_out.poses_m()[:, 0].max() < 2.0
    assert kept_out.places() < kept_out.places_that_fit()
    assert set(np.unique(np.round(through.poses_m()[:, 2], 2)).tolist()) == {-2.09, 0.0, 2.09}


def test_the_robot_comes_with_its_configuration() -> None:
    lab = find_scenario("lab")
    scenario, config = with_robot_of(lab, "omni")
    assert scenario.robot == "omni"
    assert isinstance(config, OmniRobotConfig)
    same, _ = with_robot(lab, None, OMNI_PATH)
    assert same == scenario
    assert with_robot(lab, None, None)[0] == replace(lab, robot="car")
    with pytest.raises(ConfigError, match="of the robot 'omni', not of 'car'"):
        with_robot(lab, "car", OMNI_PATH)


def test_the_configuration_agrees_with_the_robot_that_is_simulated() -> None:
    scenario, config = with_robot_of(find_scenario("corridor"), "omni")
    assert isinstance(config, OmniRobotConfig)
    true = scenario.omni
    assert config.omni == OmniGeometry(true.wheel_distance_m, true.wheel_radius_m, true.radius_m)
    assert config.odometry.ticks_per_turn == true.ticks_per_turn
    assert (config.camera.x_m, config.camera.z_m) == (true.camera_x_m, true.camera_z_m)
