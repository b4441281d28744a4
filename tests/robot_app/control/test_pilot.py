"""The pilot with all its controllers, in a simulated room: what it does between an order and the wheels."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from robot_app.config import ControlConfig
from robot_app.drivers.base import EncoderCount, ImuSample, RawScan
from robot_app.mission import Behaviour, Mission, MissionConfig
from robot_app.pilot import Pilot
from robot_app.sensing.odometry import Odometry, OdometryConfig
from shared.geometry.se2 import Pose2
from shared.messages import Drive, EmergencyStop, GoTo, Pause, Resume, ReturnToStart, Start

STEP_S = 0.02
METRES_PER_TICK = math.tau * 0.045 / 80


class Rig:
    def __init__(self, simulated, car, geometry) -> None:  # type: ignore[no-untyped-def]
        self.car, self._geometry = simulated, geometry
        self.mission = Mission(MissionConfig())
        self._odometry = Odometry(OdometryConfig(), car)
        self.pilot = Pilot(car, ControlConfig(), self.mission, self._odometry)
        self.explores = True
        self._tick, self._way_m, self.duty = 0, 0.0, 0.0
        self.fastest_back_mps = 0.0

    def order(self, command) -> bool:  # type: ignore[no-untyped-def]
        return bool(self.mission.handle(command, self.car.now_s).accepted)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        for _ in range(round(seconds / STEP_S)):
            if until():
                return True
            self.step()
        return until()

    def step(self) -> None:
        car, before = self.car, self.car.pose
        self._sense(0.0 if self._tick == 0 else car.speed_mps * math.tan(car.steering_rad) / 0.26)
        if self._tick % 5 == 0:
            self.pilot.take_scan(RawScan(car.now_s, car.scan()), self._geometry)
        if self._tick % 10 == 0 and self.explores:
            state = self._odometry.state
            self.mission.at(state.odom_from_robot, state.distance_m)
            self.pilot.explore(car.now_s)
        setting = self.pilot.step(car.now_s, may_move=True)
        self.duty = setting.duty
        for _ in range(2):
            car.push(setting.duty, setting.steering_rad, STEP_S / 2)
        self._way_m += math.copysign(car.pose.distance_m(before), car.speed_mps)
        self.fastest_back_mps = max(self.fastest_back_mps, -car.speed_mps)
        self._tick += 1

    def _sense(self, yaw_rate_radps: float) -> None:
        ticks, now_s = math.floor(self._way_m / METRES_PER_TICK), self.car.now_s
        imu = ImuSample(now_s, (0.0, 0.0, yaw_rate_radps), (0.0, 0.0, 9.81))
        self._odometry.update(EncoderCount(now_s, ticks, ticks), imu)

    @property
    def behaviour(self) -> Behaviour:
        return self.mission.behaviour(self.car.now_s)


@pytest.fixture(name="rig")
def _rig(simulated_car, car, scan_geometry, lab) -> Rig:  # type: ignore[no-untyped-def]
    made = Rig(simulated_car(lab(1), Pose2(1.0, 0.7, 0.0), np.random.default_rng(1)), car, scan_geometry)
    made.run(0.4)
    made.order(Start())
    return made


def bring_to(rig: Rig, behaviour: Behaviour) -> None:
    """Driving, in that behaviour."""
    rig.run(2.0)
    if behaviour is not Behaviour.FOLLOW_WALL:
        rig.mission.observed(0.0, came_round=False, is_over=True)
    if behaviour in {Behaviour.FOLLOW_PATH, Behaviour.BY_HAND}:
        rig.mission.explored()
    if behaviour is Behaviour.GO_HOME:
        rig.order(ReturnToStart())
    if behaviour is Behaviour.FOLLOW_PATH:
        here = rig._odometry.state.odom_from_robot
        path = [(here @ Pose2(0.05 * k, 0.0, 0.0)).as_array() for k in range(30)]
        assert rig.order(GoTo(1, np.array(path, np.float32)))
    if behaviour is Behaviour.BY_HAND:
        rig.order(Drive(0.2, 0.0))
    assert rig.behaviour is behaviour
    assert rig.run(3.0, lambda: rig.duty != 0.0 and abs(rig.car.speed_mps) > 0.1)


@pytest.mark.parametrize("order", [EmergencyStop(), Pause()])
@pytest.mark.parametrize("behaviour", [b for b in Behaviour if b is not Behaviour.STAND])
def test_in_whatever_it_does_a_stop_and_a_pause_stop_the_car(rig: Rig, behaviour: Behaviour, order) -> None:  # type: ignore[no-untyped-def]
    bring_to(rig, behaviour)
    at = rig.car.pose
    assert rig.order(order)
    assert rig.run(0.8, lambda: rig.duty == 0.0 and abs(rig.car.speed_mps) < 0.02)
    assert rig.car.pose.distance_m(at) < 0.12
    rig.run(1.0)
    assert (rig.duty, rig.car.speed_mps) == (0.0, 0.0)


def test_a_round_goes_on_after_a_long_pause(rig: Rig) -> None:
    bring_to(rig, Behaviour.FOLLOW_WALL)
    rig.order(Pause())
    rig.run(1.0)
    rig.car.now_s += 60.0
    rig.run(0.4)
    assert rig.order(Resume())
    at = rig.car.pose
    rig.run(2.0)
    assert rig.behaviour is Behaviour.FOLLOW_WALL
    assert rig.car.pose.distance_m(at) > 0.15


def test_a_pause_in_reverse_is_safe_to_go_on_from(rig: Rig) -> None:
    bring_to(rig, Behaviour.FOLLOW_WALL)
    rig.mission.observed(0.0, came_round=False, is_over=True)
    rig.order(ReturnToStart())  # behind it
    assert rig.run(8.0, lambda: rig.car.speed_mps < -0.1)
    rig.order(Pause())
    assert rig.run(0.8, lambda: rig.duty == 0.0)
    rig.order(Resume())
    assert rig.behaviour is Behaviour.GO_HOME
    rig.run(2.0)
    rig.car._measure_clearance()
    assert rig.car.clearance_m > 0.01


def test_without_its_explorer_the_car_stands_instead_of_driving_blindly(rig: Rig) -> None:
    bring_to(rig, Behaviour.FOLLOW_WALL)
    rig.explores = False  # its task hangs
    rig.mission.observed(0.0, came_round=False, is_over=True)
    rig.run(2.0)
    assert rig.behaviour is Behaviour.EXPLORE
    assert (rig.duty, rig.car.speed_mps) == (0.0, 0.0)


def test_a_jump_of_the_odometry_ends_in_a_new_plan_not_in_a_drive_off(rig: Rig) -> None:
    bring_to(rig, Behaviour.EXPLORE)
    rig._way_m += 1.5
    for _ in range(100):
        rig.step()
        rig.car._measure_clearance()
    assert rig.car.clearance_m > 0.01
    assert abs(rig.car.speed_mps) <= 0.46
