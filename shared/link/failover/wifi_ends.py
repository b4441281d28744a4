"""The two ends of Wi-Fi as `Failover` takes them: a link or None, without waiting."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

from shared.link.base import ForRadio, Lane, Link, LinkError, LinkHealth, LinkPath, PathChanged
from shared.link.tcp import TcpServerLink


class ServedStation:
    """The station that a server has now, as a link of its own: closing it lets the station go, not the server."""

    path = LinkPath.WIFI
    mends_itself = False
    resets = 0

    def __init__(self, server: TcpServerLink, first: bytes | None) -> None:
        """`first`: what has been read of it already."""
        self.statistics = server.statistics
        self.events: deque[PathChanged] = deque(maxlen=1)  # there are none
        self._server = server
        self._number = server.resets
        self._read = deque([first] if first is not None else [])

    @property
    def connected(self) -> bool:
        return self._server.connected and self._server.resets == self._number

    @property
    def has_room(self) -> bool:
        return self.connected and self._server.has_room

    @property
    def health(self) -> LinkHealth:
        return self._server.health

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        del for_radio
        self._fail_if_gone()
        return self._server.send(datagram, lane, slot)

    def receive(self, timeout_s: float) -> bytes | None:
        if self._read:
            return self._read.popleft()
        self._fail_if_gone()
        datagram = self._server.receive(timeout_s)
        self._fail_if_gone()
        return datagram

    def close(self) -> None:
        if self.connected:
            self._server.drop_peer()

    def _fail_if_gone(self) -> None:
        if not self.connected:
            raise LinkError("Wi-Fi: the station's connection is gone")


class NoRadio:
    """Of a station without radios, whose robot has some."""

    connected = has_room = False
    health = LinkHealth(is_secret=True)  # LoRa is not spoken without a pairing file
    resets = 0

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0) -> bool:
        del datagram, lane, slot
        return False

    def receive(self, timeout_s: float) -> bytes | None:
        del timeout_s
        return None

    def close(self) -> None:
        pass


def serve(server: TcpServerLink) -> Callable[[], Link | None]:
    """The robot's end; ask it often, because newcomers come in when it is asked."""

    def connect() -> Link | None:
        before = server.resets
        datagram = server.receive(0.0)
        is_first = datagram is not None and server.resets in {before, before + 1}
        return ServedStation(server, datagram if is_first else None) if server.connected else None

    return connect


class Dialler:
    """The station's end: `make` waits for the network, in a thread of its own that lives as long as one attempt."""

    def __init__(self, make: Callable[[], Link], made: Link | None = None) -> None:
        """`made`: what the first call gives."""
        self._make = make
        self._lock = threading.Lock()
        self._made = made
        self._error: LinkError | None = None
        self._thread: threading.Thread | None = None
        self._is_closed = False

    def __call__(self) -> Link | None:
        """What the last attempt has made; where there is none under way, another one begins. Raises its `LinkError`."""
        with self._lock:
            link, self._made = self._made, None
            error, self._error = self._error, None
            is_busy = self._thread is not None and self._thread.is_alive()
            if link is None and error is None and not is_busy and not self._is_closed:
                self._thread = threading.Thread(target=self._dial, name="dial", daemon=True)
                self._thread.start()
        if error is not None:
            raise error
        return link

    def close(self) -> None:
        """What is still made is closed at once."""
        with self._lock:
            self._is_closed = True
            link, self._made = self._made, None
        if link is not None:
            link.close()

    def _dial(self) -> None:
        try:
            link = self._make()
        except LinkError as error:
            with self._lock:
                self._error = error
            return
        with self._lock:
            if not self._is_closed:
                self._made = link
                return
        link.close()
