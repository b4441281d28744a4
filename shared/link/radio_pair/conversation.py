"""One side of the conversation: keys, packets, lanes. Sans-I/O; when it is whose turn is said elsewhere.

Robot and station keep their lanes over a new session key as long as neither has begun anew: nothing is lost when a
long silence makes them greet again.
"""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass

from shared.link.base import Lane
from shared.link.radio_pair.lanes import Fate, Lanes, Load
from shared.protocol.arq import ReplayWindow, SegmentReceiver
from shared.protocol.auth import (
    LOW_BITS,
    Answerer,
    Caller,
    Kind,
    Session,
    head_of,
    read_head,
)
from shared.protocol.fragment import StreamError

_log = logging.getLogger(__name__)
_MOST_CANDIDATES = 4  # sessions that the robot may go on with; old calls played again make some that it will not


@dataclass(frozen=True, slots=True)
class Packet:
    """For the air."""

    data: bytes
    loads: tuple[Load, ...] = ()
    announces: bool = False


@dataclass(frozen=True, slots=True)
class Heard:
    """A good packet. `answer` is to be sent back as it is."""

    turn: bool
    announces: bool = False  # the next packet there says that it is your turn
    fates: tuple[Fate, ...] = ()
    answer: bytes | None = None
    is_new_session: bool = False
    is_late: bool = False  # it was overtaken by one that was made after it; what it says of what has come is old


@dataclass(slots=True)
class SecurityStatistics:
    """Counters since the link was made."""

    refused_packets: int = 0  # of strangers, damaged, or played again
    sessions: int = 0
    peer_restarts: int = 0
    stream_errors: int = 0


class Conversation:
    """A `Caller` makes it the robot's, an `Answerer` the station's."""

    def __init__(self, lanes: Lanes, packet_bytes: int, greeter: Caller | Answerer) -> None:
        self.lanes = lanes
        self.statistics = SecurityStatistics()
        self.peer_changed = False  # the other side began anew; whoever reads it sets it back
        self._packet_bytes = packet_bytes
        self._greeter = greeter
        self._session: Session | None = None
        self._candidates: deque[Session] = deque(maxlen=_MOST_CANDIDATES)
        self._replay = ReplayWindow()
        self._items_sent = 0

    @property
    def has_session(self) -> bool:
        return self._session is not None

    @property
    def body_bytes(self) -> int:
        """What fits into a packet of ours."""
        return self._packet_bytes - (self._session.outgoing.overhead_bytes if self._session else 1)

    def call(self) -> bytes:
        """The robot's greeting."""
        assert isinstance(self._greeter, Caller)
        return self._greeter.call()

    def next_packet(self, path: int, *, turn: bool, announces: bool = False) -> Packet | None:
        """What is to be sent on a path now; None when there is nothing to say. `turn`: the other side is to answer,
        and it is told what has come; `announces`: the next one will say so, if this is a segment alone."""
        session = self._session
        if session is None:
            return None
        filled = self.lanes.fill(self.body_bytes, path, turn)
        if filled is None:
            return None
        if filled.seq is not None:
            head = head_of(Kind.DATA, announces, filled.seq)
            return Packet(session.outgoing.seal(head, filled.seq, filled.body), filled.loads, announces)
        return self._items(session, turn, filled.body, filled.loads)

    def probe(self) -> Packet | None:
        """Asks for an answer and carries nothing: what it would carry is waited for, and may never come that way."""
        return None if self._session is None else self._items(self._session, True, b"", ())

    def _items(self, session: Session, turn: bool, body: bytes, loads: tuple[Load, ...]) -> Packet:
        counter = self._items_sent
        self._items_sent += 1
        return Packet(session.outgoing.seal(head_of(Kind.ITEMS, turn, counter), counter, body), loads)

    def hear(self, packet: bytes) -> Heard | None:
        """None for what is no packet of the other side's: counted."""
        if not packet:
            return None
        kind = read_head(packet[0])[0]
        heard = self._hear_greeting(packet) if kind in {Kind.CALL, Kind.ANSWER} else self._hear_sealed(packet)
        self.statistics.refused_packets += heard is None
        return heard

    def _hear_greeting(self, packet: bytes) -> Heard | None:
        if isinstance(self._greeter, Caller):
            session = self._greeter.hear(packet)
            if session is None:
                return None
            self._begin(session)
            return Heard(turn=True, is_new_session=True)
        answered = self._greeter.hear(packet)
        if answered is None:
            return None
        answer, session = answered
        if session != self._session and session not in self._candidates:
            self._candidates.append(session)
        return Heard(turn=True, answer=answer)

    def _begin(self, session: Session) -> None:
        before, self._session = self._session, session
        self._candidates.clear()
        self._replay = ReplayWindow()
        self._items_sent = 0
        self.statistics.sessions += 1
        if before is not None and before.peer_boot != session.peer_boot:
            _log.info("the other side has begun anew")
            self.statistics.peer_restarts += 1
            self.peer_changed = True
            self.lanes.reset()
        self.lanes.peer_has_left = False

    def _hear_sealed(self, packet: bytes) -> Heard | None:
        session = self._session
        if session is not None and (body := self._open(session, packet, self.lanes.bulk.receiver, self._replay)):
            return self._understand(packet, body)
        for candidate in self._candidates:
            resumes = session is None or candidate.peer_boot == session.peer_boot
            receiver = self.lanes.bulk.receiver if resumes else SegmentReceiver()
            if body := self._open(candidate, packet, receiver, ReplayWindow()):
                self._begin(candidate)
                return self._understand(packet, body, is_new_session=True)
        return None

    @staticmethod
    def _open(
        session: Session, packet: bytes, receiver: SegmentReceiver, replay: ReplayWindow
    ) -> tuple[int, bytes] | None:
        """Counter and body."""
        kind, _, low = read_head(packet[0])
        for counter in (receiver if kind is Kind.DATA else replay).candidates(low, LOW_BITS):
            body = session.incoming.open(packet, counter)
            if body is not None:
                return counter, body
        return None

    def _understand(self, packet: bytes, opened: tuple[int, bytes], is_new_session: bool = False) -> Heard | None:
        """None for a segment that was there before: anybody could have played it again."""
        kind, turn, _ = read_head(packet[0])
        counter, body = opened
        fates: list[Fate] = []
        is_data, is_late = kind is Kind.DATA, False
        try:
            if is_data:
                if not self.lanes.take_segment(Lane.BULK, counter, body):
                    return None
            else:
                is_late = self._replay.add(counter)
                fates = self.lanes.take_items(body, is_late)
        except StreamError as error:
            _log.error("the stream of the other side makes no sense: %s", error)
            self.statistics.stream_errors += 1
            self._session = None
            self.lanes.reset()
            self._greeter.begin_anew()
        return Heard(turn and not is_data, turn and is_data, tuple(fates), None, is_new_session, is_late)
