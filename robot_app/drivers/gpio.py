"""Output lines of a GPIO chip of the kernel."""

from __future__ import annotations

import errno
import threading
from typing import Any

from robot_app.drivers.base import DeviceBusyError, DeviceError
from robot_app.drivers.library import load_library

_LOCK_TIMEOUT_S = 0.05


def load_gpiod(device: str) -> Any:
    """gpiod with its `line` module; version 1, which Debian 12 packages, is another interface."""
    gpiod = load_library("gpiod", device)
    if not hasattr(gpiod, "request_lines"):
        raise DeviceError(f"{device}: this gpiod is the old version 1; run: pip install '.[robot]'")
    load_library("gpiod.line", device)
    return gpiod


def advice(error: Exception) -> str:
    """Why lines cannot be had, and what to do."""
    number = error.errno if isinstance(error, OSError) else None
    if number == errno.EBUSY:
        return "another program uses them; is it the robot's service? sudo systemctl stop robot-app"
    if number == errno.EACCES:
        return "no permission; run: sudo usermod -aG gpio $USER, and log in again"
    if number == errno.ENOENT:
        return "there is no such chip; look with: ls /dev/gpiochip*"
    return f"cannot be used: {error}"


class GpioOutputs:
    """A few lines, low at first. Two threads may set them: gpiod has one buffer for both, hence the lock."""

    def __init__(self, name: str, chip: str, lines: tuple[int, ...]) -> None:
        self._name = f"{name} at {chip}, lines {', '.join(map(str, lines))}"
        self._lines = lines
        gpiod = load_gpiod(name)
        self._lock = threading.Lock()
        self._value = gpiod.line.Value
        low = gpiod.LineSettings(direction=gpiod.line.Direction.OUTPUT, output_value=self._value.INACTIVE)
        try:
            self._request: Any = gpiod.request_lines(chip, consumer=f"robot-app {name}", config={lines: low})
        except (OSError, ValueError) as error:
            is_busy = isinstance(error, OSError) and error.errno == errno.EBUSY
            kind = DeviceBusyError if is_busy else DeviceError
            raise kind(f"{self._name}: {advice(error)}") from error

    @property
    def file_descriptor(self) -> int:
        """Whoever has it can set the lines."""
        return int(self._request.fd)

    def set(self, *high: bool) -> None:
        request = self._request
        if request is None:
            raise DeviceError(f"{self._name}: is closed")
        value = self._value
        levels = {n: value.ACTIVE if is_high else value.INACTIVE for n, is_high in zip(self._lines, high, strict=True)}
        if not self._lock.acquire(timeout=_LOCK_TIMEOUT_S):
            raise DeviceError(f"{self._name}: another thread does not finish setting them")
        try:
            request.set_values(levels)
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self._name}: cannot be set: {error}") from error
        finally:
            self._lock.release()

    def close(self) -> None:
        request, self._request = self._request, None
        if request is not None:
            request.release()
