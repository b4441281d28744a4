"""Asks a SCIP 2.0 scanner on a serial line, whatever state an earlier program has left it in."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

from robot_app.drivers.base import DeviceError
from robot_app.drivers.scip import OK, Field, Reply, ReplyBuffer, parse_fields, parse_reply, status_name, value_of
from robot_app.drivers.serial_line import SerialLine
from shared.runtime.clock import Clock

_log = logging.getLogger(__name__)
# After power-up the scanner has the rate it was delivered with, which is not the same for all of them.
RS232_RATES = (115_200, 19_200, 38_400, 57_600, 250_000, 500_000, 750_000)
_WAKE_ATTEMPTS = 3  # the first may complete a command that was left half written
_MAX_STEPS = 100_000


@dataclass(frozen=True, slots=True)
class ScannerParameters:
    """What the scanner says about itself (PP). Steps grow counter-clockwise seen from above."""

    model: str
    range_min_mm: int
    range_max_mm: int
    steps_per_turn: int
    first_step: int
    last_step: int
    front_step: int
    turns_per_minute: int

    @property
    def beams(self) -> int:
        return self.last_step - self.first_step + 1

    @property
    def step_rad(self) -> float:
        return math.tau / self.steps_per_turn


@dataclass(frozen=True, slots=True)
class BaudRates:
    found: int
    now: int


@dataclass(frozen=True, slots=True)
class ScannerIdentity:
    """VV and the state of II."""

    product: str
    firmware: str
    serial: str
    state: str


class ScipClient:
    def __init__(self, line: SerialLine, clock: Clock, answer_timeout_s: float) -> None:
        self._line = line
        self._clock = clock
        self._answer_timeout_s = answer_timeout_s
        self._buffer = ReplyBuffer()
        self._waiting: list[bytes] = []  # blocks that came together with an answer, after it

    @property
    def name(self) -> str:
        return self._line.name

    @property
    def discarded_bytes(self) -> int:
        return self._buffer.discarded_bytes

    def find(self, rates: tuple[int, ...]) -> BaudRates:
        """Bring the scanner to SCIP 2.0, idle, looking for it at each of `rates`, and to the first of them.

        Raises `DeviceError` when nobody answers.
        """
        for rate in dict.fromkeys(rates):
            self._line.set_baud_rate(rate)
            if self.wake():
                return BaudRates(rate, rate if rate == rates[0] else self._change_rate(rate, rates[0]))
        raise DeviceError(f"{self.name}: no scanner answers; does it have power, is it the right port?")

    def wake(self) -> bool:
        """End streaming, time mode and SCIP 1.1; False when there is no answer.

        A sensor in SCIP 1.1 answers QT with 'E', one in time mode with 0E.
        """
        self._buffer.clear()
        for _ in range(_WAKE_ATTEMPTS):
            reply = self._exchange(b"QT")
            if reply is None:
                continue
            if reply.status in {OK, b"0"}:
                if reply.status == OK:
                    return True
                self._exchange(b"SCIP2.0")
            elif reply.status == b"E":
                self._exchange(b"SCIP2.0")
            else:
                self._exchange(b"TM2")
        return False

    def ask(self, request: str, accepted: tuple[bytes, ...] = (OK,)) -> Reply:
        """Send a request; raises `DeviceError` when there is no answer or a refusal."""
        reply = self._exchange(request.encode("ascii"))
        if reply is None:
            raise DeviceError(f"{self.name}: no answer to {request}; is the cable in order?")
        if reply.status not in accepted:
            raise DeviceError(f"{self.name}: {request} was refused, {status_name(request[:2], reply.status)}")
        return reply

    def parameters(self) -> ScannerParameters:
        fields = parse_fields(self.ask("PP").body)
        parameters = ScannerParameters(
            value_of(fields, "MODL") or "unknown",
            *(self._number(fields, name) for name in ("DMIN", "DMAX", "ARES", "AMIN", "AMAX", "AFRT", "SCAN")),
        )
        p = parameters
        if not (0 <= p.first_step <= p.front_step <= p.last_step < p.steps_per_turn <= _MAX_STEPS):
            raise DeviceError(f"{self.name}: its steps make no sense: {p}")
        return parameters

    def identity(self) -> ScannerIdentity:
        version, state = parse_fields(self.ask("VV").body), parse_fields(self.ask("II").body)
        product, firmware, serial = (value_of(version, name) or "unknown" for name in ("PROD", "FIRM", "SERI"))
        return ScannerIdentity(product, firmware, serial, value_of(state, "STAT") or "unknown")

    def laser_on(self) -> None:
        self.ask("BM", accepted=(OK, b"02"))

    def send_quit(self) -> None:
        """Laser off, no more scans; does not wait for the answer."""
        self._line.write(b"QT\n")

    def receive(self, timeout_s: float) -> list[bytes] | None:
        """The reply blocks that became complete, oldest first, maybe none yet; None when no byte came in time."""
        if self._waiting:
            blocks, self._waiting = self._waiting, []
            return blocks
        data = self._line.read(timeout_s)
        if not data:
            return None
        self._buffer.feed(data)
        return self._buffer.take()

    def close(self) -> None:
        self._line.close()

    def _exchange(self, request: bytes) -> Reply | None:
        self._waiting = []
        self._line.write(request + b"\n")
        due_s = self._clock.now_s() + self._answer_timeout_s
        while (left_s := due_s - self._clock.now_s()) > 0:
            data = self._line.read(left_s)
            if not data:
                return None
            self._buffer.feed(data)
            blocks = self._buffer.take()
            for i, block in enumerate(blocks):
                reply = parse_reply(block, request)
                if reply is not None:
                    self._waiting = blocks[i + 1 :]
                    return reply
        return None

    def _change_rate(self, found: int, wanted: int) -> int:
        reply = self._exchange(b"SS%06d" % wanted)
        if reply is None or reply.status not in {OK, b"03"}:
            _log.warning("%s: stays at %d baud; it does not take %d", self.name, found, wanted)
            return found
        self._line.set_baud_rate(wanted)
        if not self.wake():
            raise DeviceError(f"{self.name}: no answer after the change from {found} to {wanted} baud")
        return wanted

    def _number(self, fields: tuple[Field, ...], name: str) -> int:
        text = value_of(fields, name)
        if text is None or not text.strip().isdecimal():
            raise DeviceError(f"{self.name}: its parameters have no {name}; is it a SCIP 2.0 scanner?")
        return int(text)
