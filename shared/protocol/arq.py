"""Selective repeat over paths of which each keeps its order, sans-I/O.

The receiver says what it has: everything below a base, and a bitmap of what came above it. What is lost is known
without a timer: whatever had left before the other side was asked, and is not in its answer, did not arrive.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

WINDOW = 128  # segments; half of what the byte in an acknowledgement can tell apart
BEHIND = 64  # a repeated segment is recognised so far back
MOST_BITMAP_BYTES = WINDOW // 8


@dataclass(slots=True)
class Segment:
    """`left_s`: when its path had last carried it away, None while it is on its way."""

    seq: int
    data: bytes
    path: int = 0
    left_s: float | None = None
    waits: bool = False  # to be sent again
    sendings: int = 0


class SegmentSender:
    """Keeps what is not acknowledged."""

    def __init__(self) -> None:
        self.base = 0  # all below are acknowledged
        self.next = 0
        self._kept: dict[int, Segment] = {}
        self._lost: deque[int] = deque()  # in the order of their numbers, mostly

    @property
    def has_room(self) -> bool:
        return self.next - self.base < WINDOW

    @property
    def unacknowledged(self) -> int:
        return len(self._kept)

    @property
    def lost(self) -> Segment | None:
        """The first one to be sent again."""
        while self._lost:
            segment = self._kept.get(self._lost[0])
            if segment is not None and segment.waits:
                return segment
            self._lost.popleft()
        return None

    @property
    def lost_bytes(self) -> int:
        return sum(len(s.data) for s in self._kept.values() if s.waits)

    def add(self, data: bytes) -> Segment:
        segment = Segment(self.next, data)
        self.next += 1
        self._kept[segment.seq] = segment
        return segment

    def sending(self, segment: Segment, path: int) -> None:
        segment.path, segment.left_s, segment.waits = path, None, False
        segment.sendings += 1

    def left(self, seq: int, sending: int, now_s: float) -> None:
        """The path is done with the n-th sending of a segment."""
        segment = self._kept.get(seq)
        if segment is not None and segment.sendings == sending:
            segment.left_s = now_s

    def failed(self, seq: int, sending: int) -> None:
        """The path could not send it."""
        segment = self._kept.get(seq)
        if segment is not None and segment.sendings == sending:
            self._lose(segment)

    def acknowledge(self, base_low: int, bitmap: bytes) -> list[Segment]:
        """What the receiver has; the segments of which that is news. An acknowledgement out of date is none."""
        ahead = (base_low - self.base) & 0xFF
        if ahead > self.next - self.base:
            return []
        base = self.base + ahead
        arrived = list(range(self.base, base))
        for i, byte in enumerate(bitmap):
            arrived += [base + 1 + 8 * i + bit for bit in range(8) if byte >> bit & 1]
        news = [self._kept.pop(seq) for seq in arrived if seq in self._kept]
        self.base = base
        return news

    def settle(self, left_before_s: float) -> list[Segment]:
        """What had left before then and is still not acknowledged is lost; those of which that is news."""
        lost = [s for s in self._kept.values() if not s.waits and s.left_s is not None and s.left_s <= left_before_s]
        for segment in lost:
            self._lose(segment)
        return lost

    def _lose(self, segment: Segment) -> None:
        segment.waits = True
        self._lost.append(segment.seq)


class SegmentReceiver:
    """Puts segments in order; holds at most a window of them."""

    def __init__(self) -> None:
        self.base = 0  # the first one that has not come
        self.duplicates = 0
        self._held: dict[int, bytes] = {}
        self._after_highest = 0

    def candidates(self, low: int, bits: int) -> Iterator[int]:
        """The numbers that a segment may have whose lowest bits are these, the likeliest first."""
        span = 1 << bits
        expected = self._after_highest
        first = expected + ((low - expected + span // 2) % span) - span // 2
        for number in sorted(range(first - 8 * span, first + 8 * span, span), key=lambda n: abs(n - expected)):
            if number >= 0 and self.base - BEHIND <= number < self.base + WINDOW:
                yield number

    def take(self, seq: int, data: bytes) -> list[bytes]:
        """What can now be read on."""
        if seq < self.base or seq in self._held:
            self.duplicates += 1
            return []
        if seq >= self.base + WINDOW:
            return []
        self._held[seq] = data
        self._after_highest = max(self._after_highest, seq + 1)
        ready: list[bytes] = []
        while self.base in self._held:
            ready.append(self._held.pop(self.base))
            self.base += 1
        return ready

    def acknowledgement(self) -> tuple[int, bytes]:
        """The lowest byte of the base, and the bitmap of what came above it, as long as it must be."""
        bitmap = bytearray((max(0, self._after_highest - self.base - 1) + 7) // 8)
        for seq in self._held:
            at = seq - self.base - 1
            bitmap[at // 8] |= 1 << at % 8
        return self.base & 0xFF, bytes(bitmap)


class ReplayWindow:
    """Counters that have been seen, of packets that are never sent twice."""

    def __init__(self) -> None:
        self._next = 0
        self._seen = 0  # bit i: `_next - 1 - i`

    def candidates(self, low: int, bits: int) -> Iterator[int]:
        """The counters that a new packet may have whose lowest bits are these, the likeliest first."""
        span = 1 << bits
        first = self._next + ((low - self._next) % span)
        near = [first, first - span, first + span, first - 2 * span, first + 2 * span, first + 3 * span]
        return (n for n in near if n >= 0 and self._is_new(n))

    def add(self, counter: int) -> bool:
        """Whether a later one came before."""
        is_late = counter < self._next
        if is_late:
            self._seen |= 1 << (self._next - 1 - counter)
        else:
            self._seen = (self._seen << (counter + 1 - self._next) | 1) & (1 << BEHIND) - 1
            self._next = counter + 1
        return is_late

    def _is_new(self, counter: int) -> bool:
        behind = self._next - 1 - counter
        return behind < 0 or (behind < BEHIND and not self._seen >> behind & 1)
