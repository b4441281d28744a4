from __future__ import annotations

import math

import pytest

from robot_app.drivers.base import EncoderCount, ImuSample
from robot_app.sensing.odometry import Odometry, OdometryConfig
from shared.geometry.ackermann import CarGeometry

CAR = CarGeometry(0.26, 0.17, 0.04, 0.5, 0.305, 0.045, 0.2)
TICK_M = math.tau * 0.04 / 80


def drive(
    odometry: Odometry, start_s: float, seconds: float, speed_mps: float, yaw_rate: float, bias: float = 0.0
) -> float:
    """Feed encoders and gyro at 100 Hz for a steady motion; returns the time at its end."""
    ticks_before = drive.ticks if start_s else 0.0  # type: ignore[attr-defined]
    for i in range(1, round(seconds * 100) + 1):
        now_s = start_s + i / 100
        ticks = ticks_before + speed_mps * i / 100 / TICK_M
        count = math.floor(ticks)
        odometry.update(
            EncoderCount(now_s, count, count), ImuSample(now_s, (0.0, 0.0, yaw_rate + bias), (0.0, 0.0, 9.81))
        )
        drive.ticks = ticks  # type: ignore[attr-defined]
    return start_s + seconds


def test_a_straight_drive_counts_its_metres() -> None:
    odometry = Odometry(OdometryConfig(), CAR)
    drive(odometry, 0.0, 10.0, 0.2, 0.0)
    assert odometry.state.odom_from_robot.x_m == pytest.approx(2.0, abs=2 * TICK_M)
    assert odometry.state.odom_from_robot.y_m == 0.0
    assert odometry.state.speed_mps == pytest.approx(0.2, abs=0.04)
    assert odometry.state.distance_m == pytest.approx(2.0, abs=2 * TICK_M)


def test_a_full_circle_ends_where_it_began_in_spite_of_the_gyros_bias() -> None:
    odometry = Odometry(OdometryConfig(), CAR)
    now_s = drive(odometry, 0.0, 5.0, 0.0, 0.0, bias=0.05)  # stands and learns
    assert odometry.is_calibrated
    assert odometry.gyro_bias_radps == pytest.approx(0.05, abs=0.002)
    drive(odometry, now_s, math.tau / 0.4, 0.2, 0.4, bias=0.05)
    pose = odometry.state.odom_from_robot
    assert math.hypot(pose.x_m, pose.y_m) < 0.03
    assert abs(pose.theta_rad) < 0.03


def test_a_standing_robot_does_not_turn_by_its_gyros_bias() -> None:
    odometry = Odometry(OdometryConfig(), CAR)
    drive(odometry, 0.0, 60.0, 0.0, 0.0, bias=0.05)
    assert abs(odometry.state.odom_from_robot.theta_rad) < 0.02


def test_the_past_second_can_be_asked_for_and_is_interpolated() -> None:
    odometry = Odometry(OdometryConfig(), CAR)
    drive(odometry, 0.0, 5.0, 0.4, 0.0)
    state = odometry.at(4.555)
    assert state is not None
    assert state.odom_from_robot.x_m == pytest.approx(0.4 * 4.555, abs=2 * TICK_M)
    assert odometry.at(0.5) is None


def test_a_gap_in_the_gyro_does_not_turn_the_robot() -> None:
    odometry = Odometry(OdometryConfig(), CAR)
    now_s = drive(odometry, 0.0, 1.0, 0.2, 0.5)
    before = odometry.state.odom_from_robot.theta_rad
    odometry.update(None, ImuSample(now_s + 3.0, (0.0, 0.0, 0.5), (0.0, 0.0, 9.81)))
    assert odometry.state.odom_from_robot.theta_rad - before == pytest.approx(0.05, abs=1e-6)


def test_a_wheel_that_slips_does_not_turn_the_robot() -> None:
    """Its ticks would; the gyro knows better, and of the way half of the error is left."""
    odometry = Odometry(OdometryConfig(), CAR)
    for i in range(1, 501):
        ticks = 0.2 * i / 100 / TICK_M
        count = EncoderCount(i / 100, math.floor(1.3 * ticks), math.floor(ticks))
        odometry.update(count, ImuSample(i / 100, (0.0, 0.0, 0.0), (0.0, 0.0, 9.81)))
    pose = odometry.state.odom_from_robot
    assert pose.theta_rad == 0.0
    assert pose.x_m == pytest.approx(1.15 * 1.0, abs=2 * TICK_M)


def test_a_robot_that_creeps_round_a_bend_does_not_learn_its_turning_as_the_gyros_bias() -> None:
    odometry = Odometry(OdometryConfig(), CAR)
    now_s = drive(odometry, 0.0, 3.0, 0.0, 0.0, bias=0.01)
    now_s = drive(odometry, now_s, 1.0, 0.1, 0.2, bias=0.01)
    drive(odometry, now_s, 3.0, 0.004, 0.02, bias=0.01)
    assert odometry.gyro_bias_radps == pytest.approx(0.01, abs=1e-4)
    assert odometry.state.odom_from_robot.theta_rad == pytest.approx(0.26, abs=0.005)
