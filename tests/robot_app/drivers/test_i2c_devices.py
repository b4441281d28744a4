"""IMU and power monitor against models of their registers."""

from __future__ import annotations

import math
import sys

import pytest

from robot_app.drivers.ads1115 import Ads1115
from robot_app.drivers.base import DeviceError
from robot_app.drivers.config import ImuConfig, PowerConfig
from robot_app.drivers.lsm9ds1 import Lsm9ds1
from shared.runtime.clock import ManualClock
from tools.simulator.devices.registers import Ads1115Chip, I2cBus, Lsm9ds1Chip

G = 9.80665


def test_the_imu_is_set_up_as_its_data_sheet_says(i2c: I2cBus, imu_chip: Lsm9ds1Chip) -> None:
    imu = Lsm9ds1(ImuConfig(), ManualClock())
    r = imu_chip.registers
    assert r[0x10] == 0b100_00_0_00  # 238 Hz, 245 degrees a second
    assert r[0x20] == 0b100_00_0_00  # 238 Hz, 2 g
    assert r[0x22] == 0b0100_0100  # whole samples, registers count up
    assert r[0x11] == 0  # the first low pass alone
    assert (r[0x1E], r[0x1F]) == (0x38, 0x38)
    imu.close()
    imu.close()
    assert i2c.open_handles == 0


def test_digits_become_si_units_in_one_transfer(i2c: I2cBus, imu_chip: Lsm9ds1Chip) -> None:
    clock = ManualClock(5.0)
    imu = Lsm9ds1(ImuConfig(), clock)
    imu_chip.sample((-32768, 0, 11429), (0, -1000, 16393))
    before, now_s = i2c.transfers, clock.now_s()
    sample = imu.read(0.0)
    assert i2c.transfers == before + 1
    assert sample is not None
    assert sample.gyro_radps == pytest.approx((-math.radians(286.72), 0.0, math.radians(100.0)), abs=1e-3)
    assert sample.acceleration_mps2 == pytest.approx((0.0, -0.061 * G, G), abs=1e-3)
    assert sample.stamp_s == pytest.approx(now_s - 0.5 / 238 - 0.0021, abs=1e-4)
    assert imu.read(0.0) is None  # not the same one twice


def test_the_axes_are_those_of_the_robot(i2c: I2cBus, imu_chip: Lsm9ds1Chip) -> None:
    imu = Lsm9ds1(ImuConfig(gyro_axes=("y", "-x", "z"), acceleration_axes=("-z", "x", "-y")), ManualClock())
    imu_chip.sample((100, 200, 300), (100, 200, 300))
    sample = imu.read(0.0)
    assert sample is not None
    x, y, z = sample.gyro_radps
    assert (x / z, y / z) == pytest.approx((200 / 300, -100 / 300))
    x, y, z = sample.acceleration_mps2
    assert (x / z, y / z) == pytest.approx((300 / 200, -100 / 200))


def test_axes_named_twice_are_refused() -> None:
    with pytest.raises(ValueError, match="once each"):
        ImuConfig(gyro_axes=("x", "x", "z"))


def test_reading_waits_for_a_sample_and_no_longer_than_asked(i2c: I2cBus) -> None:
    clock = ManualClock()
    imu = Lsm9ds1(ImuConfig(), clock)
    began_s, before = clock.now_s(), i2c.transfers
    assert imu.read(0.01) is None
    assert clock.now_s() - began_s == pytest.approx(0.01)
    assert i2c.transfers - before < 15


def test_an_imu_that_lost_its_supply_is_set_up_again(i2c: I2cBus, imu_chip: Lsm9ds1Chip) -> None:
    clock = ManualClock()
    imu = Lsm9ds1(ImuConfig(), clock)
    imu_chip.power_up()
    clock.advance(0.2)
    with pytest.raises(DeviceError, match="measures nothing"):
        imu.read(0.0)
    clock.advance(0.6)
    assert imu.read(0.0) is None
    imu_chip.sample((0, 0, 0), (0, 0, 16393))
    assert imu.read(0.0) is not None


def test_an_imu_that_measures_nothing_stays_a_fault(i2c: I2cBus, imu_chip: Lsm9ds1Chip) -> None:
    clock = ManualClock()
    imu = Lsm9ds1(ImuConfig(), clock)
    imu_chip.is_stuck = True
    clock.advance(0.2)
    for _ in range(4):
        with pytest.raises(DeviceError, match="measures nothing"):
            imu.read(0.0)
        clock.advance(0.6)
    with pytest.raises(DeviceError, match="measures nothing"):
        Lsm9ds1(ImuConfig(), clock)
    assert i2c.open_handles == 1


def test_a_pulled_imu_is_an_error_until_it_is_back(i2c: I2cBus, imu_chip: Lsm9ds1Chip) -> None:
    clock = ManualClock()
    imu = Lsm9ds1(ImuConfig(), clock)
    del i2c.chips[0x6B]
    for _ in range(3):
        with pytest.raises(DeviceError, match=r"imu LSM9DS1 at I2C bus 1, address 0x6b: does not answer"):
            imu.read(0.0)
        clock.advance(0.6)
    i2c.chips[0x6B] = imu_chip
    imu_chip.power_up()
    imu.read(0.0)
    imu_chip.sample((0, 0, 0), (0, 0, 16393))
    assert imu.read(0.0) is not None


def test_another_chip_at_the_address_is_refused(i2c: I2cBus, imu_chip: Lsm9ds1Chip) -> None:
    imu_chip.registers[0x0F] = 0x3D
    with pytest.raises(DeviceError, match="0x3d instead of 0x68"):
        Lsm9ds1(ImuConfig(), ManualClock())
    assert i2c.open_handles == 0


def test_voltages_are_scaled_to_battery_and_current(i2c: I2cBus, converter: Ads1115Chip) -> None:
    clock = ManualClock()
    monitor = Ads1115(PowerConfig(), clock)
    sample = monitor.read(0.0)
    assert sample.battery_v == pytest.approx(7.2, abs=1e-3)
    assert sample.motor_current_a == pytest.approx(1.0, abs=1e-3)
    assert converter.configurations[-2:] == [0b1_100_001_1_111_00011, 0b1_101_001_1_111_00011]
    monitor.close()
    monitor.close()
    with pytest.raises(DeviceError, match="closed"):
        monitor.read(0.0)
    assert i2c.open_handles == 0


def test_a_conversion_is_waited_for_without_polling_all_the_time(i2c: I2cBus, converter: Ads1115Chip) -> None:
    clock = ManualClock()
    monitor = Ads1115(PowerConfig(), clock)
    began_s, before = clock.now_s(), i2c.transfers
    monitor.read(0.0)
    assert 0.0025 < clock.now_s() - began_s < 0.004
    assert i2c.transfers - before == 8  # two channels: set, look twice, read


def test_a_conversion_that_never_ends_is_an_error(i2c: I2cBus, converter: Ads1115Chip) -> None:
    clock = ManualClock()
    monitor = Ads1115(PowerConfig(), clock)
    converter.polls = 10_000
    with pytest.raises(DeviceError, match="does not end"):
        monitor.read(0.0)
    assert clock.now_s() < 0.1


def test_a_missing_bus_names_its_overlay(i2c: I2cBus) -> None:
    with pytest.raises(DeviceError, match=r"I2C bus 7.*dtparam=i2c_arm=on"):
        Ads1115(PowerConfig(bus=7), ManualClock())


def test_a_missing_library_names_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "smbus2", None)
    with pytest.raises(DeviceError, match=r"smbus2 is not installed; run: pip install '\.\[robot\]'"):
        Lsm9ds1(ImuConfig(), ManualClock())
