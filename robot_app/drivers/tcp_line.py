"""A TCP connection to a device, with the manners of `SerialLine`."""

from __future__ import annotations

import select
import socket

from robot_app.drivers.base import DeviceError

_READ_BYTES = 16_384
_WRITE_TIMEOUT_S = 1.0


class TcpLine:
    """`address`: host and port, as in 192.168.0.10:10940."""

    def __init__(self, device: str, address: str, timeout_s: float) -> None:
        self._name = f"{device} at {address}"
        host, _, port = address.rpartition(":")
        try:
            self._socket = socket.create_connection((host, int(port)), timeout_s)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError as error:
            raise DeviceError(f"{self._name}: {_advice(error)}") from error
        self._socket.settimeout(_WRITE_TIMEOUT_S)

    @property
    def name(self) -> str:
        return self._name

    def set_baud_rate(self, _baud_rate: int) -> None:
        """A connection has none."""

    def write(self, data: bytes) -> None:
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise DeviceError(f"{self._name}: lost while writing: {error}; is its cable in?") from error

    def read(self, timeout_s: float) -> bytes:
        """What came in, as soon as there is something; empty when nothing came in time."""
        try:
            if not select.select([self._socket], [], [], max(0.0, timeout_s))[0]:
                return b""
            data = self._socket.recv(_READ_BYTES)
        except (OSError, ValueError) as error:  # the last one: closed meanwhile
            raise DeviceError(f"{self._name}: lost while reading: {error}; is its cable in?") from error
        if not data:
            raise DeviceError(f"{self._name}: closed the connection; does it have power, does another program use it?")
        return data

    def close(self) -> None:
        self._socket.close()


def _advice(error: OSError) -> str:
    if isinstance(error, TimeoutError):
        return "does not answer; is it on, is its cable in, is this computer in its network?"
    if isinstance(error, ConnectionRefusedError):
        return "refuses the connection; is that its port? Hokuyo's scanners have 10940"
    return f"cannot be reached: {error}; is that its address?"
