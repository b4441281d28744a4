"""What systemd wants to hear from a unit of Type=notify: ready, alive, stopping."""

from __future__ import annotations

import logging
import socket

_log = logging.getLogger(__name__)
_TIMEOUT_S = 0.1


class ServiceManager:
    """`address` is NOTIFY_SOCKET; without one nothing is said. Never raises: the robot runs without systemd too."""

    def __init__(self, address: str | None) -> None:
        # An abstract address is written with '@' and meant with a zero byte.
        self._address = "\0" + address[1:] if address and address.startswith("@") else address
        self._has_failed = False

    def ready(self) -> None:
        self._say("READY=1")

    def alive(self) -> None:
        self._say("WATCHDOG=1")

    def stopping(self) -> None:
        self._say("STOPPING=1")

    def _say(self, text: str) -> None:
        if not self._address:
            return
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
                sock.settimeout(_TIMEOUT_S)
                sock.sendto(text.encode("ascii"), self._address)
        except OSError as error:
            if not self._has_failed:
                _log.warning("systemd does not listen: %s", error)
            self._has_failed = True
