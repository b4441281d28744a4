"""What a failover link is made of: the kinds of its frames, what it needs of a radio, what it tells."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from shared.link.base import Lane, LinkError, LinkHealth, LinkStatistics


class Kind(IntEnum):
    HELLO = 0
    PROBE = 1
    ACK = 2
    DATA = 3
    COMMAND = 4
    NOW = 5
    NEWEST = 6


class SpeaksPlainly(LinkError):
    """The other side of Wi-Fi is no failover: another link has to be made."""


class Radio(Protocol):
    """What is needed of a radio pair."""

    @property
    def connected(self) -> bool: ...
    @property
    def has_room(self) -> bool: ...
    @property
    def health(self) -> LinkHealth: ...
    @property
    def resets(self) -> int:
        """How often it forgot what it was carrying."""
        ...

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0) -> bool: ...
    def receive(self, timeout_s: float) -> bytes | None: ...
    def close(self) -> None: ...


@dataclass(slots=True)
class FailoverStatistics(LinkStatistics):
    """The bytes are those of the datagrams."""

    changes: int = 0
    duplicates: int = 0
    wifi_connects: int = 0
    peer_restarts: int = 0
