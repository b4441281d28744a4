"""A device at the network: one connection at a time, as Hokuyo's UST scanners have it."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from collections.abc import Callable

_POLL_S = 0.05
_JOIN_TIMEOUT_S = 3.0
_WRITE_TIMEOUT_S = 1.0


class TcpServer:
    """Answers what comes from who is connected with what `answer` makes of it, in its own thread.

    The next who connects is served when the one before has gone. `port` 0: any that is free.
    """

    def __init__(self, answer: Callable[[bytes], bytes], port: int = 0) -> None:
        self._answer = answer
        self._listener = socket.create_server(("127.0.0.1", port))
        self.address = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self.is_silent = False
        self._peer: socket.socket | None = None
        self._stop = threading.Event()
        self._write_lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="tcp server", daemon=True)
        self._thread.start()

    def send(self, data: bytes) -> None:
        """Bytes that the device sends by itself; nobody there, nothing sent."""
        with self._write_lock:
            if self._peer is not None:
                with contextlib.suppress(OSError):
                    self._peer.sendall(data)

    def unplug(self) -> None:
        """The connection ends and nobody listens any more."""
        self._stop.set()
        self._thread.join(_JOIN_TIMEOUT_S)
        self._listener.close()
        self._hang_up()

    def close(self) -> None:
        if not self._stop.is_set():
            self.unplug()

    def _run(self) -> None:
        while not self._stop.is_set():
            self._serve(_POLL_S)
        self._serve(0.0)  # the last words of a driver that has closed the connection

    def _serve(self, timeout_s: float) -> None:
        wanted = self._listener if self._peer is None else self._peer
        if not select.select([wanted], [], [], timeout_s)[0]:
            return
        if self._peer is None:
            peer, _ = self._listener.accept()
            peer.settimeout(_WRITE_TIMEOUT_S)
            self._peer = peer
            return
        data = b""
        with contextlib.suppress(OSError):
            data = self._peer.recv(4096)
        if not data:
            self._hang_up()
        elif not self.is_silent:
            self.send(self._answer(data))

    def _hang_up(self) -> None:
        with self._write_lock:
            peer, self._peer = self._peer, None
            if peer is not None:
                peer.close()
