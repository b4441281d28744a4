"""Datagrams over TCP: the robot listens, the station connects."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from collections import deque

from shared.link.base import LinkError, LinkStatistics
from shared.protocol.frame import FrameParser, pack
from shared.runtime.clock import Clock

_BACKLOG_BYTES = 16_384  # what may wait for a slow network: on one that stalls old data is worth nothing
_SEND_BUFFER_BYTES = 32_768  # the kernel's own share of that; it would take megabytes
_READ_BYTES = 4_096  # parsing more at a time would hold up the other tasks
_SILENT_PEER_S = 1.5  # after this a newcomer takes the place of a peer that says nothing


class _Peer:
    """One connected socket: frames in, frames out, nothing blocks. `send` and `receive` may be on two threads."""

    def __init__(self, sock: socket.socket, name: str, statistics: LinkStatistics) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        self.sock = sock
        self.name = name
        self._statistics = statistics
        self._parser = FrameParser()
        self._arrived: deque[bytes] = deque()
        self._out = bytearray()
        self._out_lock = threading.Lock()

    def send(self, datagram: bytes) -> bool:
        frame = pack(datagram)
        with self._out_lock:
            self._flush()
            if self._out and len(self._out) + len(frame) > _BACKLOG_BYTES:
                return False
            self._out += frame
            self._flush()
        self._statistics.sent_datagrams += 1
        self._statistics.sent_bytes += len(frame)
        return True

    def flush(self) -> None:
        with self._out_lock:
            self._flush()

    def _flush(self) -> None:
        try:
            while self._out:
                del self._out[: self.sock.send(self._out)]
        except BlockingIOError:
            pass
        except OSError as error:
            raise LinkError(f"{self.name}: connection lost: {error.strerror or error}") from error

    @property
    def has_output(self) -> bool:
        return bool(self._out)

    def pop(self) -> bytes | None:
        return self._arrived.popleft() if self._arrived else None

    def read(self) -> None:
        """Take some of what the socket has."""
        try:
            data = self.sock.recv(_READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            raise LinkError(f"{self.name}: connection lost: {error.strerror or error}") from error
        if not data:
            raise LinkError(f"{self.name}: the other side closed the connection")
        dropped = self._parser.dropped_bytes
        datagrams = self._parser.feed(data)
        self._arrived.extend(datagrams)
        self._statistics.received_bytes += len(data)
        self._statistics.received_datagrams += len(datagrams)
        self._statistics.dropped_bytes += self._parser.dropped_bytes - dropped

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self.sock.shutdown(socket.SHUT_RDWR)
        self.sock.close()


class TcpClientLink:
    """The station's end. Connects in the constructor or raises `LinkError`."""

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        self._name = f"{host}:{port}"
        self.statistics = LinkStatistics()
        try:
            sock = socket.create_connection((host, port), timeout_s)
        except (OSError, OverflowError) as error:
            raise LinkError(f"cannot connect to {self._name}: {_reason(error)}") from error
        self._peer: _Peer | None = _Peer(sock, self._name, self.statistics)

    @property
    def connected(self) -> bool:
        return self._peer is not None

    def send(self, datagram: bytes) -> bool:
        return self._connected_peer().send(datagram)

    def receive(self, timeout_s: float) -> bytes | None:
        peer = self._connected_peer()
        if (datagram := peer.pop()) is not None:
            return datagram
        _select([peer.sock], [peer.sock] if peer.has_output else [], timeout_s)
        peer.flush()
        peer.read()
        return peer.pop()

    def close(self) -> None:
        peer, self._peer = self._peer, None
        if peer is not None:
            peer.close()

    def _connected_peer(self) -> _Peer:
        peer = self._peer
        if peer is None:
            raise LinkError(f"{self._name}: the link is closed")
        return peer


class TcpServerLink:
    """The robot's end: listens, serves one station at a time and waits for the next when it goes.

    A station that says nothing for 1.5 s gives way to a newcomer; while it talks, a newcomer is turned away.
    """

    def __init__(self, host: str, port: int, clock: Clock, farewell: bytes = b"") -> None:
        """`farewell`: the datagram that a newcomer gets who is turned away."""
        self.statistics = LinkStatistics()
        self._clock = clock
        self._farewell = farewell
        self._peer: _Peer | None = None
        self._heard_s = 0.0
        try:
            self._listener: socket.socket | None = socket.create_server((host, port), backlog=2)
        except (OSError, OverflowError) as error:
            raise LinkError(f"cannot listen on {host}:{port}: {_reason(error)}") from error
        self._listener.setblocking(False)

    @property
    def port(self) -> int:
        """The port it listens on, also where 0 was asked for."""
        if self._listener is None:
            raise LinkError("the link is closed")
        port: int = self._listener.getsockname()[1]
        return port

    @property
    def connected(self) -> bool:
        return self._peer is not None

    def send(self, datagram: bytes) -> bool:
        peer = self._peer
        if peer is None:
            return False
        try:
            return peer.send(datagram)
        except LinkError:
            self._drop(peer)
            return False

    def receive(self, timeout_s: float) -> bytes | None:
        listener, peer = self._listener, self._peer
        if listener is None:
            raise LinkError("the link is closed")
        if peer is not None and (datagram := peer.pop()) is not None:
            return datagram
        reading = [listener] if peer is None else [listener, peer.sock]
        _select(reading, [peer.sock] if peer is not None and peer.has_output else [], timeout_s)
        self._accept(listener)
        return self._read()

    def close(self) -> None:
        listener, self._listener = self._listener, None
        if listener is not None:
            listener.close()
        if self._peer is not None:
            self._drop(self._peer)

    def _accept(self, listener: socket.socket) -> None:
        try:
            sock, address = listener.accept()
        except OSError:  # nobody there, or gone again
            return
        now_s = self._clock.now_s()
        if self._peer is not None:
            if now_s - self._heard_s < _SILENT_PEER_S:
                self._turn_away(sock)
                return
            self._drop(self._peer)
        self._peer = _Peer(sock, f"{address[0]}:{address[1]}", self.statistics)
        self._heard_s = now_s

    def _turn_away(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        with contextlib.suppress(OSError):
            if self._farewell:
                sock.send(pack(self._farewell))
            sock.shutdown(socket.SHUT_WR)
        sock.close()

    def _read(self) -> bytes | None:
        peer = self._peer
        if peer is None:
            return None
        try:
            peer.flush()
            peer.read()
        except LinkError:
            self._drop(peer)
            return None
        datagram = peer.pop()
        if datagram is not None:  # bytes that make no frame are no sign of a station
            self._heard_s = self._clock.now_s()
        return datagram

    def _drop(self, peer: _Peer) -> None:
        if self._peer is peer:
            self._peer = None
        peer.close()


def _select(reading: list[socket.socket], writing: list[socket.socket], timeout_s: float) -> None:
    try:
        select.select(reading, writing, [], timeout_s)
    except (OSError, ValueError) as error:  # closed by another thread meanwhile
        raise LinkError("the link was closed") from error


def _reason(error: Exception) -> str:
    if isinstance(error, ConnectionRefusedError):
        return "connection refused. Is the robot on, and is this the port in its robot.toml?"
    if isinstance(error, TimeoutError):
        return "no answer in time. Is the robot on and in the same network?"
    if isinstance(error, OverflowError):
        return "a port is a number from 0 to 65535"
    return str(getattr(error, "strerror", None) or error)
