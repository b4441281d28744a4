"""Stands at both ends of a link and keeps account: what was taken for sending, what came, when, over which path."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from dataclasses import dataclass, field
from enum import Enum

from shared.link.base import ForRadio, Lane, Link, LinkHealth, LinkPath, LinkStatistics, PathChanged
from shared.runtime.clock import Clock

_RELIABLE = {Lane.BULK, Lane.COMMAND, Lane.NOW}
_ORDERED = (Lane.BULK, Lane.COMMAND)


class Side(Enum):
    ROBOT = "robot"
    STATION = "station"

    @property
    def other(self) -> Side:
        return Side.STATION if self is Side.ROBOT else Side.ROBOT


@dataclass(slots=True)
class Sent:
    """`datagram` is what Wi-Fi carries. `came`: how often it came; `came_s`, `arrived`: the first time, and as what."""

    lane: Lane
    number: int  # on its lane
    sent_s: float
    datagram: bytes
    came: int = 0
    came_s: float = math.nan
    arrived: bytes = b""

    @property
    def over(self) -> LinkPath | None:
        """As far as the two versions tell."""
        if not self.came:
            return None
        return LinkPath.WIFI if self.arrived == self.datagram else LinkPath.RADIO

    @property
    def took_s(self) -> float:
        return self.came_s - self.sent_s


@dataclass(slots=True)
class Account:
    """Of one direction; only what has to come is kept, of the newest values no more than their count."""

    sent: list[Sent] = field(default_factory=list)
    newest_sent: int = 0
    newest_came: int = 0
    out_of_order: int = 0

    def of(self, lane: Lane) -> list[Sent]:
        return [s for s in self.sent if s.lane is lane]

    def lost(self, before_s: float) -> int:
        """Sent before then and not come so far."""
        return sum(not s.came for s in self.sent if s.sent_s < before_s)

    @property
    def duplicated(self) -> int:
        return sum(s.came - 1 for s in self.sent if s.came)


class Witness:
    """`watch` each end as soon as it is made. A new station owes nothing that was sent to the last one."""

    def __init__(self) -> None:
        self.accounts = {side: Account() for side in Side}  # by who sent
        self._newest: dict[Side, set[bytes]] = {side: set() for side in Side}
        self._meant: dict[Side, defaultdict[bytes, list[Sent]]] = {side: defaultdict(list) for side in Side}
        self._counts = {(side, lane): 0 for side in Side for lane in _RELIABLE}
        self._last = {(side, lane): -1 for side in Side for lane in _ORDERED}

    def watch(self, link: Link, side: Side, clock: Clock) -> Link:
        return _Watched(link, side, clock, self)

    def taken(self, side: Side, datagram: bytes, lane: Lane, now_s: float) -> Sent | None:
        account = self.accounts[side]
        if lane not in _RELIABLE:
            account.newest_sent += 1
            self._newest[side].add(datagram)
            return None
        sent = Sent(lane, self._counts[side, lane], now_s, datagram)
        self._counts[side, lane] += 1
        account.sent.append(sent)
        self._meant[side][datagram].append(sent)
        return sent

    def has_version(self, side: Side, radio_version: bytes, sent: Sent) -> None:
        """What LoRa carries in its place."""
        self._meant[side][radio_version].append(sent)

    def came(self, side: Side, datagram: bytes, now_s: float) -> None:
        """`side` has read it."""
        sender = side.other
        account, meant = self.accounts[sender], self._meant[sender].get(datagram)
        if meant is None or (meant[-1].came and datagram in self._newest[sender]):  # said on both kinds of lanes
            account.newest_came += 1
            return
        sent = next((s for s in meant if not s.came), meant[-1])  # the same may be said again
        sent.came += 1
        if sent.came > 1:
            return
        sent.came_s, sent.arrived = now_s, datagram
        if sent.lane in _ORDERED:
            account.out_of_order += sent.number < self._last[sender, sent.lane]
            self._last[sender, sent.lane] = max(sent.number, self._last[sender, sent.lane])


class _Watched:
    """A `Link`."""

    def __init__(self, link: Link, side: Side, clock: Clock, witness: Witness) -> None:
        self._link = link
        self._side = side
        self._clock = clock
        self._witness = witness

    @property
    def connected(self) -> bool:
        return self._link.connected

    @property
    def statistics(self) -> LinkStatistics:
        return self._link.statistics

    @property
    def path(self) -> LinkPath:
        return self._link.path

    @property
    def has_room(self) -> bool:
        return self._link.has_room

    @property
    def resets(self) -> int:
        return self._link.resets

    @property
    def mends_itself(self) -> bool:
        return self._link.mends_itself

    @property
    def events(self) -> deque[PathChanged]:
        return self._link.events

    @property
    def health(self) -> LinkHealth:
        return self._link.health

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        made: list[bytes] = []
        sent: Sent | None = None

        def remembered() -> bytes:
            assert for_radio is not None
            version = for_radio()
            made.append(version)
            if sent is not None:
                self._witness.has_version(self._side, version, sent)
            return version

        taken = self._link.send(datagram, lane, slot, remembered if for_radio is not None else None)
        if taken:
            sent = self._witness.taken(self._side, datagram, lane, self._clock.now_s())
            if sent is not None:
                for version in made:
                    self._witness.has_version(self._side, version, sent)
        return taken

    def receive(self, timeout_s: float) -> bytes | None:
        datagram = self._link.receive(timeout_s)
        if datagram is not None:
            self._witness.came(self._side, datagram, self._clock.now_s())
        return datagram

    def close(self) -> None:
        self._link.close()
