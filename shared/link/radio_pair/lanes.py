"""The lanes of one conversation: what waits, is on its way, has come. Sans-I/O; knows no turns and no keys."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from shared.link.base import Lane
from shared.link.radio_pair import items as i
from shared.protocol.arq import BEHIND, MOST_BITMAP_BYTES, Segment, SegmentReceiver, SegmentSender
from shared.protocol.fragment import Assembler, Cutter

_MOST_DELIVERED = 256  # not fetched; then segments are turned away, and sent again
_SMALLEST_CUT_BYTES = 8  # of a new segment at the end of a packet that has other things in it
_NOW_OUTSTANDING = 8  # from the oldest one on, of 32 identifiers
_NOW_REMEMBERED = 16
_TELL = 2  # times, because an answer may come although the question was not heard
_NOW_SENDINGS = 2  # at once, one on each radio, before anybody could have answered


@dataclass(frozen=True, slots=True)
class Load:
    """One sending of one segment, for `left` and `failed`."""

    lane: Lane
    seq: int
    sending: int


@dataclass(frozen=True, slots=True)
class Filled:
    """A packet to be: `seq` is None for one of items."""

    seq: int | None
    body: bytes
    loads: tuple[Load, ...]


@dataclass(frozen=True, slots=True)
class Fate:
    """A segment was acknowledged, or is known to be lost."""

    path: int
    arrived: bool
    left_s: float | None  # when the path had carried it away; None when the answer is here before the path's word


@dataclass(slots=True)
class _Now:
    datagram: bytes
    sendings_left: int = _NOW_SENDINGS


class _Stream:
    """One reliable lane, both directions."""

    def __init__(self, lane: Lane, most_datagram_bytes: int) -> None:
        self.lane = lane
        self.cutter = Cutter()
        self.sender = SegmentSender()
        self.receiver = SegmentReceiver()
        self.assembler = Assembler(most_datagram_bytes)
        self._is_told = True  # all that has come
        self._tellings = 0  # … and so often it is to be told to who has not said that it heard

    @property
    def can_cut(self) -> bool:
        return self.cutter.waiting_bytes > 0 and self.sender.has_room

    @property
    def has_something(self) -> bool:
        return self.sender.lost is not None or self.can_cut

    @property
    def has_news(self) -> bool:
        """More has come than was told."""
        return not self._is_told

    @property
    def has_to_tell(self) -> bool:
        """… than the other side is likely to know."""
        return self._tellings > 0

    def next_segment(self, most_bytes: int, smallest_cut: int) -> Segment | None:
        """A lost segment if it fits, else a new one."""
        lost = self.sender.lost
        if lost is not None and len(lost.data) <= most_bytes:
            return lost
        if self.can_cut and most_bytes >= smallest_cut:
            return self.sender.add(self.cutter.cut(most_bytes))
        return None

    def send(self, segment: Segment, path: int) -> Load:
        self.sender.sending(segment, path)
        return Load(self.lane, segment.seq, segment.sendings)

    def expand(self, low: int) -> int:
        """The sequence number with these lowest bits that is nearest to what is expected."""
        first = self.receiver.base - BEHIND
        return first + ((low - first) & i.SEQ_MASK)

    def take(self, seq: int, data: bytes) -> list[bytes]:
        """What can now be read on."""
        self._is_told, self._tellings = False, _TELL
        return self.receiver.take(seq, data)

    def told(self) -> None:
        """The other side has answered a packet with an acknowledgement, and has probably heard it."""
        if self._is_told:
            self._tellings = max(0, self._tellings - 1)

    def tell(self) -> bytes:
        self._is_told = True
        return self.acknowledgement()

    def acknowledgement(self) -> bytes:
        base_low, bitmap = self.receiver.acknowledgement()
        return i.write(i.Acknowledgement(self.lane, base_low, bitmap))


@dataclass(slots=True)
class LaneStatistics:
    """Counters since the link was made."""

    delivered_datagrams: int = 0
    delivered_bytes: int = 0
    acknowledged_bytes: int = 0  # of ours
    read_segments: int = 0  # of the other side's, in order
    duplicates: int = 0
    resent_segments: int = 0
    sent_segments: int = 0
    turned_away: int = 0
    malformed: int = 0
    late_packets: int = 0


class Lanes:
    def __init__(self, bulk_limit_bytes: int, most_datagram_bytes: int) -> None:
        self.statistics = LaneStatistics()
        self.delivered: deque[bytes] = deque()
        self.peer_has_left = False
        self._bulk_limit_bytes = bulk_limit_bytes
        self._most_datagram_bytes = most_datagram_bytes
        self.resets = -1
        self.reset()

    def reset(self) -> None:
        """The other side began anew: what was meant for it is gone."""
        self.resets += 1
        self.bulk = _Stream(Lane.BULK, self._most_datagram_bytes)
        self.commands = _Stream(Lane.COMMAND, self._most_datagram_bytes)
        self._streams = {Lane.BULK: self.bulk, Lane.COMMAND: self.commands}
        self._now: dict[int, _Now] = {}
        self._next_now = 0
        self._now_seen: deque[int] = deque(maxlen=_NOW_REMEMBERED)
        self._now_to_confirm: list[int] = []
        self._newest: dict[int, bytes] = {}
        self._says_goodbye = False

    # ---- what is to be sent

    def queue(self, datagram: bytes, lane: Lane, slot: int) -> bool:
        """False when there is no room."""
        short = len(datagram) <= i.MOST_SHORT_BYTES
        if lane is Lane.NEWEST and short:
            self._newest[slot % i.NUMBERS] = datagram
            return True
        if lane is Lane.NOW and short:
            return self._queue_now(datagram)
        stream = self.bulk if lane is Lane.BULK else self.commands
        waiting = stream.cutter.waiting_bytes
        if waiting and waiting + len(datagram) > self._bulk_limit_bytes:
            return False
        stream.cutter.add(datagram)
        return True

    def _queue_now(self, datagram: bytes) -> bool:
        oldest = next(iter(self._now), self._next_now)
        if (self._next_now - oldest) % i.NUMBERS >= _NOW_OUTSTANDING:
            return False
        self._now[self._next_now] = _Now(datagram)
        self._next_now = (self._next_now + 1) % i.NUMBERS
        return True

    def forget_newest(self) -> None:
        """When there is a way again it would be old."""
        self._newest.clear()

    def say_goodbye(self) -> None:
        self._says_goodbye = True

    @property
    def has_urgent(self) -> bool:
        """Something waits that is worth a packet of its own."""
        return (
            bool(self._newest or self._now_to_confirm or self._says_goodbye)
            or self.commands.has_something
            or any(now.sendings_left for now in self._now.values())
        )

    @property
    def has_something(self) -> bool:
        return self.has_urgent or self.bulk.has_something

    @property
    def unanswered(self) -> bool:
        """Something was sent of which nobody knows whether it has come."""
        return bool(self.bulk.sender.unacknowledged or self.commands.sender.unacknowledged or self._now)

    @property
    def waiting_bytes(self) -> int:
        """About as many bytes as packets would have to carry now."""
        short = [*self._newest.values(), *(now.datagram for now in self._now.values() if now.sendings_left)]
        return sum(map(len, short)) + sum(s.cutter.waiting_bytes + s.sender.lost_bytes for s in self._streams.values())

    def resends_fit(self, most_bytes: int) -> bool:
        """Whether what is to be sent again has room beside a report; segments are not cut a second time."""
        report_bytes = sum(len(s.acknowledgement()) for s in self._streams.values() if s.has_to_tell)
        lost = [s.sender.lost for s in self._streams.values()]
        return all(s is None or report_bytes + i.SEGMENT_HEAD_BYTES + len(s.data) <= most_bytes for s in lost)

    def fill(self, most_bytes: int, path: int, report: bool) -> Filled | None:
        """The next packet for a path; None when there is nothing to say. `report`: say in items what has come, and
        if it is nothing."""
        loads: list[Load] = []
        body = self._urgent(most_bytes, path, report, loads)
        if not body and not report:
            segment = self.bulk.next_segment(most_bytes, 1)
            if segment is not None:
                return Filled(segment.seq, segment.data, (self._send(self.bulk, segment, path),))
            return None
        self._add_news(body, most_bytes)
        segment = self.bulk.next_segment(most_bytes - len(body) - i.BULK_HEAD_BYTES, _SMALLEST_CUT_BYTES)
        if segment is not None:
            loads.append(self._send(self.bulk, segment, path))
            body += i.write(i.SegmentItem(Lane.BULK, segment.seq & i.SEQ_MASK, segment.data))
        return Filled(None, bytes(body), tuple(loads))

    def _add_news(self, body: bytearray, most_bytes: int) -> None:
        """What has come since it was told last, where a packet of items goes anyway."""
        for stream in self._streams.values():
            if stream.has_news and len(body) + 2 + MOST_BITMAP_BYTES <= most_bytes:
                body += stream.tell()

    def _urgent(self, most_bytes: int, path: int, report: bool, loads: list[Load]) -> bytearray:
        body = bytearray()
        if report:  # first, because what is left out of it counts as lost
            for stream in self._streams.values():
                if stream.has_to_tell:
                    body += stream.tell()
        if self._says_goodbye:
            body += i.write(i.Goodbye())
            self._says_goodbye = False
        for identifier, now in self._now.items():
            if now.sendings_left and len(body) + i.SHORT_HEAD_BYTES + len(now.datagram) <= most_bytes:
                now.sendings_left -= 1
                body += i.write(i.Now(identifier, now.datagram))
        while self._now_to_confirm and len(body) < most_bytes:
            body += i.write(i.NowHasCome(self._now_to_confirm.pop(0)))
        self._add_commands(body, most_bytes, path, loads)
        for slot in list(self._newest):
            if len(body) + i.SHORT_HEAD_BYTES + len(self._newest[slot]) <= most_bytes:
                body += i.write(i.Newest(slot, self._newest.pop(slot)))
        return body

    def _add_commands(self, body: bytearray, most_bytes: int, path: int, loads: list[Load]) -> None:
        while self.commands.has_something:
            segment = self.commands.next_segment(most_bytes - len(body) - i.SEGMENT_HEAD_BYTES, _SMALLEST_CUT_BYTES)
            if segment is None:
                return
            loads.append(self._send(self.commands, segment, path))
            body += i.write(i.SegmentItem(Lane.COMMAND, segment.seq & i.SEQ_MASK, segment.data))

    def _send(self, stream: _Stream, segment: Segment, path: int) -> Load:
        self.statistics.sent_segments += 1
        self.statistics.resent_segments += segment.sendings > 0
        return stream.send(segment, path)

    def left(self, loads: tuple[Load, ...], now_s: float) -> None:
        """The packet with these is through the air, heard or not."""
        for load in loads:
            self._streams[load.lane].sender.left(load.seq, load.sending, now_s)

    def failed(self, loads: tuple[Load, ...]) -> None:
        for load in loads:
            self._streams[load.lane].sender.failed(load.seq, load.sending)

    def settle(self, left_before_s: float) -> list[Fate]:
        """The other side has told what it has: what had left before then and is not in it was lost."""
        fates = [
            Fate(segment.path, False, segment.left_s)
            for stream in self._streams.values()
            for segment in stream.sender.settle(left_before_s)
        ]
        for now in self._now.values():
            now.sendings_left = max(1, now.sendings_left)
        return fates

    def told(self) -> None:
        """The other side has answered. Who answers never knows that it was heard, and tells the same each time."""
        for stream in self._streams.values():
            stream.told()

    # ---- what has come

    def take_segment(self, lane: Lane, seq: int, data: bytes) -> bool:
        """Whether it was not there before. Raises `StreamError` when the stream makes no sense."""
        stream = self._streams[lane]
        if len(self.delivered) >= _MOST_DELIVERED:
            self.statistics.turned_away += 1
            return True
        before = stream.receiver.duplicates
        for segment in stream.take(seq, data):
            self.statistics.read_segments += 1
            for datagram in stream.assembler.feed(segment):
                self._deliver(datagram)
        duplicates = stream.receiver.duplicates - before
        self.statistics.duplicates += duplicates
        return not duplicates

    def take_items(self, body: bytes, is_late: bool = False) -> list[Fate]:
        """`is_late`: a packet that was made after this one came before. Numbers that begin again soon would be taken
        for others if they came much later: of such a packet only segments count, and everything else is said again,
        or was replaced. Raises `StreamError` when a stream makes no sense."""
        found, good = i.read(body)
        self.statistics.malformed += not good
        self.statistics.late_packets += is_late
        fates: list[Fate] = []
        for item in found:
            if not is_late or isinstance(item, i.SegmentItem):
                fates += self._take_item(item)
        return fates

    def _take_item(self, item: i.Item) -> list[Fate]:
        match item:
            case i.Acknowledgement():
                news = self._streams[item.lane].sender.acknowledge(item.base_low, item.bitmap)
                self.statistics.acknowledged_bytes += sum(len(segment.data) for segment in news)
                return [Fate(segment.path, True, segment.left_s) for segment in news]
            case i.SegmentItem():
                self.take_segment(item.lane, self._streams[item.lane].expand(item.seq_low), item.data)
            case i.Now():
                self._take_now(item)
            case i.NowHasCome():
                self._now.pop(item.identifier, None)
            case i.Newest():
                if len(self.delivered) < _MOST_DELIVERED:
                    self._deliver(item.datagram)
            case i.Goodbye():
                self.peer_has_left = True
        return []

    def _take_now(self, item: i.Now) -> None:
        if len(self.delivered) >= 2 * _MOST_DELIVERED:
            self.statistics.turned_away += 1
            return
        if item.identifier not in self._now_to_confirm:
            self._now_to_confirm.append(item.identifier)
        if item.identifier in self._now_seen:
            self.statistics.duplicates += 1
            return
        self._now_seen.append(item.identifier)
        self._deliver(item.datagram)

    def _deliver(self, datagram: bytes) -> None:
        self.delivered.append(datagram)
        self.statistics.delivered_datagrams += 1
        self.statistics.delivered_bytes += len(datagram)
