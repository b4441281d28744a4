"""The station's side of the conversation: keeps a link up, sends commands until they are answered, passes reports on.

Nothing here is a thread: `step()` is called by one, at 50 Hz or so; everything else may be called from any.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from shared.link.base import Lane, Link, LinkError, LinkHealth, LinkPath
from shared.link.pairing import PairingError
from shared.messages import (
    Ack,
    Command,
    Drive,
    EmergencyStop,
    Heartbeat,
    KeyframeWanted,
    NumberedCommand,
    Refusal,
    Report,
    Stop,
)
from shared.protocol.codec import encode
from shared.protocol.observations import MessageDecoder, Received
from shared.protocol.wire import VERSION
from shared.runtime.clock import Clock
from station_gui.comms.commands import HEARTBEAT_SLOT, KEYFRAME_SLOT, Pending, datagram_of, send
from station_gui.comms.radio_watch import RadioWatch
from station_gui.comms.state import LinkState, Severity


@dataclass(frozen=True, slots=True)
class SessionConfig:
    connect_timeout_s: float = 3.0
    heartbeat_s: float = 0.2  # the robot stands after a second without one
    retry_s: float = 0.4
    tries: int = 5
    silence_s: float = 2.0  # without a word for so long the link counts as lost …
    silence_radio_s: float = 4.0  # … and so long over LoRa, where the least that comes is a pulse a second
    retry_radio_s: float = 2.0  # LoRa repeats what was lost by itself
    reconnect_first_s: float = 0.5  # and doubles with each failure …
    reconnect_last_s: float = 4.0  # … up to this

    def __post_init__(self) -> None:
        times_s = (self.heartbeat_s, self.retry_s, self.retry_radio_s, self.silence_s, self.reconnect_first_s)
        if self.tries < 1 or min(times_s) <= 0:
            raise ValueError(
                "tries, heartbeat_s, retry_s, retry_radio_s, silence_s, reconnect_first_s must be positive"
            )
        if self.silence_radio_s < self.silence_s:
            raise ValueError("silence_radio_s must not be below silence_s")


class Listener(Protocol):
    """Who hears what comes in; called in the thread of `step()`."""

    def on_datagram(self, received: Received, size: int) -> None:
        """Whatever could be decoded; `size` is that of the datagram as it came."""
        ...

    def on_report(self, report: Report) -> None: ...
    def on_event(self, severity: Severity, text: str) -> None: ...


Connect = Callable[[], Link]
_MAX_PENDING = 32
_NEW_HANDS = 1 << 20  # a jump of the numbers by which the robot knows another station
_DATAGRAMS_PER_STEP = 256
_KEYFRAME_AGAIN_S = 2.0
_NEVER_HEARD = (
    ". Is it on, with the same pairing file, and does link.use of its robot.toml name what is chosen here? "
    "Over LoRa: are the radios at these ports, bandwidth, spreading factor, channels and pan_id the same, "
    "and the ids the other way round (`radio-config check`)?"
)
_NEVER_HEARD_OPEN = ". Has the robot a pairing file? Then name the same in pairing of station.toml"
_AGAIN, _MEND = "Trying again until it works.", "Mend that: it connects by itself then."


class Session:
    """One robot, one link at a time."""

    def __init__(
        self,
        config: SessionConfig,
        clock: Clock,
        listener: Listener,
        first_number: int,
        operator_is_there: Callable[[], bool] = lambda: True,
    ) -> None:
        self._config = config
        self._clock = clock
        self._listener = listener
        self._numbers = itertools.count(first_number)
        self._lock = threading.Lock()
        self._operator_is_there = operator_is_there
        self._connect: Connect | None = None
        self._link: Link | None = None
        self._generation = 0  # grows with every connect() and disconnect()
        self._link_generation = 0
        self._state = LinkState.DISCONNECTED
        self._pending: list[Pending] = []  # in the order in which they are sent; under the lock
        self._decoder = MessageDecoder(compact=False)
        self._keyframe_wanted_s = -math.inf
        self._radios = RadioWatch()
        self._heard_s = 0.0
        self._heartbeat_s = -math.inf
        self._next_try_s = -math.inf
        self._back_off_s = config.reconnect_first_s
        self._told_version = False
        self._problem = ""  # a fault is told when it begins
        self.round_trip_s = math.nan

    @property
    def state(self) -> LinkState:
        return self._state

    @property
    def problem(self) -> str:
        """What has kept the two from coming together so far; empty when there is nothing to tell."""
        if self._state is not LinkState.CONNECTING:
            return ""
        faults = (radio.fault for radio in self.link_health.radios)
        return "; ".join(fault for fault in faults if fault) or self._problem

    @property
    def link_health(self) -> LinkHealth:
        """What the link tells of itself; nothing while there is none."""
        link = self._link
        return link.health if link is not None else LinkHealth()

    @property
    def path(self) -> LinkPath | None:
        """What the observations come over; None while nothing does."""
        link = self._link
        return link.path if link is not None and self._state is LinkState.CONNECTED else None

    def connect(self, connect: Connect) -> None:
        """Use `connect` to make the link, now and whenever it is lost.

        To the robot this is another station: what was running there ends, and waits for a new start.
        """
        with self._lock:
            self._connect = connect
            self._generation += 1
            self._numbers = itertools.count(next(self._numbers) + _NEW_HANDS)
            self._keep_stops_only()
            self._next_try_s = -math.inf
            self._back_off_s = self._config.reconnect_first_s
            self._state = LinkState.CONNECTING
            self._problem = ""

    def disconnect(self) -> None:
        """Let the link go. A stop that was not answered waits for the next connection."""
        with self._lock:
            self._connect = None
            self._generation += 1
            self._keep_stops_only()
            unanswered = bool(self._pending)
            self._state = LinkState.DISCONNECTED
        if unanswered:
            self._listener.on_event(
                Severity.ERROR, "the robot has not confirmed the stop; it stands without a heartbeat"
            )

    def _keep_stops_only(self) -> None:
        self._pending = [p for p in self._pending if p.is_stop]

    def send(self, command: Command) -> bool:
        """Queue a command; False when there is no connection. Raises `ValueError` for one that cannot be sent.

        A stop takes the place of everything that waits, and waits itself for a link that is lost.
        """
        with self._lock:
            is_stop = isinstance(command, Stop | EmergencyStop)
            if self._state is not LinkState.CONNECTED and not (is_stop and self._connect is not None):
                return False
            if isinstance(command, Stop) and any(isinstance(p.command, EmergencyStop) for p in self._pending):
                return True  # the stronger one is on its way
            number = self._next_number()
            pending = Pending(number, command, datagram_of(number, command))
            if isinstance(command, Drive):  # only the newest counts
                self._pending = [p for p in self._pending if not isinstance(p.command, Drive)]
            if is_stop:
                self._pending.clear()
            elif len(self._pending) >= _MAX_PENDING:
                return False
            self._pending.append(pending)
            return True

    def step(self) -> None:
        """Do what is due: connect, receive, answer the clock."""
        self._drop_old_link()
        if self._link is None:
            self._try_to_connect()
        link = self._link
        if link is None:
            return
        try:
            self._receive(link)
            self._send_due(link)
            self._check_silence(link)
        except LinkError as error:
            self._lost(error)
        self._tell_changes(link)

    def _tell_changes(self, link: Link) -> None:
        """Of the path, and of our radios."""
        while link.events:
            self._listener.on_event(Severity.INFO, link.events.popleft().reason)
        for severity, text in self._radios.news(link, self._clock.now_s()):
            self._listener.on_event(severity, text)

    def close(self) -> None:
        """Let go of the link; the session may be used again."""
        self.disconnect()
        self._drop_old_link()

    def _drop_old_link(self) -> None:
        if self._link is not None and self._link_generation != self._generation:
            link, self._link = self._link, None
            link.close()

    def _try_to_connect(self) -> None:
        now_s = self._clock.now_s()
        with self._lock:
            connect, generation = self._connect, self._generation
        if connect is None or now_s < self._next_try_s:
            return
        try:
            link = connect()
        except LinkError as error:
            self._next_try_s = self._clock.now_s() + self._back_off_s
            self._back_off_s = min(2 * self._back_off_s, self._config.reconnect_last_s)
            if generation == self._generation:
                self._tell_once(error)
            return
        self._adopt(link, generation)

    def _tell_once(self, error: LinkError) -> None:
        reason = str(error)
        if reason == self._problem:
            return
        self._problem = reason
        then = _MEND if isinstance(error, PairingError) else _AGAIN
        self._listener.on_event(Severity.ERROR, f"{reason}{'' if reason.endswith(('.', '?')) else '.'} {then}")

    def _adopt(self, link: Link, generation: int) -> None:
        with self._lock:
            is_wanted = generation == self._generation  # or the operator has changed his mind meanwhile
            if is_wanted:
                self._link, self._link_generation = link, generation
        if not is_wanted:
            link.close()  # it takes a while: nobody waits for it
            return
        self._heard_s = self._clock.now_s()
        self._heartbeat_s = -math.inf
        self._told_version = False
        self._decoder = MessageDecoder(compact=link.health.is_secret)
        self._radios = RadioWatch()

    def _receive(self, link: Link) -> None:
        for _ in range(_DATAGRAMS_PER_STEP):
            datagram = link.receive(0.0)
            if datagram is None:
                return
            received = self._decoder.decode(datagram)
            message = received.message if received is not None else None
            if received is not None:
                self._listener.on_datagram(received, len(datagram))
            if isinstance(message, Refusal):
                raise LinkError(f"the robot refuses: {message.reason}")
            if message is not None:
                self._heard()
            if isinstance(message, Ack):
                self._acknowledged(message)
            elif message is not None and not isinstance(message, NumberedCommand | KeyframeWanted):
                self._listener.on_report(message)
            elif message is None and self._damaged() == 1:
                self._listener.on_event(
                    Severity.WARNING, "a damaged message came and was dropped; more are only counted"
                )
            elif self._decoder.counts.other_version and not self._told_version:
                self._told_version = True
                self._listener.on_event(
                    Severity.ERROR,
                    f"the robot speaks protocol version {self._decoder.counts.other_version_seen}, "
                    f"this station {VERSION}: update the older one",
                )

    def _heard(self) -> None:
        """A robot has spoken: only now the link counts as connected."""
        self._heard_s = self._clock.now_s()
        self._back_off_s = self._config.reconnect_first_s
        with self._lock:
            if self._link_generation != self._generation:  # the operator has let this link go meanwhile
                return
            connected, self._state = self._state is LinkState.CONNECTED, LinkState.CONNECTED
        if not connected:
            self._problem = ""
            self._listener.on_event(Severity.INFO, "connected")

    def _damaged(self) -> int:
        return self._decoder.counts.damaged + self._decoder.counts.malformed

    def _acknowledged(self, ack: Ack) -> None:
        with self._lock:
            pending = next((p for p in self._pending if p.number == ack.command), None)
            if pending is None:
                return
            self._pending.remove(pending)
        self.round_trip_s = self._clock.now_s() - pending.sent_s
        name = type(pending.command).__name__
        if not ack.accepted:
            self._listener.on_event(Severity.WARNING, f"the robot refused {name}: {ack.reason}")

    def _send_due(self, link: Link) -> None:
        now_s = self._clock.now_s()
        with self._lock:
            connected = self._state is LinkState.CONNECTED
            waiting = [p for p in self._pending if connected or p.is_stop]
        for pending in waiting:
            retry_s = self._config.retry_radio_s if link.path is LinkPath.RADIO else self._config.retry_s
            if now_s - pending.sent_s >= retry_s:
                self._send_or_give_up(link, pending, now_s)
        # No heartbeat while a stop waits for its answer, or nobody looks: then the robot stands by itself.
        may_live = connected and self._operator_is_there() and not any(p.is_stop for p in waiting)
        if may_live and now_s - self._heartbeat_s >= self._config.heartbeat_s:
            self._heartbeat_s = now_s
            link.send(datagram_of(self._next_number(), Heartbeat()), Lane.NEWEST, HEARTBEAT_SLOT)
        if self._decoder.wants_keyframe and now_s - self._keyframe_wanted_s >= _KEYFRAME_AGAIN_S:
            self._keyframe_wanted_s = now_s
            link.send(encode(KeyframeWanted()), Lane.NEWEST, KEYFRAME_SLOT)

    def _send_or_give_up(self, link: Link, pending: Pending, now_s: float) -> None:
        if pending.tries >= self._config.tries and not pending.is_stop:
            with self._lock:
                if pending in self._pending:
                    self._pending.remove(pending)
            name = type(pending.command).__name__
            self._listener.on_event(Severity.ERROR, f"{name} was not answered after {pending.tries} tries")
        elif send(link, pending):
            pending.sent_s = now_s
            pending.tries += 1

    def _next_number(self) -> int:
        return next(self._numbers) & 0xFFFF_FFFF

    def _check_silence(self, link: Link) -> None:
        if link.mends_itself and self._state is LinkState.LOST:
            return
        silent_s = self._clock.now_s() - self._heard_s
        slow = link.path is LinkPath.RADIO
        longest_s = self._config.silence_radio_s if slow else self._config.silence_s
        if silent_s > longest_s:
            hint = ""
            if self._state is LinkState.CONNECTING:
                hint = _NEVER_HEARD if link.mends_itself else "" if link.health.is_secret else _NEVER_HEARD_OPEN
            raise LinkError(f"no word from the robot for {longest_s:g} s{hint}")

    def _lost(self, error: LinkError) -> None:
        link = self._link
        if link is not None and not link.mends_itself:
            self._link = None
            link.close()
        with self._lock:
            if self._link_generation != self._generation:
                return
            was_connected = self._state is LinkState.CONNECTED
            unanswered = [type(p.command).__name__ for p in self._pending if not p.is_stop]
            self._keep_stops_only()  # they are sent first when the link is back
            if self._connect is None:
                return
            self._state = LinkState.LOST if was_connected else self._state
            self._next_try_s = self._clock.now_s() + self._back_off_s
            self._back_off_s = min(2 * self._back_off_s, self._config.reconnect_last_s)
        if not was_connected:
            self._tell_once(error)
            return
        tail = f"; not answered: {', '.join(unanswered)}" if unanswered else ""
        self._listener.on_event(
            Severity.ERROR, f"link lost: {error}{tail}. The robot stands until the link is back; reconnecting."
        )
