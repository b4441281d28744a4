"""Two ends in one process: for lock-step missions and tests."""

from __future__ import annotations

import threading
from collections import deque

from shared.link.base import (
    MAX_DATAGRAM_BYTES,
    ForRadio,
    Lane,
    LinkError,
    LinkHealth,
    LinkPath,
    LinkStatistics,
    PathChanged,
)

_QUEUE_DATAGRAMS = 256


class _Wire:
    """One direction."""

    def __init__(self) -> None:
        self.waiting: deque[bytes] = deque()
        self.changed = threading.Condition()
        self.closed = False


class LoopbackLink:
    """One end; make both with `loopback_pair`. There is one lane."""

    path = LinkPath.WIFI
    mends_itself = False
    resets = 0

    def __init__(self, outgoing: _Wire, incoming: _Wire) -> None:
        self.statistics = LinkStatistics()
        self.events: deque[PathChanged] = deque(maxlen=1)  # there are none
        self._outgoing = outgoing
        self._incoming = incoming

    @property
    def connected(self) -> bool:
        return not (self._outgoing.closed or self._incoming.closed)

    @property
    def has_room(self) -> bool:
        return self.connected and len(self._outgoing.waiting) < _QUEUE_DATAGRAMS

    @property
    def health(self) -> LinkHealth:
        return LinkHealth()

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        del lane, slot, for_radio
        if not 0 < len(datagram) <= MAX_DATAGRAM_BYTES:
            raise ValueError(f"a datagram of {len(datagram)} bytes; 1 to {MAX_DATAGRAM_BYTES} are allowed")
        with self._outgoing.changed:
            self._fail_if_closed()
            if len(self._outgoing.waiting) >= _QUEUE_DATAGRAMS:
                return False
            self._outgoing.waiting.append(datagram)
            self._outgoing.changed.notify()
        self.statistics.sent_datagrams += 1
        self.statistics.sent_bytes += len(datagram)
        return True

    def receive(self, timeout_s: float) -> bytes | None:
        wire = self._incoming
        with wire.changed:
            if not wire.waiting and not wire.closed and timeout_s > 0:
                wire.changed.wait(timeout_s)
            if not wire.waiting:
                self._fail_if_closed()
                return None
            datagram = wire.waiting.popleft()
        self.statistics.received_datagrams += 1
        self.statistics.received_bytes += len(datagram)
        return datagram

    def close(self) -> None:
        for wire in (self._outgoing, self._incoming):
            with wire.changed:
                wire.closed = True
                wire.changed.notify_all()

    def _fail_if_closed(self) -> None:
        if not self.connected:
            raise LinkError("loopback: the link is closed")


def loopback_pair() -> tuple[LoopbackLink, LoopbackLink]:
    """Two joined ends."""
    there, back = _Wire(), _Wire()
    return LoopbackLink(there, back), LoopbackLink(back, there)
