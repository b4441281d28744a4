"""`Link` over the radios of one side; make it with `robot_radios` or `station_radios`."""

from __future__ import annotations

import logging
import math
import secrets
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from shared.link.base import (
    MAX_DATAGRAM_BYTES,
    ForRadio,
    Lane,
    LinkError,
    LinkHealth,
    LinkPath,
    LinkStatistics,
    PathChanged,
    RadioHealth,
)
from shared.link.es920lr.airtime import MAX_PAYLOAD_BYTES
from shared.link.es920lr.settings import RadioSettings
from shared.link.radio_pair.config import PairConfig, timing_of
from shared.link.radio_pair.conversation import Conversation, SecurityStatistics
from shared.link.radio_pair.lanes import Lanes, LaneStatistics
from shared.link.radio_pair.pump import OpenRadio, Pump
from shared.link.radio_pair.turns import AnsweringTurns, AskingTurns, Turns, TurnStatistics
from shared.protocol.auth import Answerer, Caller, RandomBytes
from shared.runtime.clock import Clock, MonotonicClock

_log = logging.getLogger(__name__)
_POLL_S = 0.01  # how late a new datagram may be on a radio that has nothing else to do
_IDLE_S = 0.1  # for a radio whose port is lost
_JOIN_S = 3.0
_GOODBYE_S = 0.3
_GOODPUT_WINDOW_S = 5.0
_MOST_HEARD = 1_024  # packets within that window


@dataclass(slots=True)
class RadioPairStatistics(LinkStatistics):
    """`sent_bytes` and `received_bytes` are those of the datagrams; the parts count the rest."""

    lanes: LaneStatistics = field(default_factory=LaneStatistics)
    turns: TurnStatistics = field(default_factory=TurnStatistics)
    security: SecurityStatistics = field(default_factory=SecurityStatistics)


class RadioPair:
    """One side. With `threads` each radio has its own; without, `step` moves all of them and nothing waits.

    A module that is lost is brought up again and again while the other one carries all.
    """

    path = LinkPath.RADIO
    mends_itself = True

    def __init__(
        self,
        open_radios: Sequence[OpenRadio],
        conversation: Conversation,
        turns: Turns,
        clock: Clock,
        config: PairConfig,
        threads: bool,
        when_closed: Callable[[], None],
    ) -> None:
        self.events: deque[PathChanged] = deque(maxlen=1)  # there are none
        self._clock = clock
        self._config = config
        self._conversation = conversation
        self._lanes = conversation.lanes
        self._turns = turns
        self._changed = threading.Condition()
        self._heard_s = float("-inf")
        self._was_connected = False
        self._closed = False
        self._when_closed = when_closed
        self._stop = threading.Event()
        self._carried: deque[tuple[float, int]] = deque(maxlen=_MOST_HEARD)
        self.statistics = RadioPairStatistics(
            lanes=self._lanes.statistics, turns=turns.statistics, security=conversation.statistics
        )
        self._pumps = [
            Pump(i, open_radio, turns, clock, self._changed, self._note_heard)
            for i, open_radio in enumerate(open_radios)
        ]
        self._threads = [threading.Thread(target=self._run, args=(p,), name="radio", daemon=True) for p in self._pumps]
        for thread in self._threads if threads else ():
            thread.start()
        self._threaded = threads

    @property
    def connected(self) -> bool:
        """The other side has been heard lately, by whatever radio."""
        with self._changed:
            return self._is_connected()

    @property
    def rssi_dbm(self) -> list[float]:
        """Of each radio, smoothed; NaN before anything was heard."""
        return [p.rssi_dbm for p in self._pumps]

    @property
    def operating(self) -> list[bool]:
        """Which of our modules operate."""
        return [p.operating for p in self._pumps]

    @property
    def waiting_bytes(self) -> int:
        """What was taken and has not been on the air: who sends what is newest waits until this is little."""
        with self._changed:
            return self._lanes.waiting_bytes

    @property
    def has_room(self) -> bool:
        with self._changed:
            return self._is_connected() and self._lanes.waiting_bytes < self._config.ahead_bytes

    @property
    def health(self) -> LinkHealth:
        return LinkHealth(
            lora=self.connected,
            radios=tuple(RadioHealth(p.operating, p.rssi_dbm, p.fault) for p in self._pumps),
            goodput_bps=self.goodput_bps,
            is_secret=True,
        )

    @property
    def resets(self) -> int:
        """How often what was on its way was forgotten, because the other side had begun anew."""
        return self._lanes.resets

    @property
    def goodput_bps(self) -> float:
        """Bits a second that have come for certain, both ways together, over the last 5 s."""
        with self._changed:
            now_s = self._clock.now_s()
            while self._carried and self._carried[0][0] < now_s - _GOODPUT_WINDOW_S:
                self._carried.popleft()
            if not self._carried:
                return 0.0
            first_s, first_bytes = self._carried[0]
            return 8.0 * (self._carried_bytes() - first_bytes) / max(now_s - first_s, 0.1)

    def _carried_bytes(self) -> int:
        lanes = self._lanes.statistics
        return lanes.acknowledged_bytes + lanes.delivered_bytes

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        """As `Link`. What is too long for NOW or NEWEST travels as COMMAND."""
        if for_radio is not None:
            datagram = for_radio()
        if not 0 < len(datagram) <= MAX_DATAGRAM_BYTES:
            raise ValueError(f"a datagram of {len(datagram)} bytes; 1 to {MAX_DATAGRAM_BYTES} are allowed")
        with self._changed:
            self._fail_if_closed()
            if not self._is_connected() or not self._lanes.queue(bytes(datagram), lane, slot):
                return False
            self._changed.notify_all()
        self.statistics.sent_datagrams += 1
        self.statistics.sent_bytes += len(datagram)
        return True

    def receive(self, timeout_s: float) -> bytes | None:
        """As `Link`; the loss of the other side is raised once, and the link goes on by itself when it is back."""
        if not self._threaded:
            self.step()
        with self._changed:
            if self._threaded:
                self._changed.wait_for(self._has_news, timeout_s)
            if self._lanes.delivered:
                datagram = self._lanes.delivered.popleft()
                self.statistics.received_datagrams += 1
                self.statistics.received_bytes += len(datagram)
                return datagram
            self._fail_if_closed()
            self._fail_if_lost()
        return None

    def step(self) -> None:
        """Without threads: do what is due on all radios."""
        for pump in self._pumps:
            pump.step(0.0)
        with self._changed:
            self._is_connected()

    def due_s(self) -> float:
        """Without threads: when `step` is due although no byte has come; what is overdue waits for a module."""
        now_s = self._clock.now_s()
        due_s = (self._turns.due_s(i, now_s) for i in range(len(self._pumps)))
        return min((d for d in due_s if d > now_s), default=math.inf)

    def close(self) -> None:
        with self._changed:
            if self._closed:
                return
            if self._is_connected():
                self._lanes.say_goodbye()
        if self._threaded:
            self._stop.wait(_GOODBYE_S)
        else:
            self.step()
        self._closed = True
        self._stop.set()
        for thread in self._threads if self._threaded else ():
            thread.join(_JOIN_S)
        with self._changed:
            self._changed.notify_all()
        for pump in self._pumps:
            pump.close()
        self._when_closed()

    def _run(self, pump: Pump) -> None:
        while not self._stop.is_set():
            pump.step(_POLL_S)
            if pump.driver is None:
                self._stop.wait(_IDLE_S)

    def _note_heard(self) -> None:
        """Under the lock."""
        self._heard_s = self._clock.now_s()
        self._was_connected |= self._conversation.has_session
        self._carried.append((self._heard_s, self._carried_bytes()))

    def _is_connected(self) -> bool:
        silent_s = self._clock.now_s() - self._heard_s
        return (
            not self._closed
            and self._conversation.has_session
            and not self._lanes.peer_has_left
            and silent_s < self._config.lost_after_s
        )

    def _has_news(self) -> bool:
        return bool(self._lanes.delivered) or self._closed or (self._was_connected and not self._is_connected())

    def _fail_if_closed(self) -> None:
        if self._closed:
            raise LinkError("radio: the link is closed")

    def _fail_if_lost(self) -> None:
        if self._was_connected and not self._is_connected():
            self._was_connected = False
            self._lanes.forget_newest()
            why = "has left" if self._lanes.peer_has_left else "is not heard any more"
            raise LinkError(f"radio: the other side {why}")


def robot_radios(
    open_radios: Sequence[OpenRadio],
    settings: RadioSettings,
    key: bytes,
    clock: Clock | None = None,
    config: PairConfig | None = None,
    random_bytes: RandomBytes = secrets.token_bytes,
    threads: bool = True,
    when_closed: Callable[[], None] = lambda: None,
) -> RadioPair:
    """The robot's side of one or two radios. `settings`: bandwidth, spreading factor and baud rate, the same for all;
    `when_closed` is called at the end.
    """
    config, clock = config or PairConfig(), clock or MonotonicClock()
    conversation = _conversation(Caller(key, random_bytes), config)
    turns = AskingTurns(conversation, timing_of(settings), config, len(open_radios))
    return RadioPair(open_radios, conversation, turns, clock, config, threads, when_closed)


def station_radios(
    open_radios: Sequence[OpenRadio],
    settings: RadioSettings,
    key: bytes,
    clock: Clock | None = None,
    config: PairConfig | None = None,
    random_bytes: RandomBytes = secrets.token_bytes,
    threads: bool = True,
    when_closed: Callable[[], None] = lambda: None,
) -> RadioPair:
    """The station's side; its radios in any order."""
    config, clock = config or PairConfig(), clock or MonotonicClock()
    conversation = _conversation(Answerer(key, random_bytes), config)
    turns = AnsweringTurns(conversation, timing_of(settings), config, len(open_radios))
    return RadioPair(open_radios, conversation, turns, clock, config, threads, when_closed)


def _conversation(greeter: Caller | Answerer, config: PairConfig) -> Conversation:
    lanes = Lanes(config.bulk_limit_bytes, MAX_DATAGRAM_BYTES)
    return Conversation(lanes, MAX_PAYLOAD_BYTES, greeter)
