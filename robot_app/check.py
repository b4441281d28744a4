"""`robot-app check`: opens one device after the other and tells what each of them says."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_app.drivers.ads1115 import Ads1115
from robot_app.drivers.base import DeviceBusyError, DeviceError, DriveSetting, OmniSetting
from robot_app.drivers.config import DeviceConfig
from robot_app.drivers.hokuyo import HokuyoScanner
from robot_app.drivers.l515 import RealSenseCamera
from robot_app.drivers.lsm9ds1 import Lsm9ds1
from robot_app.drivers.lsm9ds1_magnetometer import Lsm9ds1Magnetometer
from robot_app.drivers.raspberry_pi import check_alone, open_drive, open_encoders
from robot_app.drivers.thermometer import CpuThermometer
from shared.geometry.ackermann import CarGeometry
from shared.geometry.omni3 import OmniGeometry
from shared.link.base import LinkError
from shared.link.es920lr.core import Ready
from shared.link.radio_config import RadioConfig
from shared.link.radios import open_one
from shared.runtime.clock import Clock

_PATIENCE_S = 3.0
_HOT_C = 75.0  # a Pi slows down from 80 on
_EARTH_UT = (20.0, 70.0)
_MEASURES_NOTHING = "opens, but measures nothing; check its supply"
_RADIO_PATIENCE_S = 15.0  # at any baud rate, in any state
_SHARED = "I2C"  # anybody may open it: a chip that is set up anew under the app that reads it makes the robot stop
_ROBOT_RUNS = "not looked at: the robot's app is using it; sudo systemctl stop robot-app, then check again"
_COLUMNS = ("device", "where", "found", "what it says, or what to do")


@dataclass(frozen=True, slots=True)
class Finding:
    device: str
    where: str
    found: bool
    words: str


def check_devices(config: DeviceConfig, body: CarGeometry | OmniGeometry, clock: Clock) -> Iterator[Finding]:
    """One finding after the other, so that they can be shown as they come. No wheel turns."""
    c = config
    robot_runs = _robot_runs(c)
    checks: tuple[tuple[str, str, Callable[[], str]], ...] = (
        ("drive", _where_the_drive_is(c), lambda: _drive(c, body, clock)),
        ("processor", c.thermometer.zone, lambda: _thermometer(c, clock)),
        ("power", f"I2C {c.power.bus}, {c.power.address:#04x}", lambda: _power(c, clock)),
        ("imu", f"I2C {c.imu.bus}, {c.imu.address:#04x}", lambda: _imu(c, clock)),
        ("magnetometer", f"I2C {c.magnetometer.bus}, {c.magnetometer.address:#04x}", lambda: _magnetometer(c, clock)),
        ("encoders", c.encoders.chip if c.omni is None else c.omni.gpio_chip, lambda: _encoders(c, clock)),
        ("scanner", c.scanner.address or c.scanner.port, lambda: _scanner(c, clock)),
        ("depth camera", f"USB {c.camera.serial}".rstrip(), lambda: _camera(c, clock)),
    )
    for device, where, look in checks:
        try:
            if robot_runs and where.startswith(_SHARED):
                raise DeviceError(_ROBOT_RUNS)
            finding = Finding(device, where, True, look())
        except DeviceError as error:
            finding = Finding(device, where, False, str(error))
        yield finding


def _robot_runs(c: DeviceConfig) -> bool:
    try:
        check_alone(c)
    except DeviceBusyError:
        return True
    return False


def check_radios(radio: RadioConfig, clock: Clock) -> Iterator[Finding]:
    """The same of each radio module, brought up as the link does it."""
    for i, port in enumerate(radio.ports):
        try:
            finding = Finding(f"radio {'AB'[i]}", port, True, _radio(radio, i, clock))
        except LinkError as error:
            of_the_pi = port.startswith("/dev/ttyAMA") and not Path(port).exists()
            words = (
                f"{port}: this UART is off; put dtoverlay=uart2 or uart4 into config.txt" if of_the_pi else str(error)
            )
            finding = Finding(f"radio {'AB'[i]}", port, False, words)
        yield finding


def table_row(finding: Finding | None) -> str:
    """A line of the table; the heading for None."""
    cells = _COLUMNS
    if finding is not None:
        cells = (finding.device, finding.where, "yes" if finding.found else "NO", finding.words)
    return f"{cells[0]:<13} {cells[1]:<40} {cells[2]:<6} {cells[3]}"


def _radio(c: RadioConfig, radio: int, clock: Clock) -> str:
    settings = c.settings(radio)
    with open_one(c, radio, clock) as driver:
        events = driver.wait_until_operating(_RADIO_PATIENCE_S)
    was_asked = any(isinstance(event, Ready) and event.settings is not None for event in events)
    at = f"{settings.bandwidth_hz / 1e3:g} kHz, SF{settings.spreading_factor}, channel {settings.channel}"
    return f"operates at {at}" if was_asked else f"operates; `radio-config check` tells whether at {at}"


def _where_the_drive_is(c: DeviceConfig) -> str:
    wires = c.drive if c.omni is None else c.omni
    return f"{wires.pwm_chip}, {wires.gpio_chip}"


def _drive(c: DeviceConfig, body: CarGeometry | OmniGeometry, clock: Clock) -> str:
    is_car = isinstance(body, CarGeometry)
    with closing(open_drive(c, body, clock)) as drive:
        drive.set(DriveSetting(0.0, 0.0) if is_car else OmniSetting((0.0, 0.0, 0.0)))
    if not is_car:
        return "the three motors are free; which way each turns shows while driving by hand, lifted"
    return "the front wheels must stand straight now; if not: robot-app calibrate steering"


def _thermometer(c: DeviceConfig, clock: Clock) -> str:
    sample = CpuThermometer(c.thermometer, clock).read(_PATIENCE_S)
    text = f"{sample.cpu_c:.1f} °C, {', '.join(sample.throttling) or 'not throttled'}"
    if "under-voltage" in sample.throttling:
        raise DeviceError(f"{text}: give the Pi 5.1 V and 3 A over a short, thick cable, apart from the motor's supply")
    if sample.cpu_c >= _HOT_C:
        raise DeviceError(f"{text}: does the fan turn, is the heat sink on?")
    return text


def _power(c: DeviceConfig, clock: Clock) -> str:
    with closing(Ads1115(c.power, clock)) as monitor:
        sample = monitor.read(_PATIENCE_S)
    return f"battery {sample.battery_v:.2f} V, motor {sample.motor_current_a:+.2f} A; compare with a multimeter"


def _imu(c: DeviceConfig, clock: Clock) -> str:
    with closing(Lsm9ds1(c.imu, clock)) as imu:
        sample = imu.read(_PATIENCE_S)
    if sample is None:
        raise DeviceError(_MEASURES_NOTHING)
    x, y, z = sample.acceleration_mps2
    text = f"acceleration {x:+.2f} {y:+.2f} {z:+.2f} m/s² forward, left, up"
    if abs(z - 9.8) < 1.5 and math.hypot(x, y) < 1.5:
        return f"{text}: upright"
    return f"{text}: should be near 0 0 +9.8 on level floor; robot-app calibrate imu sets devices.imu.acceleration_axes"


def _magnetometer(c: DeviceConfig, clock: Clock) -> str:
    with closing(Lsm9ds1Magnetometer(c.magnetometer, clock)) as magnetometer:
        sample = magnetometer.read(_PATIENCE_S)
    if sample is None:
        raise DeviceError(_MEASURES_NOTHING)
    size_ut = math.hypot(*sample.field_ut)
    text = f"{size_ut:.0f} µT, north {math.degrees(sample.north_rad):+.0f}° to the left"
    if _EARTH_UT[0] <= size_ut <= _EARTH_UT[1]:
        return text
    return f"{text}; the earth's field has 20 to 70: robot-app calibrate magnetometer (nothing drives by it)"


def _encoders(c: DeviceConfig, clock: Clock) -> str:
    open_encoders(c, clock).close()
    return "the lines are free; robot-app calibrate encoders tells whether and how they count"


def _scanner(c: DeviceConfig, clock: Clock) -> str:
    with closing(HokuyoScanner(c.scanner, clock)) as scanner:
        scan = scanner.read(_PATIENCE_S)
    if scan is None:
        raise DeviceError("opens, but sends only one scan; check its supply")
    identity = scanner.identity
    measured = int(np.isfinite(scan.ranges_m).sum())
    return (
        f"{identity.product}, serial {identity.serial}, {identity.state.rstrip('.')}; "
        f"{measured} of {len(scan.ranges_m)} beams measured"
    )


def _camera(c: DeviceConfig, clock: Clock) -> str:
    with closing(RealSenseCamera(c.camera, clock)) as camera:
        due_s = clock.now_s() + c.camera.start_up_s
        image = camera.read(_PATIENCE_S)
        while image is None and clock.now_s() < due_s:
            image = camera.read(_PATIENCE_S)
    if image is None:
        raise DeviceError("opens, but sends no frames; is it plugged into a blue USB 3 port?")
    lens = camera.intrinsics
    share = float(np.count_nonzero(image.depth)) / image.depth.size
    return f"{camera.model}, {lens.width} x {lens.height}, depth in {share:.0%} of the pixels; read by {camera.where}"
