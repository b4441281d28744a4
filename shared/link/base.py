"""A link carries datagrams between the robot and the station, and knows nothing of what is in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

MAX_DATAGRAM_BYTES = 65_000


class LinkError(Exception):
    """The link is closed, refused or lost; the text names the address and what to do."""


@dataclass(slots=True)
class LinkStatistics:
    """Counters since the link was made; the bytes are those on the wire, framing included."""

    sent_datagrams: int = 0
    sent_bytes: int = 0
    received_datagrams: int = 0
    received_bytes: int = 0
    dropped_bytes: int = 0  # foreign or damaged


class Link(Protocol):
    @property
    def connected(self) -> bool: ...

    @property
    def statistics(self) -> LinkStatistics: ...

    def send(self, datagram: bytes) -> bool:
        """Take a datagram for sending, without waiting; False when there is no room now or no peer.

        Raises `LinkError` when the link is closed or lost, `ValueError` for a datagram over the limit.
        """
        ...

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, or None when none came in time. Raises `LinkError` when closed or lost."""
        ...

    def close(self) -> None:
        """Let go of the peer; may be called twice."""
        ...
