"""A hardware PWM channel of the kernel, /sys/class/pwm."""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path

from robot_app.drivers.base import DeviceError
from shared.runtime.clock import Clock

_APPEARS_WITHIN_S = 1.0  # udev gives the new files to the group some time after the export
_POLL_S = 0.02
_FILES = ("period", "duty_cycle", "enable")


class SysfsPwm:
    """Starts enabled with no pulse. Its duty file stays open, so that it can be cut when nothing else works."""

    def __init__(self, name: str, chip: str, channel: int, period_ns: int, clock: Clock) -> None:
        self._name = f"{name} at {chip}, channel {channel}"
        self._chip = Path(chip)
        self._folder = self._chip / f"pwm{channel}"
        self._channel = channel
        self._period_ns = period_ns
        self._duty_fd: int | None = None
        if not self._chip.is_dir():
            raise DeviceError(
                f"{self._name}: there is no such chip; put dtoverlay=pwm-2chan (omni: i2c-pwm-pca9685a) into config.txt"
            )
        try:
            self._export(clock)
            self._set_up()
        except OSError as error:
            self.close()
            raise DeviceError(f"{self._name}: {_advice(error)}") from error

    @property
    def name(self) -> str:
        return self._name

    @property
    def duty_file(self) -> Path:
        return self._folder / "duty_cycle"

    def set_pulse_ns(self, pulse_ns: int) -> None:
        """The time of a period for which the output is high."""
        if self._duty_fd is None:
            raise DeviceError(f"{self._name}: is closed")
        try:
            os.pwrite(self._duty_fd, b"%d\n" % max(0, min(pulse_ns, self._period_ns)), 0)
        except OSError as error:
            raise DeviceError(f"{self._name}: cannot be set: {error}") from error

    def close(self) -> None:
        """No pulse, output off."""
        fd, self._duty_fd = self._duty_fd, None
        if fd is None:
            return
        with contextlib.suppress(OSError):
            os.pwrite(fd, b"0\n", 0)
        with contextlib.suppress(OSError):
            self._write("enable", 0)
        os.close(fd)

    def _export(self, clock: Clock) -> None:
        if not self._folder.is_dir():
            (self._chip / "export").write_text(f"{self._channel}\n", "ascii")
        never, due_s = threading.Event(), clock.now_s() + _APPEARS_WITHIN_S
        while not self._are_writable() and clock.now_s() < due_s:
            clock.wait(never, clock.now_s() + _POLL_S)

    def _are_writable(self) -> bool:
        """All of them: udev gives one after the other to the group."""
        return all(os.access(self._folder / file, os.W_OK) for file in _FILES)

    def _set_up(self) -> None:
        """The kernel refuses a period below the pulse, and a pulse of a channel without a period."""
        self._duty_fd = os.open(self.duty_file, os.O_WRONLY)
        with contextlib.suppress(OSError):  # a new channel has no period yet, and no pulse either
            os.pwrite(self._duty_fd, b"0\n", 0)
        self._write("period", self._period_ns)
        os.pwrite(self._duty_fd, b"0\n", 0)
        self._write("enable", 1)

    def _write(self, file: str, value: int) -> None:
        (self._folder / file).write_text(f"{value}\n", "ascii")


def _advice(error: OSError) -> str:
    if isinstance(error, PermissionError):
        return "no permission; run: sudo usermod -aG gpio $USER, and see that udev gives /sys/class/pwm to that group"
    return f"cannot be set up: {error}"
