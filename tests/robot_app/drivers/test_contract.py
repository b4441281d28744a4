"""What every device on the I2C bus, the lines and the files owes, whatever its wire does.

The scanner and the depth camera, which send by themselves, have the same in their own files.
"""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_app.drivers.ads1115 import Ads1115
from robot_app.drivers.base import DeviceError
from robot_app.drivers.config import EncoderConfig, ImuConfig, MagnetometerConfig, PowerConfig, ThermometerConfig
from robot_app.drivers.encoder import QuadratureEncoders
from robot_app.drivers.lsm9ds1 import Lsm9ds1
from robot_app.drivers.lsm9ds1_magnetometer import Lsm9ds1Magnetometer
from robot_app.drivers.thermometer import CpuThermometer
from shared.runtime.clock import ManualClock
from tools.simulator.devices.gpio import GpioChip
from tools.simulator.devices.registers import I2cBus

_RETRY_S = 0.6


@dataclass(frozen=True)
class Case:
    address: int
    open: Callable[[ManualClock], Any]
    ready: Callable[[Any], None]  # its chip has a new measurement


I2C = {
    "imu": Case(0x6B, lambda clock: Lsm9ds1(ImuConfig(), clock), lambda chip: chip.sample((1, 2, 3), (4, 5, 6))),
    "magnetometer": Case(
        0x1E, lambda clock: Lsm9ds1Magnetometer(MagnetometerConfig(), clock), lambda chip: chip.sample((1, 2, 3))
    ),
    "power": Case(0x48, lambda clock: Ads1115(PowerConfig(), clock), lambda _: None),
}


@pytest.fixture(params=list(I2C))
def case(request: pytest.FixtureRequest) -> Case:
    return I2C[request.param]


class Faulty:
    """A chip on a bad wire; `fault` is called with what the chip would have said."""

    def __init__(self, chip: Any, fault: Callable[[bytes], bytes]) -> None:
        self._chip, self._fault = chip, fault

    def read(self, register: int, count: int) -> bytes:
        return self._fault(self._chip.read(register, count))

    def write(self, register: int, values: bytes) -> None:
        self._chip.write(register, values)


def test_pulled_it_is_an_error_and_plugged_in_it_comes_back(i2c: I2cBus, case: Case) -> None:
    clock = ManualClock()
    driver = case.open(clock)
    chip = i2c.chips.pop(case.address)
    for _ in range(5):
        with pytest.raises(DeviceError, match="does not answer; check its wires"):
            driver.read(0.01)
        clock.advance(_RETRY_S)
    i2c.chips[case.address] = chip
    driver.read(0.01)
    case.ready(chip)
    assert driver.read(0.01) is not None
    driver.close()
    assert i2c.open_handles == 0


@pytest.mark.parametrize("number", [errno.ETIMEDOUT, errno.EIO, errno.EAGAIN])
def test_a_bus_that_fails_is_an_error_that_names_the_device(i2c: I2cBus, case: Case, number: int) -> None:
    driver = case.open(ManualClock())

    def fail(_: bytes) -> bytes:
        raise OSError(number, "fails")

    i2c.chips[case.address] = Faulty(i2c.chips[case.address], fail)
    with pytest.raises(DeviceError, match=f"at I2C bus 1, address {case.address:#04x}"):
        driver.read(0.01)


def test_garbage_is_a_sample_or_an_error_and_ends(i2c: I2cBus, case: Case, rng: np.random.Generator) -> None:
    clock = ManualClock()
    driver = case.open(clock)
    i2c.chips[case.address] = Faulty(i2c.chips[case.address], lambda data: rng.bytes(len(data)))
    outcomes = set()
    for _ in range(300):
        before_s = clock.now_s()
        try:
            outcomes.add(type(driver.read(0.01)).__name__)
        except DeviceError:
            outcomes.add("error")
        assert clock.now_s() - before_s < 1.0
        clock.advance(0.02)
    assert outcomes & {"ImuSample", "MagneticSample", "PowerSample", "error"}


@pytest.mark.parametrize("level", [0x00, 0xFF])
def test_a_line_that_sticks_is_an_error_soon(i2c: I2cBus, case: Case, level: int) -> None:
    """SDA or SCL shorted, or a chip without supply, reads as nothing but zeros or ones."""
    clock = ManualClock()
    driver = case.open(clock)
    chip = i2c.chips[case.address]
    i2c.chips[case.address] = Faulty(chip, lambda data: bytes([level]) * len(data))
    with pytest.raises(DeviceError):
        for _ in range(50):
            driver.read(0.01)
            clock.advance(0.02)
    assert clock.now_s() < 1.5


def test_slow_answers_are_waited_for_no_longer_than_a_transfer_more(i2c: I2cBus, case: Case) -> None:
    clock = ManualClock()
    driver = case.open(clock)
    chip = i2c.chips[case.address]

    def slow(data: bytes) -> bytes:
        clock.advance(0.004)
        return data

    i2c.chips[case.address] = Faulty(chip, slow)
    case.ready(chip)
    began_s = clock.now_s()
    assert driver.read(0.02) is not None
    assert clock.now_s() - began_s < 0.06


def test_closed_it_says_so_and_may_be_closed_again(i2c: I2cBus, case: Case) -> None:
    driver = case.open(ManualClock())
    driver.close()
    driver.close()
    with pytest.raises(DeviceError, match="closed"):
        driver.read(0.0)
    assert i2c.open_handles == 0


def test_encoders_are_bounded_by_what_they_are_asked_for(gpio: GpioChip) -> None:
    encoders = QuadratureEncoders(EncoderConfig(), ManualClock())
    gpio.turn(5, 6, 400)
    assert encoders.read(0.0).left == 100
    encoders.close()
    encoders.close()
    with pytest.raises(DeviceError, match="closed"):
        encoders.read(0.0)


@pytest.mark.parametrize("text", ["", "warm\n", "48\x00", "9" * 5000])
def test_a_thermometer_file_of_garbage_is_an_error(tmp_path: Path, text: str) -> None:
    zone = tmp_path / "temp"
    zone.write_text("48000\n", "ascii")
    thermometer = CpuThermometer(ThermometerConfig(str(zone), str(tmp_path / "no")), ManualClock())
    zone.write_text(text, "ascii")
    with pytest.raises(DeviceError, match="cannot be read"):
        thermometer.read(0.0)
    zone.write_text("51000\n", "ascii")
    assert thermometer.read(0.0).cpu_c == 51.0
