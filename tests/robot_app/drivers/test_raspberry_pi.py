"""All devices together, each on its emulated wire."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot_app.check import check_devices, table_row
from robot_app.drivers.base import DeviceError
from robot_app.drivers.config import DeviceConfig
from robot_app.drivers.raspberry_pi import open_hardware
from shared.config import ConfigError, parse
from shared.geometry.ackermann import CarGeometry
from shared.runtime.clock import MonotonicClock
from tools.simulator.devices.robot import EmulatedRobot


def test_all_devices_open_read_and_close(robot: EmulatedRobot, car: CarGeometry) -> None:
    hardware = open_hardware(robot.config, car, MonotonicClock())
    robot.send_scan(np.full(682, 1500))
    robot.imu.sample((0, 0, 0), (0, 0, 16393))
    robot.camera.send(np.full((480, 640), 4000, np.uint16), 0.0)
    scan, image, imu = hardware.scanner.read(5.0), hardware.camera.read(0.1), hardware.imu.read(0.1)
    assert scan is not None
    assert np.all(scan.ranges_m == 1.5)
    assert image is not None
    assert imu is not None
    assert hardware.encoders.read(0.0) is not None
    assert hardware.power.read(0.0) is not None
    assert hardware.thermometer.read(0.0) is not None
    hardware.close()
    assert robot.is_released
    hardware.close()


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("drive", "dtoverlay=pwm-2chan"),
        ("thermometer", "thermometer at"),
        ("power", "power monitor ADS1115 at I2C bus 1, address 0x48: does not answer"),
        ("imu", "imu LSM9DS1 at I2C bus 1, address 0x6b: does not answer"),
        ("encoders", "encoders at /dev/gpiochip0, lines 5, 6, 16, 26"),
        ("scanner", "there is no such port; is it plugged in"),
        ("camera", "depth camera: is not found"),
    ],
)
def test_one_missing_device_is_named_and_the_others_are_closed(
    robot: EmulatedRobot, car: CarGeometry, fault: str, words: str
) -> None:
    robot.remove(fault)
    with pytest.raises(DeviceError, match=words):
        open_hardware(robot.config, car, MonotonicClock())
    assert robot.is_released


def test_the_check_shows_what_each_device_says(robot: EmulatedRobot, car: CarGeometry) -> None:
    robot.keeps_measuring = True
    findings = list(check_devices(robot.config, car, MonotonicClock()))
    assert [f.device for f in findings if not f.found] == []
    words = "\n".join(table_row(f) for f in findings)
    for part in (
        "battery 7.20 V",
        "+9.81 m/s² forward, left, up: upright",
        "48.7 °C, not throttled",
        "depth in 100%",
        "46 µT, north +0°",
    ):
        assert part in words
    assert "SOKUIKI Sensor UBG-04LX-F01" in words
    assert "of 682 beams measured" in words
    assert robot.is_released


def test_the_check_goes_on_after_a_missing_device(robot: EmulatedRobot, car: CarGeometry) -> None:
    robot.keeps_measuring = True
    for name in ("power", "camera"):
        robot.remove(name)
    findings = list(check_devices(robot.config, car, MonotonicClock()))
    assert [f.device for f in findings if not f.found] == ["power", "depth camera"]
    assert "i2cdetect" in next(f.words for f in findings if f.device == "power")


@pytest.mark.parametrize(
    ("temperature", "throttled", "words"),
    [("81000", "0x0", "does the fan turn"), ("50000", "0x1", "5.1 V and 3 A")],
)
def test_heat_and_under_voltage_are_faults(
    robot: EmulatedRobot, car: CarGeometry, tmp_path: Path, temperature: str, throttled: str, words: str
) -> None:
    (tmp_path / "temp").write_text(temperature, "ascii")
    (tmp_path / "get_throttled").write_text(throttled, "ascii")
    robot.keeps_measuring = True
    finding = next(f for f in check_devices(robot.config, car, MonotonicClock()) if f.device == "processor")
    assert not finding.found
    assert words in finding.words


def test_devices_of_the_running_service_are_told(robot: EmulatedRobot, car: CarGeometry) -> None:
    robot.keeps_measuring = True
    robot.gpio.used |= {5, 23}
    busy = [f for f in check_devices(robot.config, car, MonotonicClock()) if not f.found]
    assert [f.device for f in busy] == ["drive", "power", "imu", "magnetometer", "encoders"]
    assert all("sudo systemctl stop robot-app" in f.words for f in busy)


def test_an_imu_that_lies_on_its_side_is_told(robot: EmulatedRobot, car: CarGeometry) -> None:
    robot.keeps_measuring = True
    config = replace(robot.config, imu=replace(robot.config.imu, acceleration_axes=("z", "y", "-x")))
    words = next(f.words for f in check_devices(config, car, MonotonicClock()) if f.device == "imu")
    assert "calibrate imu" in words


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"drive": {"forward_line": 5}}, "GPIO lines used twice: 5"),
        ({"drive": {"forward_line": 28}, "encoders": {"left_a": -1}}, r"from 0 to 27 \(BCM numbers\), not -1, 28"),
        ({"imu": {"address": 0x99}}, "0x99"),
        ({"imu": {"gyro_axes": ["x", "x", "z"]}}, "once each"),
        ({"imu": {"rate_hz": 100}}, "devices.imu.rate_hz must be one of 119, 238"),
        ({"power": {"full_scale_v": 5.0}}, "full_scale_v must be one of"),
        ({"power": {"battery_channel": 4}}, "from 0 to 3"),
        ({"scanner": {"prt": "/dev/ttyACM1"}}, "devices.scanner.port"),
        ({"scanner": {"range_min_m": 5.0}}, "below range_max_m"),
        ({"drive": {"servo_trim_us": 700.0}}, "must rise"),
        ({"drive": {"servo_channel": 1}}, "must differ"),
        ({"camera": {"width": 0}}, "must be positive"),
    ],
)
def test_a_wrong_setting_is_named(table: dict[str, dict[str, object]], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        parse(table, DeviceConfig, "devices.")
