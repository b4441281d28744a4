from __future__ import annotations

import math

import pytest

from robot_app.drivers.base import ImuSample, OmniCount
from robot_app.sensing.odometry import Odometry, OdometryConfig
from shared.geometry.omni3 import OmniGeometry, Twist

OMNI = OmniGeometry(0.13, 0.04, 0.17)
CONFIG = OdometryConfig(ticks_per_turn=320.0)
TICK_M = math.tau * 0.04 / 320


class Driven:
    """Feeds encoders and gyro at 100 Hz."""

    def __init__(self) -> None:
        self.odometry = Odometry(CONFIG, OMNI)
        self.now_s = 0.0
        self._ways_m = [0.0, 0.0, 0.0]

    def drive(self, seconds: float, twist: Twist, gyro_radps: float | None = None) -> None:
        for _ in range(round(seconds * 100)):
            self.now_s += 0.01
            for i, speed in enumerate(OMNI.wheels_mps(twist)):
                self._ways_m[i] += 0.01 * speed
            ticks = [math.floor(way / TICK_M + 1e-6) for way in self._ways_m]
            rate = twist.turn_radps if gyro_radps is None else gyro_radps
            count = OmniCount(self.now_s, (ticks[0], ticks[1], ticks[2]))
            self.odometry.update(count, ImuSample(self.now_s, (0.0, 0.0, rate), (0.0, 0.0, 9.81)))


@pytest.fixture
def driven() -> Driven:
    return Driven()


def test_it_goes_sideways_without_turning(driven: Driven) -> None:
    driven.drive(5.0, Twist(0.0, 0.2, 0.0))
    state = driven.odometry.state
    assert state.odom_from_robot.y_m == pytest.approx(1.0, abs=0.005)
    assert state.odom_from_robot.x_m == pytest.approx(0.0, abs=0.005)
    assert (state.speed_mps, state.lateral_mps) == pytest.approx((0.0, 0.2), abs=0.02)
    assert state.distance_m == pytest.approx(1.0, abs=0.02)


def test_a_turn_on_the_spot_is_no_way(driven: Driven) -> None:
    driven.drive(2.0, Twist(0.0, 0.0, 1.0))
    state = driven.odometry.state
    assert state.odom_from_robot.theta_rad == pytest.approx(2.0, abs=0.02)
    assert math.hypot(state.odom_from_robot.x_m, state.odom_from_robot.y_m) < 0.005
    assert state.distance_m < 0.05  # the ticks of the three wheels do not come at once


def test_a_circle_that_it_slides_along_ends_where_it_began(driven: Driven) -> None:
    """Facing the middle of a circle of 0.4 m all the way round."""
    driven.drive(math.tau / 0.5, Twist(0.0, -0.2, 0.5))
    pose = driven.odometry.state.odom_from_robot
    assert math.hypot(pose.x_m, pose.y_m) < 0.01


def test_the_heading_is_the_gyros_whatever_the_wheels_say(driven: Driven) -> None:
    driven.drive(1.0, Twist(0.2, 0.0, 0.5), gyro_radps=0.0)
    assert driven.odometry.state.odom_from_robot.theta_rad == 0.0


def test_while_it_stands_the_bias_is_learnt(driven: Driven) -> None:
    driven.drive(5.0, Twist(0.0, 0.0, 0.0), gyro_radps=0.05)
    assert driven.odometry.gyro_bias_radps == pytest.approx(0.05, abs=0.002)
    assert driven.odometry.is_calibrated


def test_between_two_states_it_is_between_them(driven: Driven) -> None:
    driven.drive(1.0, Twist(0.1, 0.1, 0.0))
    between = driven.odometry.at(driven.now_s - 0.055)
    assert between is not None
    assert between.odom_from_robot.y_m == pytest.approx(0.0945, abs=0.003)
    assert between.lateral_mps == pytest.approx(0.1, abs=0.02)


def test_the_accelerations_that_are_felt_tell_the_speed_when_the_encoders_are_silent(driven: Driven) -> None:
    """The accelerometer has an offset, which is learnt while the robot stands."""
    rest = (0.6, -0.3, 9.81)
    for k in range(200):
        driven.now_s += 0.01
        is_silent = k >= 180
        imu = ImuSample(driven.now_s, (0.0, 0.0, 0.0), (rest[0] - 4.0, rest[1] + 1.0, 9.81) if is_silent else rest)
        ticks = max(0, k - 150)  # it drives then
        driven.odometry.update(None if is_silent else OmniCount(driven.now_s, (ticks, -ticks, 0)), imu)
        if k == 180:
            before = driven.odometry.state.felt
    felt = driven.odometry.state.felt
    assert before is not None
    assert felt is not None
    assert felt.stamp_s - before.stamp_s == pytest.approx(0.19)
    assert (felt.x_mps - before.x_mps, felt.y_mps - before.y_mps) == pytest.approx((-0.76, 0.19), abs=0.01)
