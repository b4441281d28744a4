"""The driver's mind, sans-I/O: bytes and a clock in, bytes and events out.

    core = Es920lrCore(settings, rule, can_reset, now_s)
    core.feed(data, now_s) / core.tick(now_s)     what came; that time has passed
    core.take_steps()                             bytes to write, baud rates to set, resets to give, in order
    core.take_events()                            what happened
    core.submit(payload, now_s)                   a packet to send

The module takes one packet at a time and is deaf from then until its OK, 50 ms after the packet. A second packet may
be handed over meanwhile: all of it but the last byte goes to the module ahead of time, when the module is going to be
ready before it forgets a half frame, so that the serial line costs no airtime.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from dataclasses import dataclass
from enum import Enum

from shared.link.es920lr.airtime import (
    MAX_PAYLOAD_BYTES,
    PAUSE_S,
    ack_timeout_s,
    airtime_s,
    longest_carrier_sense_s,
)
from shared.link.es920lr.band import AirtimeLedger, BandRule, check
from shared.link.es920lr.dialogue import Ask, Dialogue, DialogueError, Step, Wait
from shared.link.es920lr.parser import AsksForMode, Heard, OperationParser, Reply, Started, Utterance
from shared.link.es920lr.procedures import Running, bring_up, require_usable, restart
from shared.link.es920lr.settings import BROADCAST_ID, RadioSettings

_log = logging.getLogger(__name__)
_MOST_EVENTS = 256
_MARGIN_S = 0.25  # for USB, the transceiver and a busy computer
_AHEAD_S = 0.3  # hand over ahead of time only when the module will be ready this soon
_STILL_KEPT_S = 0.4  # a half frame this old is surely still there
_SURELY_FORGOTTEN_S = 0.65
_BACK_OFF_S = (1.0, 2.0, 5.0)  # between attempts to bring up a module that does not answer
_STEADY_REPLY_S = 0.1  # a busy module is asked again after this long


class Failure(Enum):
    """Why a packet did not go out; the numbers are the module's."""

    LENGTH = 100
    BUSY = 101  # with an earlier packet
    CHANNEL_BUSY = 102
    NO_ACKNOWLEDGEMENT = 103
    TRANSMITTER = 104
    AIRTIME = 105  # newer firmware watches the band's limit itself
    UNKNOWN = 0
    NO_REPLY = -1
    RESTARTED = -2  # the module lost its power or was reset


@dataclass(frozen=True, slots=True)
class Ready:
    """The module operates. `settings` is None when it already did, and so could not be asked."""

    settings: RadioSettings | None


@dataclass(frozen=True, slots=True)
class Lost:
    """The module does not operate any more, or not yet; it is being brought up again."""

    reason: str


@dataclass(frozen=True, slots=True)
class Sent:
    handle: int


@dataclass(frozen=True, slots=True)
class SendFailed:
    handle: int
    failure: Failure


Event = Ready | Lost | Sent | SendFailed | Heard


@dataclass(slots=True)
class RadioStatistics:
    """Counters since the driver was made."""

    sent: int = 0
    sent_bytes: int = 0
    failed: int = 0
    heard: int = 0
    heard_bytes: int = 0
    dropped_bytes: int = 0  # noise on the serial line
    foreign_packets: int = 0  # of another network
    stray_replies: int = 0
    restarts: int = 0
    bring_ups: int = 0
    dropped_events: int = 0
    airtime_s: float = 0.0


@dataclass(slots=True)
class _Packet:
    handle: int
    payload: bytes
    ahead_at_s: float | None = None  # when all but its last byte was handed over
    deadline_s: float = 0.0  # for the reply
    expected_s: float = 0.0  # when the reply should come

    @property
    def frame(self) -> bytes:
        return bytes((len(self.payload),)) + self.payload


class Es920lrCore:
    def __init__(self, settings: RadioSettings, rule: BandRule, can_reset: bool, now_s: float) -> None:
        """Raises `SettingsError` for settings that the link or the band cannot have."""
        require_usable(settings)
        check(settings, rule, payload_bytes=1)
        self.settings = settings
        self.statistics = RadioStatistics()
        self._can_reset = can_reset
        self._ledger = AirtimeLedger(rule)
        self._parser = OperationParser()
        self._steps: list[Step] = []
        self._events: deque[Event] = deque()
        self._next_handle = 0
        self._sending: _Packet | None = None
        self._next: _Packet | None = None
        self._not_before_s = now_s
        self._attempts = 0
        self._retry_at_s: float | None = None
        self._dialogue: Dialogue[Running] | None = None
        self._open_dialogue(now_s)

    @property
    def operating(self) -> bool:
        return self._dialogue is None and self._retry_at_s is None

    @property
    def busy(self) -> bool:
        """A packet is on its way, or its pause has not passed."""
        return self._sending is not None

    @property
    def can_submit(self) -> bool:
        return self.operating and self._next is None

    def submit(self, payload: bytes, now_s: float) -> int | None:
        """Take a packet: a handle under which its fate is told, or None while there is no room for it.

        Raises `ValueError` for a payload that is empty, too long, or longer in the air than the band allows.
        """
        if not 0 < len(payload) <= MAX_PAYLOAD_BYTES:
            raise ValueError(f"a payload of {len(payload)} bytes; 1 to {MAX_PAYLOAD_BYTES} fit in a packet")
        took_s = airtime_s(self.settings.modulation, len(payload))
        allowed_at_s = self._ledger.allowed_at_s(now_s, took_s)
        if allowed_at_s == math.inf:
            raise ValueError(f"{len(payload)} bytes are {took_s:.2f} s in the air: longer than the band allows")
        if not self.can_submit or allowed_at_s > now_s:
            return None
        self._next_handle += 1
        self._next = _Packet(self._next_handle, bytes(payload))
        self._send_next(now_s)
        return self._next_handle

    def feed(self, data: bytes, now_s: float) -> None:
        """Bytes have come. Call `tick` only when there are no more: a reply may be waiting behind them."""
        if self._dialogue is not None:
            self._talk(self._dialogue, data, now_s)
        else:
            before = self._parser.dropped_bytes
            for utterance in self._parser.feed(data, now_s):
                self._understand(utterance, now_s)
            self.statistics.dropped_bytes += self._parser.dropped_bytes - before

    def tick(self, now_s: float) -> None:
        """Nothing more has come by now."""
        if self._dialogue is None:
            for utterance in self._parser.expire(now_s):
                self._understand(utterance, now_s)
        if self._dialogue is not None:
            self._talk(self._dialogue, b"", now_s)
        elif self._retry_at_s is not None:
            if now_s >= self._retry_at_s:
                self._open_dialogue(now_s)
        else:
            if self._sending is not None and now_s >= self._sending.deadline_s:
                self._lose(now_s, "the module does not answer", Failure.NO_REPLY)
            self._send_next(now_s)

    def next_tick_s(self, now_s: float) -> float:
        """When `tick` is due without any bytes; infinite when nothing is waited for."""
        if self._dialogue is not None:
            return self._dialogue.deadline_s
        due_s = [self._parser.deadline_s]
        if self._retry_at_s is not None:
            due_s.append(self._retry_at_s)
        if self._sending is not None:
            due_s.append(self._sending.deadline_s)
        if self._next is not None:
            due_s.append(self._next_step_s(self._next))
        return max(now_s, min(due_s))

    def take_steps(self) -> list[Step]:
        steps, self._steps = self._steps, []
        return steps

    def take_events(self) -> list[Event]:
        events = list(self._events)
        self._events.clear()
        return events

    def _next_step_s(self, packet: _Packet) -> float:
        if self._sending is not None:
            return self._sending.expected_s - _AHEAD_S if packet.ahead_at_s is None else math.inf
        return self._not_before_s

    def _send_next(self, now_s: float) -> None:
        packet = self._next
        if packet is None or not self.operating:
            return
        if self._sending is not None:
            self._hand_over_ahead(packet, self._sending, now_s)
            return
        if packet.ahead_at_s is not None and now_s - packet.ahead_at_s >= _STILL_KEPT_S:
            self._not_before_s = max(self._not_before_s, packet.ahead_at_s + _SURELY_FORGOTTEN_S)
            packet.ahead_at_s = None
        if now_s < self._not_before_s:
            return
        self._write(packet.frame if packet.ahead_at_s is None else packet.frame[-1:])
        self._begin(packet, now_s)

    def _hand_over_ahead(self, packet: _Packet, sending: _Packet, now_s: float) -> None:
        if packet.ahead_at_s is None and sending.expected_s - _AHEAD_S <= now_s < sending.expected_s:
            self._write(packet.frame[:-1])
            packet.ahead_at_s = now_s

    def _begin(self, packet: _Packet, now_s: float) -> None:
        modulation, length = self.settings.modulation, len(packet.payload)
        took_s = airtime_s(modulation, length)
        attempts = 1
        one_s = took_s + PAUSE_S
        if self.settings.acknowledge and self.settings.destination_id != BROADCAST_ID:
            attempts += self.settings.retries
            one_s = took_s + max(ack_timeout_s(modulation), PAUSE_S)
        sense_s = longest_carrier_sense_s(self.settings.bandwidth_hz)
        line_s = 10.0 * (length + 10) / self.settings.baud_rate
        packet.expected_s = now_s + line_s + took_s + PAUSE_S
        packet.deadline_s = now_s + line_s + attempts * (sense_s + one_s) + _MARGIN_S
        self._ledger.add(now_s, took_s)
        self.statistics.airtime_s = self._ledger.total_s
        self._sending, self._next = packet, None

    def _understand(self, utterance: Utterance, now_s: float) -> None:
        match utterance:
            case Heard():
                self._hear(utterance)
            case Reply():
                self._reply(utterance, now_s)
            case Started():
                self._restarted(now_s)
                self._tell(Ready(None))
            case AsksForMode():
                self._restarted(now_s)
                self._open(Dialogue(restart(self.settings), now_s), now_s)

    def _hear(self, heard: Heard) -> None:
        if heard.pan_id != self.settings.pan_id:
            self.statistics.foreign_packets += 1
            return
        self.statistics.heard += 1
        self.statistics.heard_bytes += len(heard.payload)
        self._tell(heard)

    def _reply(self, reply: Reply, now_s: float) -> None:
        packet, self._sending = self._sending, None
        if packet is None:
            self.statistics.stray_replies += 1
            return
        if reply.refusal is None:
            self.statistics.sent += 1
            self.statistics.sent_bytes += len(packet.payload)
            self._tell(Sent(packet.handle))
        else:
            known = {failure.value: failure for failure in Failure}
            failure = known.get(reply.refusal, Failure.UNKNOWN)
            if failure is Failure.BUSY:
                self._not_before_s = now_s + _STEADY_REPLY_S
            self._fail(packet, failure)
        self._send_next(now_s)

    def _restarted(self, now_s: float) -> None:
        self.statistics.restarts += 1
        if self.operating:
            self._tell(Lost("the module has restarted"))
        self._retry_at_s = None
        self._attempts = 0
        self._fail_all(Failure.RESTARTED)
        self._not_before_s = now_s

    def _lose(self, now_s: float, reason: str, failure: Failure) -> None:
        _log.warning("%s; it is brought up again", reason)
        self._fail_all(failure)
        self._tell(Lost(reason))
        self._open_dialogue(now_s)

    def _fail_all(self, failure: Failure) -> None:
        for packet in (self._sending, self._next):
            if packet is not None:
                self._fail(packet, failure)
        self._sending = self._next = None

    def _fail(self, packet: _Packet, failure: Failure) -> None:
        self.statistics.failed += 1
        self._tell(SendFailed(packet.handle, failure))

    def _open_dialogue(self, now_s: float) -> None:
        self._open(Dialogue(bring_up(self.settings, self._can_reset), now_s), now_s)

    def _open(self, dialogue: Dialogue[Running], now_s: float) -> None:
        self._retry_at_s = None
        self._parser.clear()
        self._dialogue = dialogue
        self.statistics.bring_ups += 1
        self._talk(dialogue, b"", now_s)

    def _talk(self, dialogue: Dialogue[Running], data: bytes, now_s: float) -> None:
        try:
            if data:
                dialogue.feed(data, now_s)
            else:
                dialogue.tick(now_s)
        except DialogueError as error:
            self._dialogue = None
            self._retry_at_s = now_s + _BACK_OFF_S[min(self._attempts, len(_BACK_OFF_S) - 1)]
            if self._attempts == 0:
                _log.error("the module cannot be brought up: %s", error)
                self._tell(Lost(str(error)))
            self._attempts += 1
            return
        finally:
            self._steps += dialogue.steps
            dialogue.steps = []
        if dialogue.finished:
            self._dialogue = None
            self._attempts = 0
            self._not_before_s = now_s
            self._tell(Ready(dialogue.result.settings))

    def _write(self, data: bytes) -> None:
        self._steps.append(Ask(data, Wait.QUIET, 0.0))

    def _tell(self, event: Event) -> None:
        if len(self._events) == _MOST_EVENTS:
            self._events.popleft()
            self.statistics.dropped_events += 1
        self._events.append(event)
