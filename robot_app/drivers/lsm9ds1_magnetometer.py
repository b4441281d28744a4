"""Magnetometer of the LSM9DS1, a chip of its own on the bus (register numbers and scales: ST DocID025715, rev. 3)."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.axes import axis_map, mapped
from robot_app.drivers.config import MagnetometerConfig, Symmetric
from robot_app.drivers.i2c import I2cDevice
from robot_app.drivers.polled_chip import PolledChip
from shared.runtime.clock import Clock

_WHO_AM_I, _WHO = 0x0F, 0x3D
_CTRL_REG1_M, _CTRL_REG2_M, _CTRL_REG3_M, _CTRL_REG4_M, _CTRL_REG5_M = 0x20, 0x21, 0x22, 0x23, 0x24
_STATUS = 0x27  # the data follow it
_READY, _COUNT_UP = 0x08, 0x80  # of all axes; in the register's number: the next byte is of the next register
_ONES = bytes([0xFF]) * 7
_HIGH_PERFORMANCE_80_HZ = 0b0_11_111_0_0
_GAUSS_4 = 0x00
_CONTINUOUS = 0x00
_Z_HIGH_PERFORMANCE = 0b11 << 2
_BLOCK_UPDATE = 0x40
_SOFT_RESET = 0x04
_RESET_S = 0.02
_PERIOD_S = 1 / 80
_SILENCE_S = 0.2
_START_UP_S = 0.3
_UT_PER_DIGIT = 0.014  # 0.14 mgauss


@dataclass(frozen=True, slots=True)
class MagneticSample:
    """`field_ut`: microtesla along the robot's axes, x forward, y left, z up."""

    stamp_s: float
    field_ut: tuple[float, float, float]

    @property
    def north_rad(self) -> float:
        """Of a robot that stands level: the direction of magnetic north, from ahead to the left."""
        return math.atan2(self.field_ut[1], self.field_ut[0])


class Magnetometer(Protocol):
    def read(self, timeout_s: float) -> MagneticSample | None: ...
    def close(self) -> None: ...


class Lsm9ds1Magnetometer(PolledChip[MagneticSample]):
    """80 measurements a second; each is freed of what the robot itself adds, as `config` has it."""

    def __init__(self, config: MagnetometerConfig, clock: Clock) -> None:
        device = I2cDevice("magnetometer LSM9DS1", config.bus, config.address)
        super().__init__(device, clock, _PERIOD_S, _SILENCE_S)
        self._axes = axis_map(config.axes)
        self._offset_ut = np.array(config.offset_ut)
        self._matrix = symmetric(config.matrix)
        self._open()

    def _set_up(self) -> None:
        self._check_identity(_WHO_AM_I, _WHO)
        self._device.write(_CTRL_REG2_M, _SOFT_RESET)
        self._pause(_RESET_S)
        self._device.write(_CTRL_REG1_M, _HIGH_PERFORMANCE_80_HZ)
        self._device.write(_CTRL_REG2_M, _GAUSS_4)
        self._device.write(_CTRL_REG4_M, _Z_HIGH_PERFORMANCE)
        self._device.write(_CTRL_REG5_M, _BLOCK_UPDATE)
        self._device.write(_CTRL_REG3_M, _CONTINUOUS)
        self._expect_within(_START_UP_S)

    def _poll(self) -> MagneticSample | None:
        (data,) = self._device.read((_STATUS | _COUNT_UP, 7))
        if data == _ONES:
            raise self._ones()
        if not data[0] & _READY:
            return None
        field_ut = mapped(struct.unpack("<3h", data[1:]), self._axes, _UT_PER_DIGIT)
        x, y, z = corrected_ut(np.array([field_ut]), self._offset_ut, self._matrix)[0].tolist()
        return MagneticSample(self._clock.now_s() - _PERIOD_S / 2, (x, y, z))


def symmetric(six: Symmetric) -> NDArray[np.float64]:
    """(3, 3) of xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def corrected_ut(
    field_ut: NDArray[np.float64], offset_ut: NDArray[np.float64], matrix: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N, 3): the offset is the robot's own magnets (hard iron), the matrix its iron (soft iron)."""
    corrected: NDArray[np.float64] = (field_ut - offset_ut) @ matrix.T
    return corrected
