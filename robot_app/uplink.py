"""The robot's side of the conversation: answers commands, reports what it sees.

Observations are pulled when the link has room: the newest is sent, older ones are never queued behind a slow radio.
Over LoRa they are compact, and of the telemetry a pulse goes once a second; what changes in it goes whole, at once.
"""

from __future__ import annotations

import logging
import math
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import fields

from robot_app.budget import Budget
from robot_app.vitals import brief
from shared.link.base import ForRadio, Lane, Link, LinkError, LinkPath
from shared.messages import (
    Ack,
    Command,
    Drive,
    EmergencyStop,
    Heartbeat,
    Hello,
    KeyframeWanted,
    NumberedCommand,
    Observation,
    Pulse,
    Refusal,
    Stop,
    Telemetry,
    Vitals,
)
from shared.protocol.codec import Decoder, encode
from shared.protocol.compact.warm_up import warm_up
from shared.protocol.observations import EncodedObservation, ObservationEncoder

_log = logging.getLogger(__name__)
_REMEMBERED = 64  # commands whose answer is known, for repeats
_COMMANDS_PER_TICK = 32
_HELLO_EVERY_S = 2.0  # where a datagram may be dropped …
_HELLO_AGAIN_S = 30.0  # … and where nothing is lost
_PULSE_S = 1.0  # over LoRa
_WHOLE_TELEMETRY_S = 10.0  # the same
_VITALS_S, _VITALS_RADIO_S, _VITALS_SLOT = 2.0, 30.0, 1
_KEYFRAME_S = 1.0  # who wants one again so soon has not got the last one yet
_WANTED_HZ = 8.0  # of observations over LoRa: detail gives way before it
_LONG_SILENCE_S = 5.0  # what was ordered before it may have lain in the link, and is not expected any more
_NUMBER_JUMP = 100_000  # five heartbeats a second for five hours of silence

Handler = Callable[[Command], tuple[bool, str]]


# What a second station gets to hear from the link.
BUSY = encode(Refusal("another station is connected to it"))


class Uplink:
    """Joins the app to a link; the link may come and go."""

    def __init__(self, link: Link, hello: Hello, steadied: Callable[[Observation], Observation]) -> None:
        """`steadied` as of `ObservationEncoder`; it is asked for what may go over LoRa."""
        self._link = link
        self._hello = hello
        self._decoder = Decoder()
        self._answers: OrderedDict[int, Ack] = OrderedDict()
        self._hello_s = float("-inf")
        self._was_connected = False
        self._last_number: int | None = None
        self._stop_number: int | None = None
        self._order_number: int | None = None
        self._silence_number: int | None = None  # of the first heartbeat after a long silence
        self._awaits_heartbeat = False
        self._word_s = math.nan
        self._has_radio = link.health.lora is not None
        self._encoder = ObservationEncoder(steadied)
        self._budget = Budget(_WANTED_HZ)
        self._resets = link.resets
        self._keyframe_s = -math.inf
        self._wants_keyframe = False
        self._told: tuple[object, ...] = ()
        self._told_s = self._pulse_s = -math.inf
        self._vitals_s = -math.inf
        self._told_throttling: tuple[str, ...] = ()
        self.observations_skipped = 0

    def warm_up(self) -> None:
        """Compile what the first observation needs."""
        if self._has_radio:
            warm_up()

    @property
    def path(self) -> LinkPath:
        return self._link.path

    @property
    def has_room(self) -> bool:
        """An observation that is sent now goes at once."""
        return self._link.has_room

    def receive(
        self, now_s: float, handle: Handler, heard: Callable[[], None], changed_hands: Callable[[], None]
    ) -> None:
        """Take all commands that have come; a repeated one is answered again and not carried out again.

        A station numbers its commands one by one from a random first one: a jump tells of another station, or of the
        same one started again, and `changed_hands` is called before its first command.
        """
        for _ in range(_COMMANDS_PER_TICK):
            datagram = self._receive()
            if datagram is None:
                return
            message = self._decoder.decode(datagram)
            if isinstance(message, NumberedCommand):
                self._note_station(message.number, changed_hands)
                self._note_silence(message, now_s)
                heard()
                self._answer(message, handle)
            elif isinstance(message, KeyframeWanted):
                self._wants_keyframe = True

    def greet(self, now_s: float) -> None:
        """Say hello at once on a new connection and now and then after."""
        connected = self._link.connected
        every_s = _HELLO_AGAIN_S if self._link.mends_itself else _HELLO_EVERY_S
        is_new = not self._was_connected or self._resets != self._link.resets
        if connected and (is_new or now_s - self._hello_s >= every_s):
            if is_new:
                self._resets = self._link.resets
                self._told, self._wants_keyframe, self._keyframe_s = (), True, -math.inf
            self._hello_s = now_s
            self._send(encode(self._hello), Lane.COMMAND)
        if connected != self._was_connected:
            _log.info("station %s", "connected" if connected else "gone")
        self._was_connected = connected

    def report(self, telemetry: Telemetry) -> None:
        now_s, whole = telemetry.stamp_s, encode(telemetry)
        if not self._link.mends_itself:
            self._send(whole, Lane.NEWEST)
            return
        news = (telemetry.state, telemetry.stop_reason, telemetry.following_goal, telemetry.faults)
        slow = self._link.path is LinkPath.RADIO
        due = news != self._told or (slow and now_s - self._told_s >= _WHOLE_TELEMETRY_S)
        if due and self._send(whole, Lane.COMMAND):
            self._told, self._told_s = news, now_s
        if now_s - self._pulse_s >= _PULSE_S:
            self._pulse_s = now_s
            self._send(whole, Lane.NEWEST, for_radio=lambda: encode(_pulse_of(telemetry)))
        elif not slow:
            self._send(whole, Lane.NEWEST)

    def wants_vitals(self, now_s: float, throttling: tuple[str, ...]) -> bool:
        """Every two seconds over Wi-Fi; over LoRa every half minute, and when the processor is held back or let go."""
        slow = self._link.mends_itself and self._link.path is LinkPath.RADIO
        every_s = _VITALS_RADIO_S if slow and throttling == self._told_throttling else _VITALS_S
        return self._link.connected and now_s - self._vitals_s >= every_s

    def report_vitals(self, vitals: Vitals) -> None:
        if self._send(encode(vitals), Lane.NEWEST, lambda: encode(brief(vitals)), _VITALS_SLOT):
            self._vitals_s, self._told_throttling = vitals.stamp_s, vitals.throttling

    def observe(self, observation: Observation, now_s: float, waited: bool = False) -> bool:
        """Send an observation; False when the link had no room or no peer. `waited`: there was none a moment ago."""
        if not self._has_radio:
            sent = self._send(encode(observation), Lane.BULK)
        elif not self._link.has_room:
            sent = False
        else:
            sent = self._observe_compactly(observation, now_s, waited)
        self.observations_skipped += not sent
        return sent

    def _observe_compactly(self, observation: Observation, now_s: float, waited: bool) -> bool:
        if self._wants_keyframe and now_s - self._keyframe_s >= _KEYFRAME_S:
            self._wants_keyframe = False
            self._encoder.reset()
        slow = self._link.path is LinkPath.RADIO
        encoded = self._encoder.encode(observation, self._budget.most_bytes if slow else None)
        if encoded.keyframe:
            self._keyframe_s = now_s
        if not self._send(encoded.full, Lane.BULK, for_radio=_for_radio(encoded)):
            self._encoder.reset()
            return False
        if slow:
            self._budget.sent(now_s, len(encoded.compact or encoded.full), waited)
        return True

    def _note_station(self, number: int, changed_hands: Callable[[], None]) -> None:
        last, self._last_number = self._last_number, number
        if last is None:
            return
        step = (number - last) & 0xFFFF_FFFF
        if min(step, (1 << 32) - step) > _NUMBER_JUMP:
            # Its numbers have nothing to do with the last station's.
            self._order_number = self._stop_number = self._silence_number = None
            self._awaits_heartbeat, self._word_s = False, math.nan
            changed_hands()

    def _note_silence(self, message: NumberedCommand, now_s: float) -> None:
        """A link that mends itself keeps commands; a heartbeat is never kept, so what is older than one is old."""
        self._awaits_heartbeat |= now_s - self._word_s > _LONG_SILENCE_S
        self._word_s = now_s
        if self._awaits_heartbeat and isinstance(message.command, Heartbeat):
            self._awaits_heartbeat, self._silence_number = False, message.number

    def _answer(self, message: NumberedCommand, handle: Handler) -> None:
        if isinstance(message.command, Heartbeat):
            return
        known = self._answers.get(message.number)
        if known is None or isinstance(message.command, EmergencyStop):
            known = self._carry_out(message, handle)
            self._answers[message.number] = known
            if len(self._answers) > _REMEMBERED:
                self._answers.popitem(last=False)
        self._send(encode(known), Lane.COMMAND)

    def _carry_out(self, message: NumberedCommand, handle: Handler) -> Ack:
        """An order that was given before a stop and comes after it is not carried out."""
        number = message.number
        if isinstance(message.command, Stop | EmergencyStop):
            self._stop_number = _later(number, self._stop_number)
        elif _is_before(number, self._stop_number):
            return Ack(number, False, "it is older than the last stop")
        elif self._awaits_heartbeat or _is_before(number, self._silence_number):
            return Ack(number, False, "it was given before the link was lost")
        elif isinstance(message.command, Drive) and _is_before(number, self._order_number):
            return Ack(number, False, "it is older than the last order")
        self._order_number = _later(number, self._order_number)
        accepted, reason = handle(message.command)
        return Ack(message.number, accepted, reason)

    def _receive(self) -> bytes | None:
        try:
            return self._link.receive(0.0)
        except LinkError:
            return None

    def _send(self, datagram: bytes, lane: Lane, for_radio: ForRadio | None = None, slot: int = 0) -> bool:
        try:
            return self._link.connected and self._link.send(datagram, lane, slot, for_radio)
        except LinkError:
            return False


def _is_before(number: int, other: int | None) -> bool:
    """Whether a command was given before another one of the same station."""
    return other is not None and (other - number) & 0xFFFF_FFFF < _NUMBER_JUMP


def _later(number: int, other: int | None) -> int:
    return other if other is not None and _is_before(number, other) else number


def _for_radio(encoded: EncodedObservation) -> ForRadio | None:
    compact = encoded.compact
    return None if compact is None else lambda: compact


def _pulse_of(telemetry: Telemetry) -> Pulse:
    return Pulse(**{f.name: getattr(telemetry, f.name) for f in fields(Pulse)})
