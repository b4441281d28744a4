"""A link carries datagrams between the robot and the station, and knows nothing of what is in them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

MAX_DATAGRAM_BYTES = 65_000


class LinkError(Exception):
    """The link is closed, refused or lost; the text names the address and what to do."""


class Lane(Enum):
    """How a datagram travels."""

    BULK = "bulk"  # nothing lost, in order
    COMMAND = "command"  # the same, before the bulk
    NOW = "now"  # nothing lost, before everything, in no order
    NEWEST = "newest"  # sent once; a newer one of the same slot takes its place


class LinkPath(Enum):
    """What a datagram of the bulk travels over. A link that has no radio counts as Wi-Fi."""

    WIFI = "Wi-Fi"
    RADIO = "LoRa"


@dataclass(frozen=True, slots=True)
class PathChanged:
    """For the operator."""

    time_s: float
    path: LinkPath
    reason: str


@dataclass(frozen=True, slots=True)
class RadioHealth:
    """One radio of ours."""

    operates: bool
    rssi_dbm: float  # of the other side's packets, smoothed; NaN before anything was heard
    fault: str = ""  # why its port is not open


@dataclass(frozen=True, slots=True)
class LinkHealth:
    """What the operator may want to know of a link beyond its path; None stands for what it does not have."""

    wifi: bool | None = None  # the other side answers over Wi-Fi
    lora: bool | None = None  # … over LoRa
    radios: tuple[RadioHealth, ...] = ()
    goodput_bps: float | None = None  # over LoRa, both ways, within the last seconds
    is_secret: bool = False  # nobody takes part who has not the pairing file


@dataclass(slots=True)
class LinkStatistics:
    """Counters since the link was made; the bytes are those on the wire, framing included."""

    sent_datagrams: int = 0
    sent_bytes: int = 0
    received_datagrams: int = 0
    received_bytes: int = 0
    dropped_bytes: int = 0  # foreign or damaged


ForRadio = Callable[[], bytes]


class Link(Protocol):
    """One end. Whoever sends what is newest looks at `has_room` first, so that nothing old waits in a queue."""

    @property
    def connected(self) -> bool: ...

    @property
    def statistics(self) -> LinkStatistics: ...

    @property
    def path(self) -> LinkPath: ...

    @property
    def has_room(self) -> bool:
        """A datagram of the bulk that is sent now goes at once."""
        ...

    @property
    def resets(self) -> int:
        """Grows when what was sent before may never come, as after a new start of the other side."""
        ...

    @property
    def mends_itself(self) -> bool:
        """After a loss it goes on by itself; otherwise another link has to be made."""
        ...

    @property
    def events(self) -> deque[PathChanged]:
        """Changes of the path, oldest first; bounded. Who tells the operator takes them out."""
        ...

    @property
    def health(self) -> LinkHealth: ...

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        """Take a datagram for sending, without waiting; False when there is no room now or no peer.

        `slot`: of the lane NEWEST, below 30. `for_radio` makes what LoRa carries in its place, if it comes to that.
        Raises `LinkError` when the link is closed or lost, `ValueError` for a datagram over the limit.
        """
        ...

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, or None when none came in time.

        Raises `LinkError` when closed or lost; a link that mends itself raises the loss once and goes on.
        """
        ...

    def close(self) -> None:
        """Let go of the peer; may be called twice."""
        ...
