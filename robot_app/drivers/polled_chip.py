"""A chip on the I2C bus that measures by itself and is asked whether it has."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from typing import Generic, TypeVar

from robot_app.drivers.base import DeviceError
from robot_app.drivers.i2c import I2cDevice
from robot_app.drivers.lost import Reopening
from shared.runtime.clock import Clock

_REOPEN_EVERY_S = 0.5

T = TypeVar("T")


class PolledChip(ABC, Generic[T]):
    """A class made of it ends its constructor with `_open`.

    `silence_s`: without a measurement for so long it is lost, as after a dip of its supply that took its settings.
    """

    def __init__(self, device: I2cDevice, clock: Clock, period_s: float, silence_s: float) -> None:
        self._device = device
        self._clock = clock
        self._poll_s = period_s / 4
        self._silence_s = silence_s
        self._reopening = Reopening(clock, _REOPEN_EVERY_S)
        self._never = threading.Event()
        self._ready_by_s = 0.0
        self._closed = False

    def read(self, timeout_s: float) -> T | None:
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

    @abstractmethod
    def _set_up(self) -> None:
        """Bring the chip from any state to measuring; ends with `_expect_within`."""

    @abstractmethod
    def _poll(self) -> T | None:
        """A new measurement, if there is one."""

    def _open(self) -> None:
        try:
            self._set_up()
        except DeviceError:
            self._device.close()
            raise

    def _check_identity(self, register: int, expected: int) -> None:
        ((who,),) = self._device.read((register, 1))
        if who != expected:
            raise DeviceError(f"{self._device.name}: says {who:#04x} instead of {expected:#04x}; is it an LSM9DS1?")

    def _expect_within(self, seconds: float) -> None:
        self._ready_by_s = self._clock.now_s() + seconds

    def _wait_for_sample(self, timeout_s: float) -> T | None:
        due_s = self._clock.now_s() + timeout_s
        while True:
            sample = self._poll()
            now_s = self._clock.now_s()
            if sample is not None:
                self._ready_by_s = now_s + self._silence_s
                return sample
            if now_s > self._ready_by_s:
                raise DeviceError(f"{self._device.name}: measures nothing; did its supply fail?")
            if now_s >= due_s:
                return None
            self._pause(min(due_s - now_s, self._poll_s))

    def _pause(self, seconds: float) -> None:
        self._clock.wait(self._never, self._clock.now_s() + seconds)

    def _ones(self) -> DeviceError:
        return DeviceError(f"{self._device.name}: reads as nothing but ones; is a wire loose?")
