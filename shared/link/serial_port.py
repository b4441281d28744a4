"""A serial port of the operating system."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import select
import termios
from dataclasses import dataclass

import serial
from serial.tools import list_ports

from shared.link.base import LinkError
from shared.link.byte_port import PortStatistics

_READ_BYTES = 4_096
_WRITE_TIMEOUT_S = 1.0  # 64 bytes at 9600 baud take 67 ms; a port that takes longer than this hangs
_DRAIN_POLL_S = 0.01
_ADAPTER_BYTES = 64  # that an adapter may hold when the system has none left
_STUCK = "takes no bytes. Is the adapter stuck? Unplug it and plug it in again"


@dataclass(frozen=True, slots=True)
class PortInfo:
    path: str
    description: str
    serial_number: str


def list_serial_ports() -> list[PortInfo]:
    """The ports of this computer at which something is plugged in."""
    found = (
        PortInfo(p.device, p.description if p.description != "n/a" else "", p.serial_number or "")
        for p in list_ports.comports()
    )
    return sorted((p for p in found if p.description or p.serial_number), key=lambda p: p.path)


class SerialPort:
    """8 data bits, no parity, one stop bit, no flow control; nobody else may open it meanwhile."""

    def __init__(self, name: str, baud_rate: int) -> None:
        self.name = name
        self.statistics = PortStatistics()
        try:
            self._serial: serial.Serial | None = serial.Serial(
                name, baud_rate, timeout=0, write_timeout=_WRITE_TIMEOUT_S, exclusive=True
            )
        except (OSError, ValueError) as error:
            raise LinkError(f"{name}: {_reason(error)}") from error
        # Adapters keep bytes back for up to 16 ms otherwise; ports without the setting answer with any of these.
        with contextlib.suppress(OSError, ValueError, AttributeError, NotImplementedError, termios.error):
            self._serial.set_low_latency_mode(True)

    def write(self, data: bytes) -> None:
        port = self._open_port()
        try:
            port.write(data)
        except serial.SerialTimeoutException as error:
            raise LinkError(f"{self.name}: {_STUCK}") from error
        except (OSError, TypeError) as error:  # TypeError: closed by another thread meanwhile
            raise self._lost(error) from error
        self.statistics.written_bytes += len(data)

    def read(self, timeout_s: float) -> bytes:
        port = self._open_port()
        try:
            if not select.select([port], [], [], max(0.0, timeout_s))[0]:
                return b""
            data = os.read(port.fileno(), _READ_BYTES)
        except BlockingIOError:
            return b""
        except (OSError, TypeError, ValueError) as error:
            raise self._lost(error) from error
        if not data:  # a port that is gone is always ready and has nothing
            raise self._lost(None)
        self.statistics.read_bytes += len(data)
        return data

    def set_baud_rate(self, baud_rate: int) -> bool:
        port = self._open_port()
        try:
            if not _drained(port):
                raise LinkError(f"{self.name}: {_STUCK}")
            port.baudrate = baud_rate
        except (OSError, ValueError, TypeError, termios.error) as error:  # the last is no OSError
            raise self._lost(error) from error
        return True

    def close(self) -> None:
        port, self._serial = self._serial, None
        if port is not None:
            with contextlib.suppress(OSError, termios.error):
                port.close()

    def _open_port(self) -> serial.Serial:
        if self._serial is None:
            raise LinkError(f"{self.name}: the port is closed")
        return self._serial

    def _lost(self, error: Exception | None) -> LinkError:
        if self._serial is None:
            return LinkError(f"{self.name}: the port was closed")
        reason = "the port is gone" if error is None else str(getattr(error, "strerror", None) or error.args[-1])
        return LinkError(f"{self.name}: lost: {reason}. Is the cable still plugged in?")


def _drained(port: serial.Serial) -> bool:
    """Wait until what was written has gone out; `flush` would wait for ever for an adapter that is stuck."""
    for _ in range(math.ceil(_WRITE_TIMEOUT_S / _DRAIN_POLL_S)):
        if port.out_waiting == 0:
            select.select([], [], [], 10.0 * _ADAPTER_BYTES / port.baudrate)
            return True
        select.select([], [], [], _DRAIN_POLL_S)
    return False


def _reason(error: Exception) -> str:
    text, number = str(error), getattr(error, "errno", None)
    if number == errno.ENOENT:
        return "there is no such port. `radio-config list` shows those there are"
    if number == errno.EACCES:
        return "not allowed. Add yourself to the group that owns it (usually `sudo usermod -a -G dialout $USER`)"
    if number in {errno.EBUSY, errno.EAGAIN} or "exclusively lock" in text:
        return "in use by another program"
    return f"cannot be opened: {getattr(error, 'strerror', None) or text}"
