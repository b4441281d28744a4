"""Registers of devices on an I2C bus of the kernel."""

from __future__ import annotations

import errno
from typing import Any

from robot_app.drivers.base import DeviceError
from robot_app.drivers.library import load_library


class I2cDevice:
    """One address on one bus. A transfer is one system call, so two threads may use two devices of a bus."""

    def __init__(self, name: str, bus: int, address: int) -> None:
        self._name = f"{name} at I2C bus {bus}, address {address:#04x}"
        self._address = address
        smbus2: Any = load_library("smbus2", name)
        self._message = smbus2.i2c_msg
        try:
            self._bus: Any = smbus2.SMBus(bus)
        except FileNotFoundError as error:
            raise DeviceError(f"{self._name}: the bus is off; put dtparam=i2c_arm=on into config.txt") from error
        except PermissionError as error:
            raise DeviceError(f"{self._name}: no permission; run: sudo usermod -aG i2c $USER") from error
        except OSError as error:
            raise DeviceError(f"{self._name}: the bus cannot be opened: {error}") from error

    @property
    def name(self) -> str:
        return self._name

    def read(self, *blocks: tuple[int, int]) -> list[bytes]:
        """The bytes of each `(register, count)`, all in one transfer."""
        messages = []
        for register, count in blocks:
            messages.append(self._message.write(self._address, [register]))
            messages.append(self._message.read(self._address, count))
        self._transfer(messages)
        return [bytes(list(message)) for message in messages[1::2]]

    def write(self, register: int, *values: int) -> None:
        self._transfer([self._message.write(self._address, [register, *values])])

    def close(self) -> None:
        self._bus.close()

    def _transfer(self, messages: list[Any]) -> None:
        try:
            self._bus.i2c_rdwr(*messages)
        except (OSError, TypeError) as error:  # smbus2 has no file any more once it is closed
            raise DeviceError(f"{self._name}: {_advice(error)}") from error


def _advice(error: Exception) -> str:
    number = error.errno if isinstance(error, OSError) else None
    if number in {errno.EREMOTEIO, errno.ENXIO}:
        return "does not answer; check its wires and supply, and look with: i2cdetect -y 1"
    if number == errno.ETIMEDOUT:
        return "the bus hangs; is SDA or SCL shorted?"
    return f"transfer failed: {error}"
