"""From end to end, over whatever path: what was sent and not acknowledged, what has come already. Sans-I/O."""

from __future__ import annotations

from collections import OrderedDict, deque
from dataclasses import dataclass

from shared.link.base import ForRadio, LinkPath

WINDOW = 100  # datagrams; the byte that counts them tells 256 apart


@dataclass(slots=True)
class Kept:
    """A datagram that nobody has acknowledged. `for_radio` makes the short version, when that is needed."""

    seq: int
    datagram: bytes
    for_radio: ForRadio | None
    sent_on: set[LinkPath]
    radio_version: bytes | None = None

    def on(self, path: LinkPath) -> bytes:
        if path is LinkPath.WIFI or self.for_radio is None:
            return self.datagram
        if self.radio_version is None:
            self.radio_version = self.for_radio()
        return self.radio_version


class Outgoing:
    """A reliable lane's sender."""

    def __init__(self) -> None:
        self._kept: deque[Kept] = deque()
        self._next = 0

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def has_room(self) -> bool:
        return len(self._kept) < WINDOW

    def add(self, datagram: bytes, for_radio: ForRadio | None = None) -> None:
        self._kept.append(Kept(self._next, datagram, for_radio, set()))
        self._next += 1

    def unsent(self, path: LinkPath) -> list[Kept]:
        """In their order."""
        return [kept for kept in self._kept if path not in kept.sent_on]

    def forget_path(self, path: LinkPath) -> None:
        """What the path was carrying may be lost: it is sent again."""
        for kept in self._kept:
            kept.sent_on.discard(path)

    def acknowledge(self, expected_low: int) -> None:
        """The receiver has everything before this number."""
        first = self._next - len(self._kept)
        count = (expected_low - first) & 0xFF
        for _ in range(count if count <= len(self._kept) else 0):
            self._kept.popleft()


class Incoming:
    """A reliable lane's receiver: duplicates dropped, order restored."""

    def __init__(self) -> None:
        self.expected = 0
        self.duplicates = 0
        self._held: dict[int, bytes] = {}

    def take(self, seq_low: int, datagram: bytes) -> list[bytes]:
        ahead = (seq_low - self.expected) & 0xFF
        if ahead >= WINDOW or self.expected + ahead in self._held:
            self.duplicates += 1
            return []
        self._held[self.expected + ahead] = datagram
        ready: list[bytes] = []
        while self.expected in self._held:
            ready.append(self._held.pop(self.expected))
            self.expected += 1
        return ready


class Newer:
    """A lane of which only what is newer than the last counts, slot by slot."""

    def __init__(self) -> None:
        self.duplicates = 0
        self._last: OrderedDict[int, int] = OrderedDict()

    def take(self, slot: int, seq_low: int) -> bool:
        last = self._last.get(slot)
        if last is not None and not 0 < (seq_low - last) & 0xFF < 128:
            self.duplicates += 1
            return False
        self._last[slot] = seq_low
        return True
