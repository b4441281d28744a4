"""Datagrams over TCP: the robot listens, the station connects."""

from __future__ import annotations

import contextlib
import errno
import logging
import select
import socket
import threading
from collections import deque

from shared.link.base import ForRadio, Lane, LinkError, LinkHealth, LinkPath, LinkStatistics, PathChanged
from shared.link.pairing import Pairing, PairingError
from shared.link.tls import TlsStream
from shared.protocol.frame import FrameParser, pack
from shared.runtime.clock import Clock

_log = logging.getLogger(__name__)
_BACKLOG_BYTES = 16_384  # what may wait for a slow network: on one that stalls old data is worth nothing
_SEND_BUFFER_BYTES = 32_768  # the kernel's own share of that; it would take megabytes
_READ_BYTES = 4_096  # parsing more at a time would hold up the other tasks
_KNOCKING_S = 2.0  # for a secure connection to be agreed on
_MOST_KNOCKING = 4
_HANDSHAKE_STEPS = 20
_PEEKS = 20
_SILENT_PEER_S = 1.5  # after this a newcomer takes the place of a peer that says nothing


class _Peer:
    """One connected socket: frames in, frames out, nothing blocks. `send` and `receive` may be on two threads."""

    def __init__(
        self, sock: socket.socket, name: str, statistics: LinkStatistics, tls: TlsStream | None = None
    ) -> None:
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
        self._has_heard = False
        self._tls = tls
        if tls is not None:
            self._say_tls(tls)

    @property
    def is_ready(self) -> bool:
        """It has shown who it is, where that is asked for."""
        return self._tls is None or self._tls.ready

    def send(self, datagram: bytes) -> bool:
        frame = pack(datagram)
        with self._out_lock:
            self._flush()
            if not self.is_ready or (self._out and len(self._out) + len(frame) > _BACKLOG_BYTES):
                return False
            if self._tls is not None:
                self._tls.encrypt(frame)
                frame = self._tls.take_output()
            self._out += frame
            self._flush()
        self._statistics.sent_datagrams += 1
        self._statistics.sent_bytes += len(frame)
        return True

    def _say_tls(self, tls: TlsStream) -> None:
        """What belongs to the secure connection itself."""
        said = tls.take_output()
        self._out += said
        self._statistics.sent_bytes += len(said)

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

    @property
    def has_room(self) -> bool:
        return self.is_ready and not self._out

    @property
    def first(self) -> bytes | None:
        return self._arrived[0] if self._arrived else None

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
            raise self._closed()
        self._has_heard = True
        self._statistics.received_bytes += len(data)
        if self._tls is not None:
            with self._out_lock:
                data = self._tls.feed(data)
                self._say_tls(self._tls)
                self._flush()
        dropped = self._parser.dropped_bytes
        datagrams = self._parser.feed(data)
        self._arrived.extend(datagrams)
        self._statistics.received_datagrams += len(datagrams)
        self._statistics.dropped_bytes += self._parser.dropped_bytes - dropped

    def _closed(self) -> LinkError:
        if self._has_heard or self._tls is not None:
            return LinkError(f"{self.name}: the other side closed the connection")
        return PairingError(
            f"{self.name}: the other side closed the connection without a word. Pairing: has it a pairing file, and "
            "here none is named?"
        )

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self.sock.shutdown(socket.SHUT_RDWR)
        self.sock.close()


class _TcpEnd:
    """What both ends have in common. There is one lane: TCP keeps everything in its order."""

    path = LinkPath.WIFI
    mends_itself = False

    def __init__(self, is_secret: bool) -> None:
        self.statistics = LinkStatistics()
        self.events: deque[PathChanged] = deque(maxlen=1)  # there are none
        self.resets = 0
        self._is_secret = is_secret
        self._peer: _Peer | None = None

    @property
    def connected(self) -> bool:
        return self._peer is not None

    @property
    def has_room(self) -> bool:
        peer = self._peer
        return peer is not None and peer.has_room

    @property
    def health(self) -> LinkHealth:
        return LinkHealth(wifi=self.connected, is_secret=self._is_secret)


class TcpClientLink(_TcpEnd):
    """The station's end. Connects in the constructor or raises `LinkError`."""

    def __init__(self, host: str, port: int, timeout_s: float, pairing: Pairing | None = None) -> None:
        """`pairing`: speak in secret, with nobody who has another file."""
        super().__init__(is_secret=pairing is not None)
        self._name = f"{host}:{port}"
        context = None if pairing is None else pairing.tls_context(False)
        try:
            sock = socket.create_connection((host, port), timeout_s)
        except (OSError, OverflowError) as error:
            raise LinkError(f"cannot connect to {self._name}: {_reason(error)}") from error
        tls = None if context is None else TlsStream(context, False, self._name)
        self._peer = peer = _Peer(sock, self._name, self.statistics, tls)
        try:
            self._shake_hands(peer, timeout_s)
        except LinkError:
            self.close()
            raise

    def _shake_hands(self, peer: _Peer, timeout_s: float) -> None:
        for _ in range(_HANDSHAKE_STEPS):
            if peer.is_ready:
                return
            peer.flush()
            _select([peer.sock], [peer.sock] if peer.has_output else [], timeout_s / _HANDSHAKE_STEPS)
            peer.read()
        raise LinkError(f"{self._name}: pairing: no secure connection in time. Does the robot use a pairing file?")

    def peek(self, timeout_s: float) -> bytes | None:
        """The next datagram, which `receive` gives again; None when none came in time."""
        peer = self._connected_peer()
        for _ in range(_PEEKS):
            if (first := peer.first) is not None:
                return first
            _select([peer.sock], [], timeout_s / _PEEKS)
            peer.read()
        return peer.first

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        del lane, slot, for_radio
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


class TcpServerLink(_TcpEnd):
    """The robot's end: listens, serves one station at a time and waits for the next when it goes.

    A station that says nothing for 1.5 s gives way to a newcomer; while it talks, a newcomer is turned away.
    """

    def __init__(
        self, host: str, port: int, clock: Clock, farewell: bytes = b"", pairing: Pairing | None = None
    ) -> None:
        """`farewell`: the datagram that a newcomer gets who is turned away. `pairing`: nobody else comes in at all."""
        super().__init__(is_secret=pairing is not None)
        self._tls_context = None if pairing is None else pairing.tls_context(True)
        self._knocking: list[tuple[float, _Peer]] = []  # since when
        self._clock = clock
        self._farewell = farewell
        self._heard_s = 0.0
        self._told_host = ""  # was turned away last
        try:
            self._listener: socket.socket | None = socket.create_server((host, port), backlog=2)
        except (OSError, OverflowError) as error:
            raise LinkError(f"cannot listen on {host}:{port}: {_listening_reason(error)}") from error
        self._listener.setblocking(False)

    @property
    def port(self) -> int:
        """The port it listens on, also where 0 was asked for."""
        if self._listener is None:
            raise LinkError("the link is closed")
        port: int = self._listener.getsockname()[1]
        return port

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        del lane, slot, for_radio
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
        reading = [listener, *(p.sock for p in self._peers(peer))]
        _select(reading, [p.sock for p in self._peers(peer) if p.has_output], timeout_s)
        self._accept(listener)
        self._serve_knocking()
        return self._read()

    def drop_peer(self) -> None:
        """Let the station go: it is not heard any more, and comes again."""
        if self._peer is not None:
            self._drop(self._peer)

    def _peers(self, peer: _Peer | None) -> list[_Peer]:
        return [p for _, p in self._knocking] + ([peer] if peer is not None else [])

    def close(self) -> None:
        listener, self._listener = self._listener, None
        if listener is not None:
            listener.close()
        for _, knocking in self._knocking:
            knocking.close()
        self._knocking.clear()
        self.drop_peer()

    def _accept(self, listener: socket.socket) -> None:
        try:
            sock, address = listener.accept()
        except OSError:  # nobody there, or gone again
            return
        name = f"{address[0]}:{address[1]}"
        if self._tls_context is None:
            self._welcome(_Peer(sock, name, self.statistics))
        elif len(self._knocking) < _MOST_KNOCKING:
            tls = TlsStream(self._tls_context, True, name)
            self._knocking.append((self._clock.now_s(), _Peer(sock, name, self.statistics, tls)))
        else:
            sock.close()

    def _serve_knocking(self) -> None:
        """Those who have shown who they are come in; who takes too long, or is a stranger, does not."""
        still: list[tuple[float, _Peer]] = []
        for since_s, peer in self._knocking:
            try:
                peer.flush()
                peer.read()
            except LinkError as error:
                self._tell_turned_away(peer, error)
                peer.close()
                continue
            if peer.is_ready:
                self._welcome(peer)
            elif self._clock.now_s() - since_s < _KNOCKING_S:
                still.append((since_s, peer))
            else:
                peer.close()
        self._knocking = still

    def _tell_turned_away(self, peer: _Peer, error: LinkError) -> None:
        """Once for whoever tries again and again."""
        host = peer.name.rpartition(":")[0]
        _log.log(logging.DEBUG if host == self._told_host else logging.WARNING, "turned away: %s", error)
        self._told_host = host

    def _welcome(self, newcomer: _Peer) -> None:
        now_s = self._clock.now_s()
        if self._peer is not None:
            if now_s - self._heard_s < _SILENT_PEER_S:
                self._turn_away(newcomer)
                return
            self._drop(self._peer)
        self._peer = newcomer
        self._told_host = ""
        self.resets += 1
        self._heard_s = now_s

    def _turn_away(self, newcomer: _Peer) -> None:
        with contextlib.suppress(OSError, LinkError):
            if self._farewell:
                newcomer.send(self._farewell)
            newcomer.sock.shutdown(socket.SHUT_WR)
        newcomer.sock.close()

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


def _listening_reason(error: Exception) -> str:
    number = error.errno if isinstance(error, OSError) else None
    if number == errno.EADDRINUSE:
        return "another program listens there. Is it the robot's service, or a simulator? End it, or take another port"
    if number == errno.EADDRNOTAVAIL:
        return "that is no address of this computer; 0.0.0.0 stands for all that it has"
    if number == errno.EACCES:
        return "a port below 1024 is root's; take another one"
    return _reason(error)
