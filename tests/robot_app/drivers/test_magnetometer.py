"""The magnetometer against a model of its registers."""

from __future__ import annotations

import pytest

from robot_app.drivers.base import DeviceError
from robot_app.drivers.config import MagnetometerConfig
from robot_app.drivers.lsm9ds1_magnetometer import Lsm9ds1Magnetometer
from shared.runtime.clock import ManualClock
from tools.simulator.devices.registers import I2cBus, MagnetometerChip


def test_it_is_set_up_as_its_data_sheet_says(i2c: I2cBus, compass: MagnetometerChip) -> None:
    magnetometer = Lsm9ds1Magnetometer(MagnetometerConfig(), ManualClock())
    r = compass.registers
    assert r[0x20] == 0b0_11_111_0_0  # x and y at high performance, 80 Hz
    assert r[0x21] == 0  # 4 gauss
    assert r[0x22] == 0  # all the time
    assert r[0x23] == 0b1100  # z at high performance
    assert r[0x24] == 0x40  # whole samples
    magnetometer.close()
    magnetometer.close()
    assert i2c.open_handles == 0


def test_digits_become_microtesla_of_the_earth_alone(i2c: I2cBus, compass: MagnetometerChip) -> None:
    config = MagnetometerConfig(offset_ut=(10.0, 0.0, -5.0), matrix=(1.1, 1.0, 1.0, 0.0, 0.0, 0.1))
    magnetometer = Lsm9ds1Magnetometer(config, ManualClock(5.0))
    compass.sample((-1000, 500, 2000))
    sample = magnetometer.read(0.0)
    assert sample is not None
    assert sample.field_ut == pytest.approx((1.1 * 4.0, 7.0 + 0.1 * 33.0, 33.0 + 0.1 * 7.0), abs=1e-3)
    assert magnetometer.read(0.0) is None  # not the same one twice


def test_north_is_told_from_ahead_to_the_left(i2c: I2cBus, compass: MagnetometerChip) -> None:
    magnetometer = Lsm9ds1Magnetometer(MagnetometerConfig(), ManualClock())
    compass.sample((0, 2000, -2000))
    sample = magnetometer.read(0.0)
    assert sample is not None
    assert sample.north_rad == pytest.approx(1.5708, abs=1e-3)


def test_one_that_was_pulled_or_lost_its_supply_comes_back(i2c: I2cBus, compass: MagnetometerChip) -> None:
    clock = ManualClock()
    magnetometer = Lsm9ds1Magnetometer(MagnetometerConfig(), clock)
    del i2c.chips[0x1E]
    for _ in range(3):
        with pytest.raises(DeviceError, match=r"magnetometer LSM9DS1 .* 0x1e: does not answer"):
            magnetometer.read(0.0)
        clock.advance(0.6)
    i2c.chips[0x1E] = compass
    compass.power_up()
    assert magnetometer.read(0.0) is None
    compass.sample((1, 2, 3))
    assert magnetometer.read(0.0) is not None
    compass.power_up()
    clock.advance(0.3)
    with pytest.raises(DeviceError, match="measures nothing"):
        magnetometer.read(0.0)


def test_another_chip_at_the_address_is_refused(i2c: I2cBus, compass: MagnetometerChip) -> None:
    compass.registers[0x0F] = 0x68
    with pytest.raises(DeviceError, match="0x68 instead of 0x3d"):
        Lsm9ds1Magnetometer(MagnetometerConfig(), ManualClock())
    assert i2c.open_handles == 0
