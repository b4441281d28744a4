"""Gyroscope and accelerometer of the LSM9DS1 (register numbers and scales: ST data sheet DocID025715, rev. 3)."""

from __future__ import annotations

import math
import struct

from robot_app.drivers.axes import AxisMap, axis_map, mapped
from robot_app.drivers.base import ImuSample
from robot_app.drivers.config import ImuConfig
from robot_app.drivers.i2c import I2cDevice
from robot_app.drivers.polled_chip import PolledChip
from shared.runtime.clock import Clock

_WHO_AM_I, _WHO = 0x0F, 0x68
_CTRL_REG1_G, _CTRL_REG4, _CTRL_REG5_XL, _CTRL_REG6_XL, _CTRL_REG8 = 0x10, 0x1E, 0x1F, 0x20, 0x22
_STATUS, _OUT_X_XL = 0x17, 0x28  # the gyroscope's data follow the status
_GYRO_READY, _NEVER_SET = 0b10, 0x80
_ODR = {119: 0b011 << 5, 238: 0b100 << 5}
# Cut-off of the gyroscope's first low pass, which the rate fixes. The second one is left out (OUT_SEL is 0 after a
# reset), because it would only add delay; its bits in CTRL_REG1_G mean nothing then.
_LOW_PASS_HZ = {119: 38.0, 238: 76.0}
_ALL_AXES = 0x38
_BLOCK_UPDATE_AND_INCREMENT = 0x44  # the halves of a value are of one sample, registers count up in a transfer
_SOFT_RESET = 0x05
_RESET_S = 0.02
_SILENCE_S = 0.1  # without a new value for so long the chip has lost its settings, as after a dip of its supply
_START_UP_S = 0.3
_RADPS_PER_DIGIT = math.radians(8.75e-3)  # at 245 degrees a second
_MPS2_PER_DIGIT = 0.061e-3 * 9.80665  # at 2 g


class Lsm9ds1(PolledChip[ImuSample]):
    """A sample is stamped when the robot moved so: half a period and the delay of the low pass before it was read."""

    def __init__(self, config: ImuConfig, clock: Clock) -> None:
        device = I2cDevice("imu LSM9DS1", config.bus, config.address)
        super().__init__(device, clock, 1 / config.rate_hz, _SILENCE_S)
        self._config = config
        self._gyro_axes = axis_map(config.gyro_axes)
        self._acceleration_axes = axis_map(config.acceleration_axes)
        self._age_s = 0.5 / config.rate_hz + 1 / (math.tau * _LOW_PASS_HZ[config.rate_hz])
        self._open()

    def _set_up(self) -> None:
        self._check_identity(_WHO_AM_I, _WHO)
        rate_hz = self._config.rate_hz
        self._device.write(_CTRL_REG8, _SOFT_RESET)
        self._pause(_RESET_S)
        self._device.write(_CTRL_REG8, _BLOCK_UPDATE_AND_INCREMENT)
        self._device.write(_CTRL_REG4, _ALL_AXES)
        self._device.write(_CTRL_REG5_XL, _ALL_AXES)
        self._device.write(_CTRL_REG6_XL, _ODR[rate_hz])
        self._device.write(_CTRL_REG1_G, _ODR[rate_hz])
        self._expect_within(_START_UP_S)
        self._wait_for_sample(2 * _START_UP_S)  # the first one is not settled; none raises

    def _poll(self) -> ImuSample | None:
        status_and_gyro, acceleration = self._device.read((_STATUS, 7), (_OUT_X_XL, 6))
        if status_and_gyro[0] & _NEVER_SET:
            raise self._ones()
        if not status_and_gyro[0] & _GYRO_READY:
            return None
        c = self._config
        return ImuSample(
            self._clock.now_s() - self._age_s,
            _measured(status_and_gyro[1:], self._gyro_axes, _RADPS_PER_DIGIT, c.gyro_bias_radps),
            _measured(acceleration, self._acceleration_axes, _MPS2_PER_DIGIT, c.acceleration_bias_mps2),
        )


def _measured(data: bytes, axes: AxisMap, scale: float, bias: tuple[float, float, float]) -> tuple[float, float, float]:
    """Six bytes, little-endian, to robot axes without their bias."""
    x, y, z = mapped(struct.unpack("<3h", data), axes, scale)
    return x - bias[0], y - bias[1], z - bias[2]
