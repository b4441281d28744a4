"""The robot's side of the conversation: answers commands, reports what it sees.

Observations are pulled when the link has room: the newest is sent, older ones are never queued behind a slow radio.
"""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Callable

from shared.link.base import Link, LinkError
from shared.messages import (
    Ack,
    Command,
    EmergencyStop,
    Heartbeat,
    Hello,
    NumberedCommand,
    Observation,
    Refusal,
    Stop,
    Telemetry,
)
from shared.protocol.codec import Decoder, encode

_log = logging.getLogger(__name__)
_REMEMBERED = 64  # commands whose answer is known, for repeats
_COMMANDS_PER_TICK = 32
_HELLO_EVERY_S = 2.0
_NUMBER_JUMP = 100_000  # five heartbeats a second for five hours of silence

Handler = Callable[[Command], tuple[bool, str]]


# What a second station gets to hear from the link.
BUSY = encode(Refusal("another station is connected to it"))


class Uplink:
    """Joins the app to a link; the link may come and go."""

    def __init__(self, link: Link, hello: Hello) -> None:
        self._link = link
        self._hello = hello
        self._decoder = Decoder()
        self._answers: OrderedDict[int, Ack] = OrderedDict()
        self._hello_s = float("-inf")
        self._was_connected = False
        self._last_number: int | None = None
        self._stop_number: int | None = None
        self.observations_skipped = 0

    def receive(self, handle: Handler, heard: Callable[[], None], changed_hands: Callable[[], None]) -> None:
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
                heard()
                self._answer(message, handle)

    def greet(self, now_s: float) -> None:
        """Say hello at once on a new connection and every two seconds after."""
        connected = self._link.connected
        if connected and (not self._was_connected or now_s - self._hello_s >= _HELLO_EVERY_S):
            self._hello_s = now_s
            self._send(self._hello)
        if connected != self._was_connected:
            _log.info("station %s", "connected" if connected else "gone")
        self._was_connected = connected

    def report(self, telemetry: Telemetry) -> None:
        self._send(telemetry)

    def observe(self, observation: Observation) -> bool:
        """Send an observation; False when the link had no room or no peer."""
        sent = self._send(observation)
        self.observations_skipped += not sent
        return sent

    def _note_station(self, number: int, changed_hands: Callable[[], None]) -> None:
        last, self._last_number = self._last_number, number
        if last is None:
            return
        step = (number - last) & 0xFFFF_FFFF
        if min(step, (1 << 32) - step) > _NUMBER_JUMP:
            self._stop_number = None  # its numbers have nothing to do with the last station's
            changed_hands()

    def _answer(self, message: NumberedCommand, handle: Handler) -> None:
        if isinstance(message.command, Heartbeat):
            return
        known = self._answers.get(message.number)
        if known is None or isinstance(message.command, EmergencyStop):
            known = self._carry_out(message, handle)
            self._answers[message.number] = known
            if len(self._answers) > _REMEMBERED:
                self._answers.popitem(last=False)
        self._send(known)

    def _carry_out(self, message: NumberedCommand, handle: Handler) -> Ack:
        """An order that was given before a stop and comes after it is not carried out."""
        if isinstance(message.command, Stop | EmergencyStop):
            self._stop_number = message.number
        elif self._stop_number is not None and (self._stop_number - message.number) & 0xFFFF_FFFF < _NUMBER_JUMP:
            return Ack(message.number, False, "it is older than the last stop")
        accepted, reason = handle(message.command)
        return Ack(message.number, accepted, reason)

    def _receive(self) -> bytes | None:
        try:
            return self._link.receive(0.0)
        except LinkError:
            return None

    def _send(self, message: Ack | Hello | Observation | Telemetry) -> bool:
        try:
            return self._link.connected and self._link.send(encode(message))
        except LinkError:
            return False
