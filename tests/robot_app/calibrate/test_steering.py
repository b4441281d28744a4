"""The simulated car with a servo that is off, and what makes the drive end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_app.calibrate.driven_car import DrivenCar
from robot_app.calibrate.guide import CalibrationError
from robot_app.calibrate.steering import calibrate_steering
from robot_app.config import RobotConfig
from robot_app.drivers.base import DeviceError, DriveSetting, RawScan
from shared.geometry.ackermann import CarGeometry
from shared.runtime.clock import ManualClock
from tests.robot_app.calibrate.scripted import Operator, values
from tools.simulator.drivers import SimulatedHardware
from tools.simulator.imu import SimulatedImu
from tools.simulator.scenario import EncoderParameters, Room, Scenario, SlipParameters, Start
from tools.simulator.world import World

TRIM_RAD, GAIN = 0.06, 1.15  # straight is at +0.06 rad, and the wheels turn 1.15 times as far as asked
HALL = Scenario("hall", Start((3.0, 3.0)), Room(8.0, 6.0), encoders=EncoderParameters(slip=SlipParameters.of(0.01)))


class WorldClock(ManualClock):
    """Waiting moves the world."""

    def __init__(self, world: World) -> None:
        super().__init__()
        self._world = world

    def advance_to(self, time_s: float) -> None:
        super().advance_to(time_s)
        self._world.advance_to(time_s)


class OffDrive:
    """A drive whose servo has a horn that sits crooked on a lever of another length."""

    def __init__(self, drive: Any) -> None:
        self._drive = drive
        self.settings: list[DriveSetting] = []
        self.is_cut = False

    def set(self, setting: DriveSetting) -> DriveSetting:
        self.is_cut = False
        self.settings.append(setting)
        self._drive.set(DriveSetting(setting.duty, GAIN * (setting.steering_rad - TRIM_RAD)))
        return setting

    def stop(self) -> None:
        self.is_cut = True
        self._drive.stop()

    def close(self) -> None:
        self.stop()


class Hall:
    def __init__(self, config: RobotConfig, scenario: Scenario = HALL) -> None:
        self.world = World(scenario, seed=3)
        simulated = SimulatedHardware(self.world, waits=False)
        self.imu: SimulatedImu = simulated.imu
        self.hardware = simulated.hardware
        self.drive = OffDrive(self.hardware.drive)
        self.clock = WorldClock(self.world)
        self.config = config

    def car(self, **other: Any) -> DrivenCar:
        h = self.hardware
        parts = {"drive": self.drive, "encoders": h.encoders, "imu": h.imu, "scanner": h.scanner} | other
        return DrivenCar(parts["drive"], parts["encoders"], parts["imu"], parts["scanner"], self.config, self.clock)


@pytest.fixture
def hall(config: RobotConfig) -> Iterator[Hall]:
    made = Hall(config)
    yield made
    made.hardware.close()


def test_a_crooked_servo_is_found_and_put_right(hall: Hall, config: RobotConfig) -> None:
    changes = calibrate_steering(hall.car(), config, Operator())
    found = values(changes)
    assert found["servo_trim_us"] == pytest.approx(640 * TRIM_RAD, abs=640 * 0.004)
    assert found["servo_us_per_rad"] == pytest.approx(640 / GAIN, rel=0.03)
    assert hall.drive.is_cut
    assert hall.world.collisions.count == 0


def test_nothing_is_driven_without_a_yes(hall: Hall, config: RobotConfig) -> None:
    with pytest.raises(CalibrationError, match="nothing was driven"):
        calibrate_steering(hall.car(), config, Operator(agrees=False))
    assert hall.drive.settings == []


class After:
    """A device that works for so many reads and then does something else."""

    def __init__(self, device: Any, reads: int, then: Any) -> None:
        self._device, self._left, self._then = device, reads, then

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def read(self, timeout_s: float) -> Any:
        self._left -= 1
        sample = self._device.read(timeout_s)
        return sample if self._left > 0 else self._then(sample)


def _lost(_: Any) -> Any:
    raise DeviceError("scanner at /dev/ttyACM0: lost while reading; is it plugged in?")


def _near(scan: RawScan | None) -> RawScan | None:
    return None if scan is None else replace(scan, ranges_m=np.full_like(scan.ranges_m, 0.2))


@pytest.mark.parametrize(
    ("device", "then", "words"),
    [
        ("encoders", lambda _: None, "encoders fell silent"),
        ("imu", lambda _: None, "gyro fell silent"),
        ("scanner", lambda _: None, "scanner fell silent"),
        ("scanner", _near, "something stands 0.0. m ahead"),
        ("imu", lambda s: s and replace(s, acceleration_mps2=(9.0, 0.0, 3.0)), "not level"),
        ("encoders", lambda c: replace(c, left=50, right=50), "count nothing"),
    ],
)
def test_what_goes_wrong_ends_the_drive(hall: Hall, device: str, then: Any, words: str) -> None:
    standing_reads = {"encoders": 2, "imu": 150, "scanner": 1}[device]
    car = hall.car(**{device: After(getattr(hall.hardware, device), standing_reads + 100, then)})
    car.stand(0.0)
    with pytest.raises(CalibrationError, match=words):
        for _ in range(3):
            car.run(0.0, 1.0)
    assert hall.drive.is_cut


def test_a_lost_device_ends_the_drive(hall: Hall) -> None:
    car = hall.car(scanner=After(hall.hardware.scanner, 50, _lost))
    car.stand(0.0)
    with pytest.raises(DeviceError):
        car.run(0.0, 1.0)
    assert hall.drive.is_cut


def test_a_motor_that_is_reversed_is_stopped_at_once(hall: Hall) -> None:
    class Reversed(OffDrive):
        def set(self, setting: DriveSetting) -> DriveSetting:
            return super().set(DriveSetting(-setting.duty, setting.steering_rad))

    reversed_drive = Reversed(hall.hardware.drive)
    car = hall.car(drive=reversed_drive)
    car.stand(0.0)
    before = hall.world.room_from_robot()
    with pytest.raises(CalibrationError, match="wrong way"):
        car.run(0.0, 1.0)
    assert reversed_drive.is_cut
    assert abs(hall.world.room_from_robot().x_m - before.x_m) < 0.15


def test_a_car_that_is_pushed_while_it_should_stand_is_told(hall: Hall) -> None:
    car = hall.car(imu=After(hall.hardware.imu, 50, lambda s: s and replace(s, gyro_radps=(0.0, 0.0, 0.5))))
    with pytest.raises(CalibrationError, match="moved while it should stand"):
        car.stand(0.0)


def test_the_car_of_the_file_is_the_one_simulated(config: RobotConfig) -> None:
    assert isinstance(config.car, CarGeometry)
    assert config.car.wheelbase_m == HALL.car.wheelbase_m
