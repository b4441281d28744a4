"""Wi-Fi that goes away: passes the bytes of TCP connections on, and while it is cut nothing, as a network does."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
from dataclasses import dataclass

import numpy as np

from shared.link.base import LinkError
from shared.runtime.clock import MonotonicClock

_BYTES = 16_384
_BACKLOG_BYTES = 65_536  # of one direction; then its sender waits
_TICK_S = 0.01
_CONNECT_S = 2.0
_JOIN_S = 2.0


@dataclass(frozen=True, slots=True)
class RelayTimes:
    """Uniformly drawn, s: how long the network is there, and away."""

    there_s: tuple[float, float] = (8.0, 20.0)
    away_s: tuple[float, float] = (2.0, 6.0)


class Relay:
    """Listens at an address and passes on to another, in a thread of its own."""

    def __init__(
        self, listen: tuple[str, int], to: tuple[str, int], rng: np.random.Generator, times: RelayTimes | None = None
    ) -> None:
        self._to = to
        self._rng = rng
        self._times = times or RelayTimes()
        self._clock = MonotonicClock()
        self._is_whole = True
        self._switch_s = self._clock.now_s() + float(rng.uniform(*self._times.there_s))
        try:
            self._listener = socket.create_server(listen)
        except (OSError, OverflowError) as error:
            raise LinkError(f"cannot listen on {listen[0]}:{listen[1]}: {error}") from error
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._other: dict[socket.socket, socket.socket] = {}
        self._waiting: dict[socket.socket, bytearray] = {}  # to be sent to it
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="relay", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join(_JOIN_S)
        for sock in [*self._other, self._listener]:
            sock.close()
        self._selector.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            self._switch()
            if not self._is_whole:
                self._clock.wait(self._stop, self._clock.now_s() + _TICK_S)
                continue
            ready = self._selector.select(_TICK_S)
            for key, _ in ready if self._is_whole else ():  # it may have been cut meanwhile
                sock = key.fileobj
                if sock is self._listener:
                    self._accept()
                elif isinstance(sock, socket.socket) and sock in self._other:
                    self._take(sock)
            for sock in list(self._waiting):
                self._pass_on(sock)

    def _switch(self) -> None:
        now_s = self._clock.now_s()
        if now_s >= self._switch_s:
            self._is_whole = not self._is_whole
            span_s = self._times.there_s if self._is_whole else self._times.away_s
            self._switch_s = now_s + float(self._rng.uniform(*span_s))

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            newcomer, _ = self._listener.accept()
            try:
                other = socket.create_connection(self._to, _CONNECT_S)
            except OSError:
                newcomer.close()
                return
            for sock, peer in ((newcomer, other), (other, newcomer)):
                sock.setblocking(False)
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._other[sock], self._waiting[sock] = peer, bytearray()
                self._selector.register(sock, selectors.EVENT_READ)

    def _take(self, sock: socket.socket) -> None:
        other = self._other[sock]
        if len(self._waiting[other]) >= _BACKLOG_BYTES:
            return
        try:
            data = sock.recv(_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._waiting[other] += data
        else:
            self._part(sock)

    def _pass_on(self, sock: socket.socket) -> None:
        waiting = self._waiting.get(sock)
        try:
            while waiting:
                del waiting[: sock.send(waiting)]
        except BlockingIOError:
            pass
        except OSError:
            self._part(sock)

    def _part(self, sock: socket.socket) -> None:
        for end in (sock, self._other[sock]):
            self._selector.unregister(end)
            del self._other[end], self._waiting[end]
            end.close()
