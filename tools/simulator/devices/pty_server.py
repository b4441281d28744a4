"""A serial device on a pseudo-terminal."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import termios
import threading
import tty
from collections.abc import Callable

_POLL_S = 0.05
_JOIN_TIMEOUT_S = 3.0
_SPEEDS = {getattr(termios, f"B{rate}"): rate for rate in (19_200, 38_400, 57_600, 115_200, 230_400, 500_000)}


class PtyServer:
    """Answers what is written to `port` with what `answer` makes of it, in its own thread.

    `baud_rate`, where given, tells the device's own rate: at another one it hears and says only garbage.
    """

    def __init__(self, answer: Callable[[bytes], bytes], baud_rate: Callable[[], int] | None = None) -> None:
        self._answer = answer
        self._baud_rate = baud_rate
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self.is_silent = False
        self._stop = threading.Event()
        self._write_lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="pty server", daemon=True)
        self._thread.start()

    def send(self, data: bytes) -> None:
        """Bytes that the device sends by itself; what does not fit into the line's buffer waits for a reader."""
        with self._write_lock:
            while data and not self._stop.is_set():
                if select.select([], [self._master], [], _POLL_S)[1]:
                    data = data[os.write(self._master, data[:1024]) :]

    def unplug(self) -> None:
        """The port vanishes while it may be open."""
        self._stop.set()
        self._thread.join(_JOIN_TIMEOUT_S)
        for fd in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(fd)

    def close(self) -> None:
        if not self._stop.is_set():
            self.unplug()

    def _run(self) -> None:
        while not self._stop.is_set():
            self._serve(_POLL_S)
        self._serve(0.0)  # the last words of a driver that has closed the port

    def _serve(self, timeout_s: float) -> None:
        if not select.select([self._master], [], [], timeout_s)[0]:
            return
        data = os.read(self._master, 4096)
        if self.is_silent:
            return
        understood = self._rates_agree()  # before the answer, which may change the device's rate
        answer = self._answer(data if understood else _garbled(data))
        self.send(answer if understood else _garbled(answer))

    def _rates_agree(self) -> bool:
        if self._baud_rate is None:
            return True
        return _SPEEDS.get(termios.tcgetattr(self._slave)[4]) == self._baud_rate()


def _garbled(data: bytes) -> bytes:
    return bytes(255 - byte for byte in data)
