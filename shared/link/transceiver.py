"""The station's LoRa transceiver: an Arduino Mega on USB that carries the bytes of two radios.

One thread owns the port. It finds the Mega again by itself after the plug was pulled or the Mega began anew; the two
radio ports report the loss once, and carry bytes again when it is back.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator

from shared.link.base import LinkError
from shared.link.byte_port import BytePort, PortStatistics
from shared.link.serial_port import SerialPort
from shared.protocol import transceiver as t
from shared.protocol.transceiver_session import (
    Command,
    State,
    TransceiverHealth,
    TransceiverSession,
    describe_fault,
)
from shared.runtime.clock import Clock, wall_clock_ns

_log = logging.getLogger(__name__)
_READ_S = 0.01  # also how late a repetition may be
_REOPEN_S = 0.5
_LOG_FAULT_S = 10.0
_JOIN_S = 3.0
_WRITE_TIMEOUT_S = 1.0  # without room for a single byte
_COMMAND_TIMEOUT_S = 3.0
_RADIO_NAMES = ("radio A", "radio B")

OpenPort = Callable[[], BytePort]


class Transceiver:
    """Opens the Mega and waits until it answers, or raises `LinkError`."""

    def __init__(self, name: str, clock: Clock, start_up_s: float = 8.0, open_port: OpenPort | None = None) -> None:
        """`start_up_s`: opening the port resets a Mega, and its boot loader takes its time."""
        self.name = name
        self._clock = clock
        self._open_port: OpenPort = open_port or (lambda: SerialPort(name, t.USB_BAUD))
        self._changed = threading.Condition()  # guards the session and the order of its output
        self._session = TransceiverSession(wall_clock_ns() // 1_000)
        self._fault_logged_s: dict[tuple[int, int], float] = {}  # at most every kind at every port
        self._stop = threading.Event()
        self._wire: BytePort | None = self._open_port()
        self.radios = tuple(RadioPort(self, radio) for radio in range(t.RADIOS))
        self._thread = threading.Thread(target=self._run, name=f"transceiver {name}", daemon=True)
        self._thread.start()
        if not self._started(start_up_s):
            trouble = self.trouble
            self.close()
            raise LinkError(f"{name}: no transceiver: {trouble}")

    @property
    def is_up(self) -> bool:
        with self._changed:
            return self._session.is_up

    @property
    def trouble(self) -> str:
        """Why it is not up, in words."""
        with self._changed:
            return self._session.trouble

    @property
    def health(self) -> TransceiverHealth:
        """The newest there is; at most a second old while it is up."""
        with self._changed:
            return self._session.health.copy()

    def wait_until_up(self, timeout_s: float) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: self._session.is_up, timeout_s)

    def _started(self, timeout_s: float) -> bool:
        """It is up, or it is clear that it will never be."""
        with self._changed:
            self._changed.wait_for(lambda: self._session.is_up or self._session.state is State.REFUSED, timeout_s)
            return self._session.is_up

    def close(self) -> None:
        """Let go of the port; may be called twice."""
        self._stop.set()
        self._thread.join(_JOIN_S)
        with self._changed:
            self._session.close()
            self._say()
            self._drop_wire()
            self._changed.notify_all()

    # ---- for the radio ports; `changed` is held by `with`

    def generation(self) -> int:
        with self._changed:
            return self._session.generation

    def write(self, radio: int, data: bytes, generation: int) -> None:
        with self._changed:
            until_s = self._clock.now_s() + _WRITE_TIMEOUT_S
            while True:
                self._fail_if_lost(generation)
                if taken := self._session.write(radio, data):
                    until_s = self._clock.now_s() + _WRITE_TIMEOUT_S
                    self._session.tick(self._clock.now_s())
                    self._say()
                data = data[taken:]
                if not data:
                    return
                if not self._changed.wait(max(0.0, until_s - self._clock.now_s())):
                    raise LinkError(f"{self.name} {_RADIO_NAMES[radio]}: takes no bytes")

    def read(self, radio: int, timeout_s: float, generation: int) -> bytes:
        with self._changed:
            self._changed.wait_for(lambda: self._session.has_arrived(radio) or self._is_lost(generation), timeout_s)
            self._fail_if_lost(generation)
            return self._session.read(radio)

    def set_baud(self, radio: int, baud: int, generation: int) -> bool:
        return self._carry_out(lambda session: session.set_baud(radio, baud), generation)

    def reset_radio(self, radio: int, low_ms: int, generation: int) -> bool:
        return self._carry_out(lambda session: session.reset_radio(radio, low_ms), generation)

    def _carry_out(self, begin: Callable[[TransceiverSession], Command], generation: int) -> bool:
        with self._changed:
            self._fail_if_lost(generation)
            command = begin(self._session)
            self._session.tick(self._clock.now_s())
            self._say()
            self._changed.wait_for(lambda: command.finished, _COMMAND_TIMEOUT_S)
            if command.result is None:
                raise LinkError(f"{self.name}: {type(command.frame).__name__} was not carried out")
            return command.result is t.Result.DONE

    def _is_lost(self, generation: int) -> bool:
        return self._stop.is_set() or not self._session.is_up or self._session.generation != generation

    def _fail_if_lost(self, generation: int) -> None:
        if self._stop.is_set():
            raise LinkError(f"{self.name}: the transceiver is closed")
        if self._is_lost(generation):
            raise LinkError(f"{self.name}: the transceiver was lost: {self._session.trouble}")

    # ---- the thread

    def _run(self) -> None:
        while not self._stop.is_set():
            if self._wire is None and not self._reopen():
                self._stop.wait(_REOPEN_S)
            else:
                self._serve()

    def _reopen(self) -> bool:
        try:
            wire = self._open_port()
        except LinkError:
            return False
        _log.info("%s: the port is there again", self.name)
        with self._changed:
            self._wire = wire
        return True

    def _serve(self) -> None:
        wire = self._wire
        if wire is None:
            return
        try:
            data = wire.read(_READ_S)
        except LinkError as error:
            self._lose(error)
            return
        with self._changed:
            before = self._session.state
            if data:
                self._session.feed(data, self._clock.now_s())
            else:
                self._session.tick(self._clock.now_s())
            self._say()
            self._log_change(before)
            self._log_faults()
            if data or self._session.state is not before:
                self._changed.notify_all()

    def _say(self) -> None:
        """Write what the session has to say, in its order: `changed` is held."""
        output = self._session.take_output()
        if self._wire is None or not output:
            return
        try:
            self._wire.write(output)
        except LinkError as error:
            self._lose(error)

    def _lose(self, error: LinkError) -> None:
        with self._changed:
            _log.warning("%s", error)
            self._session.unplug(str(error))
            self._drop_wire()
            self._changed.notify_all()

    def _drop_wire(self) -> None:
        wire, self._wire = self._wire, None
        if wire is not None:
            with contextlib.suppress(LinkError):
                wire.close()

    def _log_faults(self) -> None:
        """Each kind at each port when it begins, and every ten seconds while it goes on."""
        now_s = self._clock.now_s()
        while self._session.faults:
            report = self._session.faults.popleft()
            kind = report.fault, report.port
            if now_s - self._fault_logged_s.get(kind, -_LOG_FAULT_S) < _LOG_FAULT_S:
                continue
            self._fault_logged_s[kind] = now_s
            _log.warning("%s: %s: %d so far", self.name, describe_fault(report), report.total)

    def _log_change(self, before: State) -> None:
        now = self._session.state
        if now is before:
            return
        if now is State.OPEN:
            _log.info("%s: the transceiver is there", self.name)
        elif before is State.OPEN or now is State.REFUSED:
            _log.warning("%s: the transceiver: %s", self.name, self._session.trouble)


class RadioPort:
    """One radio's bytes: a `BytePort` like any other."""

    def __init__(self, transceiver: Transceiver, radio: int) -> None:
        self.name = f"{transceiver.name} {_RADIO_NAMES[radio]}"
        self.statistics = PortStatistics()
        self._transceiver = transceiver
        self._radio = radio
        self._generation = 0
        self._closed = False

    def write(self, data: bytes) -> None:
        """Raises `LinkError`, once for every loss of the transceiver and as long as it is away."""
        with self._noticing_losses():
            self._transceiver.write(self._radio, data, self._generation)
        self.statistics.written_bytes += len(data)

    def read(self, timeout_s: float) -> bytes:
        with self._noticing_losses():
            data = self._transceiver.read(self._radio, timeout_s, self._generation)
        self.statistics.read_bytes += len(data)
        return data

    def set_baud_rate(self, baud_rate: int) -> bool:
        """Once what was written before is out; the rate stays after a reset of the Mega. False: it has no such rate."""
        if baud_rate not in t.RADIO_BAUDS:
            return False
        with self._noticing_losses():
            return self._transceiver.set_baud(self._radio, baud_rate, self._generation)

    def reset(self, low_s: float = 0.05) -> None:
        """Pull the module's RESETB low for so long, up to 1 s."""
        low_ms = max(1, min(t.MAX_RESET_MS, round(low_s * 1_000)))
        with self._noticing_losses():
            self._transceiver.reset_radio(self._radio, low_ms, self._generation)

    def close(self) -> None:
        """The transceiver stays open for the other radio."""
        self._closed = True

    @contextlib.contextmanager
    def _noticing_losses(self) -> Iterator[None]:
        if self._closed:
            raise LinkError(f"{self.name}: the port is closed")
        try:
            yield
        except LinkError:
            self._generation = self._transceiver.generation()
            raise
