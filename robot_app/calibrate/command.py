"""`robot-app calibrate WHAT`: opens the devices, measures, shows before and after, writes when told to."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType

from robot_app.calibrate.camera import calibrate_camera
from robot_app.calibrate.change import Change, write
from robot_app.calibrate.driven_car import DrivenCar
from robot_app.calibrate.encoders import calibrate_encoders
from robot_app.calibrate.guide import CalibrationError, Guide
from robot_app.calibrate.imu import calibrate_imu
from robot_app.calibrate.magnetometer import calibrate_magnetometer
from robot_app.calibrate.motor import calibrate_motor
from robot_app.calibrate.power import calibrate_power
from robot_app.calibrate.steering import calibrate_steering
from robot_app.config import DEFAULT_PATH, AnyRobotConfig, RobotConfig
from robot_app.drivers.ackermann_drive import AckermannDrive
from robot_app.drivers.ads1115 import Ads1115
from robot_app.drivers.base import DeviceError
from robot_app.drivers.config import ImuConfig, MagnetometerConfig
from robot_app.drivers.encoder import QuadratureEncoders
from robot_app.drivers.hokuyo import HokuyoScanner
from robot_app.drivers.l515 import RealSenseCamera
from robot_app.drivers.lsm9ds1 import Lsm9ds1
from robot_app.drivers.lsm9ds1_magnetometer import Lsm9ds1Magnetometer
from robot_app.drivers.raspberry_pi import check_alone
from shared.runtime.clock import Clock

_Procedure = Callable[[AnyRobotConfig, Guide, Clock], Sequence[Change]]


def _car(config: AnyRobotConfig) -> RobotConfig:
    if not isinstance(config, RobotConfig):
        raise CalibrationError("that is for a car; three wheels are set by hand, in [devices.omni]")
    return config


def _encoders(any_config: AnyRobotConfig, guide: Guide, clock: Clock) -> list[Change]:
    config = _car(any_config)
    counts_as_wired = replace(config.devices.encoders, left_reversed=False, right_reversed=False)
    with closing(QuadratureEncoders(counts_as_wired, clock)) as encoders:
        return calibrate_encoders(encoders, config, guide)


def _motor(any_config: AnyRobotConfig, guide: Guide, clock: Clock) -> list[Change]:
    config = _car(any_config)
    with ExitStack() as opened:
        drive = opened.enter_context(closing(AckermannDrive(config.devices.drive, config.car, clock)))
        encoders = opened.enter_context(closing(QuadratureEncoders(config.devices.encoders, clock)))
        return calibrate_motor(drive, encoders, config, guide, clock)


def _steering(any_config: AnyRobotConfig, guide: Guide, clock: Clock) -> list[Change]:
    config = _car(any_config)
    d = config.devices
    with ExitStack() as opened:
        drive = opened.enter_context(closing(AckermannDrive(d.drive, config.car, clock)))
        encoders = opened.enter_context(closing(QuadratureEncoders(d.encoders, clock)))
        imu = opened.enter_context(closing(Lsm9ds1(d.imu, clock)))
        scanner = opened.enter_context(closing(HokuyoScanner(d.scanner, clock)))
        return calibrate_steering(DrivenCar(drive, encoders, imu, scanner, config, clock), config, guide)


def _imu(config: AnyRobotConfig, guide: Guide, clock: Clock) -> list[Change]:
    i = config.devices.imu
    as_soldered = ImuConfig(bus=i.bus, address=i.address, rate_hz=i.rate_hz)
    with closing(Lsm9ds1(as_soldered, clock)) as chip:
        return calibrate_imu(chip, config, guide, clock)


def _magnetometer(config: AnyRobotConfig, guide: Guide, clock: Clock) -> list[Change]:
    m = config.devices.magnetometer
    with closing(Lsm9ds1Magnetometer(MagnetometerConfig(m.bus, m.address, m.axes), clock)) as magnetometer:
        return calibrate_magnetometer(magnetometer, config, guide)


def _camera(config: AnyRobotConfig, guide: Guide, clock: Clock) -> list[Change]:
    with ExitStack() as opened:
        scanner = opened.enter_context(closing(HokuyoScanner(config.devices.scanner, clock)))
        camera = opened.enter_context(closing(RealSenseCamera(config.devices.camera, clock)))
        return calibrate_camera(camera, scanner, config, guide, clock)


def _power(config: AnyRobotConfig, guide: Guide, clock: Clock) -> list[Change]:
    with closing(Ads1115(config.devices.power, clock)) as monitor:
        return calibrate_power(monitor, config, guide, clock)


PROCEDURES: dict[str, _Procedure] = {
    "encoders": _encoders,
    "motor": _motor,
    "imu": _imu,
    "steering": _steering,
    "camera": _camera,
    "power": _power,
    "magnetometer": _magnetometer,
}


def calibrate(what: str, config: AnyRobotConfig, path: Path | None, guide: Guide, clock: Clock) -> bool:
    """Whether it was done. `path`: of the robot.toml to write to; None shows the outcome only.

    What ends the program ends it through here, so that the motor is cut: Ctrl-C, SIGTERM, a terminal that goes away.
    """
    with _signals_raise():
        try:
            check_alone(config.devices)
            changes = PROCEDURES[what](config, guide, clock)
        except (CalibrationError, DeviceError) as error:
            guide.say(f"Not done: {error}.")
            return False
    guide.say("")
    for change in changes:
        guide.say(change.row())
    return _kept(path, [change for change in changes if change.is_any], guide)


def _kept(path: Path | None, changes: list[Change], guide: Guide) -> bool:
    if not changes:
        guide.say("Nothing has changed.")
        return True
    if path is None or path.resolve() == DEFAULT_PATH.resolve():
        guide.say("This is not written anywhere: name your robot.toml with --config, or put it in by hand.")
        return True
    if not guide.agree(f"Write this to {path}?"):
        guide.say("Nothing was written.")
        return True
    backup = write(path, changes)
    guide.say(f"Written; what it was before is in {backup}. It counts from the next start of robot-app.")
    return True


@contextmanager
def _signals_raise() -> Iterator[None]:
    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
