"""A serial port, USB or RS-232, whose waits end and whose errors name it."""

from __future__ import annotations

import select
import termios
from typing import TYPE_CHECKING

from robot_app.drivers.base import DeviceError
from robot_app.drivers.library import load_library

if TYPE_CHECKING:
    from serial import Serial

_READ_BYTES = 16_384
_WRITE_TIMEOUT_S = 1.0


class SerialLine:
    """8N1 without flow control; no other program may open the port meanwhile."""

    def __init__(self, device: str, port: str, baud_rate: int) -> None:
        self._name = f"{device} at {port}"
        serial = load_library("serial", device)
        try:
            self._port: Serial = serial.Serial(
                port, baud_rate, timeout=0, write_timeout=_WRITE_TIMEOUT_S, exclusive=True
            )
        except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
            raise DeviceError(f"{self._name}: {_advice(error)}") from error

    @property
    def name(self) -> str:
        return self._name

    def set_baud_rate(self, baud_rate: int) -> None:
        try:
            self._port.baudrate = baud_rate
        except (OSError, ValueError, termios.error) as error:
            raise DeviceError(f"{self._name}: cannot be set to {baud_rate} baud: {error}") from error

    def write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except (OSError, termios.error) as error:
            raise DeviceError(f"{self._name}: lost while writing: {error}; is it plugged in?") from error

    def read(self, timeout_s: float) -> bytes:
        """What came in, as soon as there is something; empty when nothing came in time."""
        try:
            if not select.select([self._port.fileno()], [], [], max(0.0, timeout_s))[0]:
                return b""
            return bytes(self._port.read(_READ_BYTES))
        except (OSError, TypeError, ValueError, termios.error) as error:  # the last two: closed meanwhile
            raise DeviceError(f"{self._name}: lost while reading: {error}; is it plugged in?") from error

    def close(self) -> None:
        self._port.close()


def _advice(error: Exception) -> str:
    text = str(error)
    if "No such file" in text:
        return "there is no such port; is it plugged in? Look with: ls /dev/serial/by-id"
    if "Permission denied" in text:
        return "no permission; run: sudo usermod -aG dialout $USER, and log in again"
    if "lock" in text or "busy" in text.lower():
        return "another program uses it; look with: fuser -v on the port"
    return f"cannot be opened: {text}"
