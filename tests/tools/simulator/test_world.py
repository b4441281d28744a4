from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from robot_app.drivers.base import DriveSetting
from shared.geometry.se2 import Pose2
from tools.simulator.scenario import Item, Scenario, Start
from tools.simulator.world import World

MakeRoom = Callable[..., Scenario]


def run_for(world: World, seconds: float) -> None:
    world.advance_to(world.time_s + seconds)


def test_the_car_stands_still_until_it_is_driven(room: MakeRoom) -> None:
    world = World(room(), seed=1)
    run_for(world, 1.0)
    assert world.room_from_robot().distance_m(Pose2(1.0, 2.0)) < 1e-4


def test_time_runs_on_the_given_clock(room: MakeRoom) -> None:
    world = World(room(), seed=1, start_s=5.0)
    world.advance_to(5.5)
    assert world.time_s == pytest.approx(5.5)
    assert world.elapsed_s == pytest.approx(0.5)


def test_full_duty_reaches_the_no_load_speed_less_friction(room: MakeRoom) -> None:
    world = World(room(), seed=1)
    world.set_drive(DriveSetting(1.0, 0.0))
    run_for(world, 1.5)
    assert 0.58 < world.speed_mps() < 0.70


def test_duty_zero_brakes_and_negative_duty_reverses(room: MakeRoom) -> None:
    world = World(room(), seed=1)
    world.set_drive(DriveSetting(0.8, 0.0))
    run_for(world, 1.0)
    world.cut_motor()
    run_for(world, 0.4)
    assert abs(world.speed_mps()) < 0.01
    world.set_drive(DriveSetting(-0.5, 0.0))
    run_for(world, 0.6)
    assert world.speed_mps() < -0.2


def test_a_small_duty_does_not_overcome_the_gears_friction(room: MakeRoom) -> None:
    world = World(room(), seed=1)
    world.set_drive(DriveSetting(0.03, 0.0))
    run_for(world, 1.0)
    assert abs(world.speed_mps()) < 0.005


def test_steering_makes_a_circle_of_the_geometrys_radius(room: MakeRoom) -> None:
    world = World(room(start=Start((2.0, 1.3))), seed=1)
    world.set_drive(DriveSetting(0.5, 0.4))
    run_for(world, 1.0)
    before, distance_m = world.room_from_robot(), world.truth.distance_m
    run_for(world, 3.0)
    turned = world.room_from_robot().theta_rad - before.theta_rad
    radius_m = (world.truth.distance_m - distance_m) / turned
    assert radius_m == pytest.approx(0.26 / np.tan(0.4), rel=0.03)


def test_the_servo_takes_its_time(room: MakeRoom) -> None:
    world = World(room(), seed=1)
    world.set_drive(DriveSetting(0.0, 0.5))
    run_for(world, 0.05)
    assert 0.1 < world.steering_rad < 0.25
    run_for(world, 0.5)
    assert world.steering_rad == pytest.approx(0.5)


def test_settings_beyond_the_limits_are_cut(room: MakeRoom) -> None:
    world = World(room(), seed=1)
    assert world.set_drive(DriveSetting(3.0, -2.0)) == DriveSetting(1.0, -0.5)


def test_pushing_against_a_wall_is_one_collision_and_coming_back_is_another(room: MakeRoom) -> None:
    world = World(room(start=Start((3.4, 2.0))), seed=1)
    world.set_drive(DriveSetting(0.5, 0.0))
    run_for(world, 3.0)
    assert world.collisions.count == 1
    assert world.collisions.recorded[0].thing == "wall_east"
    world.set_drive(DriveSetting(-0.5, 0.0))
    run_for(world, 1.5)
    world.set_drive(DriveSetting(0.5, 0.0))
    run_for(world, 2.5)
    assert world.collisions.count == 2
    assert all(c.robot_part in {"bumper_front", "deck_high"} for c in world.collisions.recorded)


def test_driving_under_a_table_is_no_collision(room: MakeRoom) -> None:
    table = Item("table", (2.0, 2.0), (0.8, 0.8, 0.7), "table")
    world = World(room(table), seed=1)
    world.set_drive(DriveSetting(0.8, 0.0))
    run_for(world, 2.0)
    assert world.room_from_robot().x_m > 1.7
    assert world.collisions.count == 0


def test_a_slippery_floor_makes_the_car_slide_wide(room: MakeRoom) -> None:
    radii = []
    for friction in (1.0, 0.05):
        world = World(replace(room(start=Start((2.0, 1.0))), floor_friction=friction), seed=1)
        world.set_drive(DriveSetting(1.0, 0.5))
        run_for(world, 2.5)
        radii.append(world.truth.distance_m / world.room_from_robot().theta_rad)
    assert abs(radii[1] - radii[0]) > 0.02


def test_the_battery_sags_under_load_and_runs_down(room: MakeRoom) -> None:
    world = World(room(start=Start((3.4, 2.0))), seed=1)
    run_for(world, 0.1)
    rested_v = world.battery.voltage_v
    world.set_drive(DriveSetting(1.0, 0.0))  # stalls against the wall
    run_for(world, 2.0)
    assert world.battery.voltage_v < rested_v - 0.1
    assert world.battery.motor_current_a > 2.0
    for _ in range(3600):
        world.battery.step(2.0, 0.0, 0.0)
    assert world.battery.voltage_v < 6.0


def test_the_truth_is_recorded_at_50_hz(room: MakeRoom) -> None:
    world = World(room(), seed=1, start_s=2.0)
    world.set_drive(DriveSetting(0.5, 0.0))
    run_for(world, 2.0)
    poses = world.truth.poses()
    assert np.diff(poses[:, 0]) == pytest.approx(0.02)
    assert poses[0] == pytest.approx([2.0, 1.0, 2.0, 0.0], abs=1e-6)
    assert poses[-1, 1] - 1.0 == pytest.approx(world.truth.distance_m, abs=1e-3)


def test_a_stalled_machine_makes_the_world_stand_still(room: MakeRoom) -> None:
    world = World(room(), seed=1)
    run_for(world, 0.1)
    world.stand_still(3.0)
    assert world.time_s == pytest.approx(3.1)
    assert world.elapsed_s == pytest.approx(0.1)
    assert world.slipped_s == 3.0
