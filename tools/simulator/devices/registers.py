"""Models of I2C chips and of the bus they hang on, behind the interface of smbus2."""

from __future__ import annotations

import errno
import struct
from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Protocol


class Chip(Protocol):
    def read(self, register: int, count: int) -> bytes: ...
    def write(self, register: int, values: bytes) -> None: ...


class Message:
    """As `smbus2.i2c_msg`."""

    def __init__(self, address: int, data: bytes, reads: bool) -> None:
        self.address, self.data, self.reads = address, data, reads

    @staticmethod
    def write(address: int, data: Sequence[int]) -> Message:
        return Message(address, bytes(data), reads=False)

    @staticmethod
    def read(address: int, count: int) -> Message:
        return Message(address, bytes(count), reads=True)

    def __iter__(self) -> Iterator[int]:
        return iter(self.data)


class I2cBus:
    """Chips by address; `transfers` counts the system calls."""

    def __init__(self, chips: dict[int, Chip]) -> None:
        self.chips = chips
        self.transfers = 0
        self.open_handles = 0

    def library(self, number: int = 1) -> SimpleNamespace:
        """A stand-in for the module smbus2."""

        def open_bus(bus: int) -> _Handle:
            if bus != number:
                raise FileNotFoundError(errno.ENOENT, "No such file or directory", f"/dev/i2c-{bus}")
            return _Handle(self)

        return SimpleNamespace(SMBus=open_bus, i2c_msg=Message)


class _Handle:
    def __init__(self, bus: I2cBus) -> None:
        self._bus: I2cBus | None = bus
        bus.open_handles += 1

    def i2c_rdwr(self, *messages: Message) -> None:
        if self._bus is None:
            raise TypeError("argument must be an int, or have a fileno() method")
        self._bus.transfers += 1
        register = 0
        for message in messages:
            chip = self._bus.chips.get(message.address)
            if chip is None:
                raise OSError(errno.EREMOTEIO, "Remote I/O error")
            if message.reads:
                message.data = chip.read(register, len(message.data))
            else:
                register = message.data[0]
                if len(message.data) > 1:
                    chip.write(register, message.data[1:])

    def close(self) -> None:
        if self._bus is not None:
            self._bus.open_handles -= 1
            self._bus = None


class Lsm9ds1Chip:
    """Powers up with its outputs off, measures once by itself when set up, and then whenever `sample` is called."""

    def __init__(self) -> None:
        self.registers = bytearray(128)
        self.is_stuck = False  # answers, and measures nothing
        self.power_up()

    def power_up(self) -> None:
        self.registers[:] = bytes(128)
        self.registers[0x0F], self.registers[0x1E], self.registers[0x1F], self.registers[0x22] = 0x68, 0x38, 0x38, 0x04

    def sample(self, gyro: tuple[int, int, int], acceleration: tuple[int, int, int]) -> None:
        """Digits; nothing happens while the output data rate is 0."""
        if self.registers[0x10] >> 5 and not self.is_stuck:
            self.registers[0x18:0x1E] = struct.pack("<3h", *gyro)
            self.registers[0x28:0x2E] = struct.pack("<3h", *acceleration)
            self.registers[0x17] |= 0b11

    def read(self, register: int, count: int) -> bytes:
        increments = self.registers[0x22] & 0x04
        data = bytes(self.registers[register + (i if increments else 0)] for i in range(count))
        if register <= 0x18 < register + count:
            self.registers[0x17] &= 0xFD
        return data

    def write(self, register: int, values: bytes) -> None:
        if register == 0x22 and values[0] & 0x01:
            self.power_up()
        else:
            self.registers[register : register + len(values)] = values
            if register == 0x10:
                self.sample((0, 0, 0), (0, 0, 0))


class MagnetometerChip:
    """That of the LSM9DS1: idle after power-up, and counts up through its registers only when their number says so."""

    def __init__(self) -> None:
        self.registers = bytearray(128)
        self.power_up()

    def power_up(self) -> None:
        self.registers[:] = bytes(128)
        self.registers[0x0F], self.registers[0x20], self.registers[0x22] = 0x3D, 0x10, 0x03

    def sample(self, field: tuple[int, int, int]) -> None:
        """Digits; nothing happens unless it measures all the time."""
        if self.registers[0x22] & 0b11 == 0:
            self.registers[0x28:0x2E] = struct.pack("<3h", *field)
            self.registers[0x27] |= 0x08

    def read(self, register: int, count: int) -> bytes:
        first, step = register & 0x7F, register >> 7
        data = bytes(self.registers[first + step * i] for i in range(count))
        if step and first <= 0x28 < first + count:
            self.registers[0x27] &= 0xF7
        return data

    def write(self, register: int, values: bytes) -> None:
        if register == 0x21 and values[0] & 0x04:
            self.power_up()
        else:
            self.registers[register & 0x7F] = values[0]


class Ads1115Chip:
    """`pins_v`: the voltages at the four inputs. A conversion ends after `polls` looks at the config register."""

    _FULL_SCALE_V = (6.144, 4.096, 2.048, 1.024, 0.512, 0.256, 0.256, 0.256)

    def __init__(self, pins_v: list[float], polls: int = 1) -> None:
        self.pins_v = pins_v
        self.polls = polls
        self.configurations: list[int] = []
        self._left = 0
        self._conversion = 0

    def read(self, register: int, count: int) -> bytes:
        if register == 0:
            return self._conversion.to_bytes(2, "big", signed=True)[:count]
        ready = self._left == 0
        self._left = max(0, self._left - 1)
        return ((self.configurations[-1] & 0x7FFF) | (0x8000 if ready else 0)).to_bytes(2, "big")[:count]

    def write(self, register: int, values: bytes) -> None:
        if register != 1:
            return
        setting = int.from_bytes(values, "big")
        self.configurations.append(setting)
        full_scale_v = self._FULL_SCALE_V[setting >> 9 & 0b111]
        if setting & 0x8000 and setting >> 14 & 1:
            digits = round(self.pins_v[setting >> 12 & 0b11] / full_scale_v * 32_768)
            self._conversion = max(-32_768, min(32_767, digits))
            self._left = self.polls
