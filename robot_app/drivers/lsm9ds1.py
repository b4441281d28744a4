"""Gyroscope and accelerometer of the LSM9DS1 (register numbers and scales: ST data sheet DocID025715, rev. 3)."""

from __future__ import annotations

import math
import struct
import threading

from robot_app.drivers.axes import AxisMap, axis_map, mapped
from robot_app.drivers.base import DeviceError, ImuSample
from robot_app.drivers.config import ImuConfig
from robot_app.drivers.i2c import I2cDevice
from robot_app.drivers.lost import Reopening
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
_REOPEN_EVERY_S = 0.5
_SILENCE_S = 0.1  # without a new value for so long the chip has lost its settings, as after a dip of its supply
_START_UP_S = 0.3
_RADPS_PER_DIGIT = math.radians(8.75e-3)  # at 245 degrees a second
_MPS2_PER_DIGIT = 0.061e-3 * 9.80665  # at 2 g


class Lsm9ds1:
    """A sample is stamped when the robot moved so: half a period and the delay of the low pass before it was read."""

    def __init__(self, config: ImuConfig, clock: Clock) -> None:
        self._clock = clock
        self._config = config
        self._gyro_axes = axis_map(config.gyro_axes)
        self._acceleration_axes = axis_map(config.acceleration_axes)
        self._reopening = Reopening(clock, _REOPEN_EVERY_S)
        self._never = threading.Event()
        self._closed = False
        self._age_s = 0.5 / config.rate_hz + 1 / (math.tau * _LOW_PASS_HZ[config.rate_hz])
        self._device = I2cDevice("imu LSM9DS1", config.bus, config.address)
        try:
            self._set_up()
        except DeviceError:
            self._device.close()
            raise

    def read(self, timeout_s: float) -> ImuSample | None:
        """After a loss the read raises `DeviceError`, and a later one sets the chip up again."""
        if self._closed:
            raise DeviceError(f"{self._device.name}: is closed")
        self._reopening.check_due()
        try:
            if self._reopening.is_lost:
                self._set_up()
                self._reopening.found()
            return self._wait_for_sample(timeout_s)
        except DeviceError as error:
            self._reopening.lost(error)
            raise

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._device.close()

    def _set_up(self) -> None:
        ((who,),) = self._device.read((_WHO_AM_I, 1))
        if who != _WHO:
            raise DeviceError(f"{self._device.name}: says {who:#04x} instead of {_WHO:#04x}; is it an LSM9DS1?")
        rate_hz = self._config.rate_hz
        self._device.write(_CTRL_REG8, _SOFT_RESET)
        self._pause(_RESET_S)
        self._device.write(_CTRL_REG8, _BLOCK_UPDATE_AND_INCREMENT)
        self._device.write(_CTRL_REG4, _ALL_AXES)
        self._device.write(_CTRL_REG5_XL, _ALL_AXES)
        self._device.write(_CTRL_REG6_XL, _ODR[rate_hz])
        self._device.write(_CTRL_REG1_G, _ODR[rate_hz])
        self._ready_by_s = self._clock.now_s() + _START_UP_S
        self._wait_for_sample(2 * _START_UP_S)  # the first one is not settled; none raises

    def _wait_for_sample(self, timeout_s: float) -> ImuSample | None:
        due_s = self._clock.now_s() + timeout_s
        while True:
            status_and_gyro, acceleration = self._device.read((_STATUS, 7), (_OUT_X_XL, 6))
            now_s = self._clock.now_s()
            if status_and_gyro[0] & _NEVER_SET:
                raise DeviceError(f"{self._device.name}: reads as nothing but ones; is a wire loose?")
            if status_and_gyro[0] & _GYRO_READY:
                self._ready_by_s = now_s + _SILENCE_S
                return self._sample(now_s, status_and_gyro[1:], acceleration)
            if now_s > self._ready_by_s:
                raise DeviceError(f"{self._device.name}: measures nothing; did its supply fail?")
            if now_s >= due_s:
                return None
            self._pause(min(due_s - now_s, 0.25 / self._config.rate_hz))

    def _sample(self, now_s: float, gyro: bytes, acceleration: bytes) -> ImuSample:
        c = self._config
        return ImuSample(
            now_s - self._age_s,
            _measured(gyro, self._gyro_axes, _RADPS_PER_DIGIT, c.gyro_bias_radps),
            _measured(acceleration, self._acceleration_axes, _MPS2_PER_DIGIT, c.acceleration_bias_mps2),
        )

    def _pause(self, seconds: float) -> None:
        self._clock.wait(self._never, self._clock.now_s() + seconds)


def _measured(data: bytes, axes: AxisMap, scale: float, bias: tuple[float, float, float]) -> tuple[float, float, float]:
    """Six bytes, little-endian, to robot axes without their bias."""
    x, y, z = mapped(struct.unpack("<3h", data), axes, scale)
    return x - bias[0], y - bias[1], z - bias[2]
