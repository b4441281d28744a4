"""Whose turn it is, sans-I/O: the robot's side asks, the station's side answers.

A module is deaf while it sends and for 50 ms after. So the robot sends without a pause on one radio, which never
listens, and on the other one a packet now and then says "it is your turn"; the robot is silent on that radio until the
answer has come, or can come no more. The answer has the acknowledgements of both radios. When one radio fails, the
other does both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from shared.link.radio_pair.config import PairConfig, Timing
from shared.link.radio_pair.conversation import Conversation, Heard, Packet
from shared.link.radio_pair.lanes import Fate

_UNHEARD_S = 0.01  # so much later than the latest usual a question is answered that was announced and not heard
_SERIAL_JITTER_S = 0.02  # by so much the OKs of two radios may be apart from what happened in the air


@dataclass(slots=True)
class TurnStatistics:
    """Counters since the link was made."""

    turns: int = 0
    lost_turns: int = 0
    calls: int = 0
    round_trip_s: float = math.nan  # of the last turn: from the end of the question's pause to the answer


class Turns(Protocol):
    """What the driver of a radio asks, and tells."""

    statistics: TurnStatistics

    def set_up(self, radio: int, is_up: bool, now_s: float) -> None: ...

    def next_packet(self, radio: int, now_s: float) -> Packet | None:
        """What the radio is to send; it is asked when there is room for one more."""
        ...

    def due_s(self, radio: int, now_s: float) -> float:
        """When `next_packet` may have another answer although nothing has happened."""
        ...

    def sent(self, radio: int, packet: Packet, now_s: float) -> None: ...

    def failed(self, radio: int, packet: Packet, now_s: float) -> None: ...

    def heard(self, radio: int, data: bytes, now_s: float) -> bool:
        """A packet came in; False when it is not the other side's."""
        ...


@dataclass(slots=True)
class _Asking:
    """The robot's radio."""

    is_up: bool = False
    question: Packet | None = None  # out, or about to be
    deadline_s: float = math.inf  # for its answer
    question_sent_s: float = math.inf
    not_before_s: float = 0.0
    has_announced: bool = False  # that the next packet is a question
    answers: int = 0  # to it, so far
    unanswered: int = 0
    losses: int = 0  # one after the other
    arrived_s: float = -math.inf  # when what is known to have arrived had left
    probe_at_s: float | None = None  # it is suspect, and tried again then


class AskingTurns:
    """The robot's side: decides who speaks."""

    def __init__(self, conversation: Conversation, timing: Timing, config: PairConfig, radios: int) -> None:
        self.statistics = TurnStatistics()
        self._conversation = conversation
        self._timing = timing
        self._config = config
        self._radios = [_Asking() for _ in range(radios)]
        self._turn_radio = radios - 1
        self._answered_s = 0.0
        self._retry_s = -math.inf
        self._call_s = -math.inf
        self._called_last = -1
        self._unanswered = 0  # on all radios
        self._station_has_more = False

    def set_up(self, radio: int, is_up: bool, now_s: float) -> None:
        state = self._radios[radio]
        state.is_up = is_up
        state.question, state.deadline_s, state.has_announced = None, math.inf, False
        if not is_up and radio == self._turn_radio:
            self._turn_elsewhere(radio)

    def next_packet(self, radio: int, now_s: float) -> Packet | None:
        state = self._radios[radio]
        self._give_up_late(now_s)
        if not state.is_up or state.question is not None or now_s < state.not_before_s:
            return None
        if not self._conversation.has_session:
            return self._call(radio, state, now_s)
        if state.probe_at_s is not None:
            if now_s < state.probe_at_s:
                return None
            state.probe_at_s = now_s + self._config.probe_s
            return self._ask(state, self._question(radio, probes=True))
        wait_s = self._next_turn_s() - now_s - self._lead_s() if radio == self._turn_radio else math.inf
        if state.has_announced or wait_s <= 0.0:
            state.has_announced = False
            return self._ask(state, self._question(radio))
        packet = self._conversation.next_packet(radio, turn=False, announces=wait_s <= self._timing.slot_s)
        state.has_announced = packet is not None and packet.announces
        return packet

    def due_s(self, radio: int, now_s: float) -> float:
        state = self._radios[radio]
        if not state.is_up:
            return math.inf
        if state.question is not None:
            return state.deadline_s
        due_s = max(state.not_before_s, state.probe_at_s or -math.inf)
        if not self._conversation.has_session:
            return max(due_s, self._call_s + self._config.call_every_s)
        if self._conversation.lanes.has_something or state.probe_at_s is not None:
            return due_s
        return max(due_s, self._next_turn_s()) if radio == self._turn_radio else math.inf

    def _lead_s(self) -> float:
        """A packet is handed over while another is on its way and leaves a slot later, the next one two: the turn
        goes with whichever is nearer to its time."""
        return 1.5 * self._timing.slot_s if self._conversation.lanes.has_something else 0.0

    def _announcing_s(self) -> float:
        """So much later the next question is due than it could be, so that it can be announced: one more that is not
        heard costs about as much time, and the air as well."""
        return 2.0 * self._timing.slot_s if self._conversation.lanes.has_something else 0.0

    def _next_turn_s(self) -> float:
        lanes, config = self._conversation.lanes, self._config
        if lanes.has_something:
            wait_s = config.turn_s
        else:
            wait_s = config.tail_turn_s if lanes.unanswered else config.idle_turn_s
        if not lanes.bulk.sender.has_room or self._station_has_more:
            wait_s = config.retry_turn_s
        return max(self._answered_s + wait_s, self._retry_s)

    def _question(self, radio: int, *, probes: bool = False) -> Packet | None:
        """A packet that is to be answered; after many without an answer every other one is a greeting."""
        if self._unanswered >= self._config.call_after_turns and self._unanswered % 2 == 0:
            self.statistics.calls += 1
            return Packet(self._conversation.call())
        return self._conversation.probe() if probes else self._conversation.next_packet(radio, turn=True)

    def _call(self, radio: int, state: _Asking, now_s: float) -> Packet | None:
        others = any(r.question is not None for r in self._radios)
        only = sum(r.is_up for r in self._radios) == 1
        if others or now_s < self._call_s + self._config.call_every_s or (radio == self._called_last and not only):
            return None
        self._call_s, self._called_last = now_s, radio
        self.statistics.calls += 1
        return self._ask(state, Packet(self._conversation.call()))

    def _ask(self, state: _Asking, packet: Packet | None) -> Packet | None:
        if packet is not None:
            state.question, state.deadline_s, state.question_sent_s = packet, math.inf, math.inf
            state.answers = 0
        return packet

    def sent(self, radio: int, packet: Packet, now_s: float) -> None:
        self._conversation.lanes.left(packet.loads, now_s)
        state = self._radios[radio]
        if state.question is packet:
            self.statistics.turns += 1
            state.question_sent_s = now_s
            state.deadline_s = now_s + self._timing.answer_timeout_s

    def failed(self, radio: int, packet: Packet, now_s: float) -> None:
        self._conversation.lanes.failed(packet.loads)
        state = self._radios[radio]
        if state.question is packet:
            state.question, state.deadline_s = None, math.inf
            self._retry_s = now_s + self._config.retry_turn_s + self._announcing_s()
            self._lose_turn(radio, state, now_s)

    def heard(self, radio: int, data: bytes, now_s: float) -> bool:
        heard = self._conversation.hear(data)
        if heard is None:
            return False
        state = self._radios[radio]
        state.unanswered = state.losses = self._unanswered = 0
        state.probe_at_s = None
        self._count(heard.fates, now_s)
        if state.question is None:
            return True
        state.answers += 1
        if not heard.turn:
            state.deadline_s = now_s + self._timing.pause_s + self._timing.answer_timeout_s
            return True
        self.statistics.round_trip_s = now_s - state.question_sent_s
        if not heard.is_new_session and not heard.is_late:
            self._conversation.lanes.told()
            self._count(self._conversation.lanes.settle(state.question_sent_s - _SERIAL_JITTER_S), now_s)
        self._station_has_more = state.answers >= self._config.most_answers
        state.question, state.deadline_s = None, math.inf
        state.not_before_s = now_s + self._timing.answer_delay_s(len(data))
        self._answered_s = -math.inf if heard.is_new_session else now_s  # what has come meanwhile is asked at once
        return True

    def _count(self, fates: tuple[Fate, ...] | list[Fate], now_s: float) -> None:
        for fate in fates:
            state = self._radios[fate.path]
            left_s = now_s if fate.left_s is None else fate.left_s
            if fate.arrived:
                state.losses, state.probe_at_s = 0, None
                state.arrived_s = max(state.arrived_s, left_s)
            elif left_s > state.arrived_s:
                state.losses += 1
            if state.losses >= self._config.suspect_losses:
                self._suspect(fate.path, now_s)

    def _give_up_late(self, now_s: float) -> None:
        for radio, state in enumerate(self._radios):
            if now_s >= state.deadline_s:
                state.question, state.deadline_s = None, math.inf
                self._retry_s = now_s + self._config.retry_turn_s + self._announcing_s()
                self._lose_turn(radio, state, now_s)

    def _lose_turn(self, radio: int, state: _Asking, now_s: float) -> None:
        self.statistics.lost_turns += 1
        state.unanswered += 1
        self._unanswered += 1
        if radio == self._turn_radio and state.unanswered >= 2:
            self._turn_elsewhere(radio)

    def _suspect(self, radio: int, now_s: float) -> None:
        """Let the others carry all, unless there are no others."""
        others = [r for i, r in enumerate(self._radios) if i != radio and r.is_up and r.probe_at_s is None]
        state = self._radios[radio]
        if others and state.probe_at_s is None:
            state.probe_at_s = now_s + self._config.probe_s
            if radio == self._turn_radio:
                self._turn_elsewhere(radio)

    def _turn_elsewhere(self, radio: int) -> None:
        good = [i for i, r in enumerate(self._radios) if i != radio and r.is_up and r.probe_at_s is None]
        if good:
            self._turn_radio = good[0]


@dataclass(slots=True)
class _Answering:
    """The station's radio."""

    is_up: bool = False
    answer: bytes | None = None
    packets_left: int = 0
    not_before_s: float = 0.0
    until_s: float = -math.inf


class AnsweringTurns:
    """The station's side: speaks when it was asked."""

    def __init__(self, conversation: Conversation, timing: Timing, config: PairConfig, radios: int) -> None:
        self.statistics = TurnStatistics()
        self._conversation = conversation
        self._timing = timing
        self._config = config
        self._radios = [_Answering() for _ in range(radios)]

    def set_up(self, radio: int, is_up: bool, now_s: float) -> None:
        del now_s
        self._radios[radio] = _Answering(is_up=is_up)

    def next_packet(self, radio: int, now_s: float) -> Packet | None:
        state = self._radios[radio]
        if not state.is_up or not state.packets_left or now_s < state.not_before_s:
            return None
        if now_s > state.until_s:  # too late: the robot does not listen any more
            state.packets_left = 0
            return None
        if state.answer is not None:
            packet, state.answer, state.packets_left = Packet(state.answer), None, 0
            return packet
        lanes = self._conversation.lanes
        state.packets_left -= 1
        room_bytes = self._conversation.body_bytes
        is_last = state.packets_left == 0 or (lanes.waiting_bytes <= room_bytes and lanes.resends_fit(room_bytes))
        packet_or_none = self._conversation.next_packet(radio, turn=is_last)
        state.until_s = now_s + self._timing.slot_s + self._timing.answer_timeout_s
        if is_last or packet_or_none is None:
            state.packets_left = 0
        return packet_or_none

    def due_s(self, radio: int, now_s: float) -> float:
        del now_s
        state = self._radios[radio]
        return state.not_before_s if state.is_up and state.packets_left else math.inf

    def sent(self, radio: int, packet: Packet, now_s: float) -> None:
        del radio
        self._conversation.lanes.left(packet.loads, now_s)

    def failed(self, radio: int, packet: Packet, now_s: float) -> None:
        del radio, now_s
        self._conversation.lanes.failed(packet.loads)

    def heard(self, radio: int, data: bytes, now_s: float) -> bool:
        heard: Heard | None = self._conversation.hear(data)
        if heard is None:
            return False
        state = self._radios[radio]
        if heard.turn:
            self._begin_turn(state, heard, len(data), now_s)
        else:
            state.packets_left = self._config.most_answers if heard.announces else 0
            state.not_before_s = now_s + self._timing.slot_s + self._timing.answer_delay_s(len(data)) + _UNHEARD_S
            state.until_s = state.not_before_s + _UNHEARD_S
        return True

    def _begin_turn(self, state: _Answering, heard: Heard, heard_bytes: int, now_s: float) -> None:
        self.statistics.turns += 1
        if heard.answer is None and not heard.is_late:
            self._conversation.lanes.settle(now_s)
        state.answer = heard.answer
        state.packets_left = self._config.most_answers
        state.not_before_s = now_s + self._timing.answer_delay_s(heard_bytes)
        state.until_s = state.not_before_s + self._timing.sense_s + self._timing.answer_timeout_s / 2
