"""All devices of a robot on a Raspberry Pi."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Protocol, TypeVar

from robot_app.drivers.ackermann_drive import AckermannDrive
from robot_app.drivers.ads1115 import Ads1115
from robot_app.drivers.base import DeviceBusyError, DeviceError, Drive, Encoders, Hardware
from robot_app.drivers.config import DeviceConfig
from robot_app.drivers.encoder import OmniEncoders, QuadratureEncoders
from robot_app.drivers.gpio import GpioOutputs
from robot_app.drivers.hokuyo import HokuyoScanner
from robot_app.drivers.l515 import RealSenseCamera
from robot_app.drivers.lsm9ds1 import Lsm9ds1
from robot_app.drivers.omni_drive import OmniDrive
from robot_app.drivers.thermometer import CpuThermometer
from shared.geometry.ackermann import CarGeometry
from shared.geometry.omni3 import OmniGeometry
from shared.runtime.clock import Clock


class _Closes(Protocol):
    def close(self) -> None: ...


DeviceT = TypeVar("DeviceT", bound=_Closes)


def open_drive(config: DeviceConfig, body: CarGeometry | OmniGeometry, clock: Clock) -> Drive:
    """Of the robot that has this body."""
    if isinstance(body, CarGeometry):
        return AckermannDrive(config.drive, body, clock)
    assert config.omni is not None, "an omnidirectional robot's configuration has them"
    return OmniDrive(config.omni, clock)


def open_encoders(config: DeviceConfig, clock: Clock) -> Encoders:
    return QuadratureEncoders(config.encoders, clock) if config.omni is None else OmniEncoders(config.omni, clock)


def check_alone(config: DeviceConfig) -> None:
    """Raises `DeviceBusyError` while another program drives the robot: it has the lines of the bridges.

    Anybody may use an I2C bus, and whoever sets up a chip there that the app reads makes the robot stop.
    """
    wheels = (config.drive,) if config.omni is None else config.omni.wheels
    chip = config.drive.gpio_chip if config.omni is None else config.omni.gpio_chip
    lines = tuple(line for wheel in wheels for line in (wheel.forward_line, wheel.reverse_line))
    try:
        GpioOutputs("drive direction", chip, lines).close()
    except DeviceBusyError:
        raise
    except DeviceError:  # whoever needs the lines tells it
        return


def open_hardware(config: DeviceConfig, body: CarGeometry | OmniGeometry, clock: Clock) -> Hardware:
    """The drive first: it cuts the motor. Raises the `DeviceError` of the first device that cannot be opened."""
    with ExitStack() as opened:

        def kept(device: DeviceT) -> DeviceT:
            opened.callback(device.close)
            return device

        hardware = Hardware(
            drive=kept(open_drive(config, body, clock)),
            thermometer=kept(CpuThermometer(config.thermometer, clock)),
            power=kept(Ads1115(config.power, clock)),
            imu=kept(Lsm9ds1(config.imu, clock)),
            encoders=kept(open_encoders(config, clock)),
            scanner=kept(HokuyoScanner(config.scanner, clock)),
            camera=kept(RealSenseCamera(config.camera, clock)),
        )
        opened.pop_all()
    return hardware
