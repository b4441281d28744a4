"""Asks a SCIP 2.0 scanner through `hokuyolx`, whatever state an earlier program has left it in.

The library composes and judges the requests: BM, QT, VV, PP, II. Three things it cannot do and are done here, past
it: bring a scanner to SCIP 2.0 (statuses of SCIP 1.1 have no sum), find its baud rate, and read the stream. Its own
stream of MD decodes character by character, decodes every scan that waits instead of the newest, and ends at the
first damaged one.
"""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Callable, Iterator

import numpy as np
from hokuyolx import HokuyoLX
from hokuyolx.exceptions import HokuyoChecksumMismatch, HokuyoException, HokuyoStatusException
from numpy.typing import NDArray

from robot_app.drivers.base import DeviceError
from robot_app.drivers.scip import (
    OK,
    BaudRates,
    Reply,
    ScanDecoder,
    ScannerIdentity,
    ScannerParameters,
    status_name,
)
from robot_app.drivers.scip_transport import ScipTransport

_log = logging.getLogger(__name__)
_library_log = _log.getChild("hokuyolx")
_library_log.setLevel(logging.WARNING)  # it tells each request
_WAKE_ATTEMPTS = 3  # the first may complete a command that was left half written
_NUMBERS = ("DMIN", "DMAX", "ARES", "AMIN", "AMAX", "AFRT", "SCAN")
_MAX_DIGITS = 9
_MAX_STEPS = 100_000
_CHARACTERS = 3  # of a value of MD, GD, ME and GE


class ScipClient(HokuyoLX):  # type: ignore[misc] # the library has no types
    """`HokuyoLX` of hokuyolx 0.9.0 over any line, without these faults of it:

    - its constructor asks for %ST, which SCIP 2.0 does not have: here it sends nothing;
    - angles are cut as if AMIN were 0: `get_angles`;
    - replies that came glued break it, a closed connection keeps it in a loop for ever, and replies to others keep
      it waiting past its time-out: `ScipTransport`;
    - a failed constructor leaves the socket open: the line belongs to who opened it;
    - converting time stamps reads an attribute that is not there: `_tn`;
    - the sum of VV, PP and II is checked, but a value with a colon, or with digits that are no number, raises
      ValueError, and the serial number 00903971 loses its zeros: `_process_info_line`;
    - the laser's fault passes for success: `laser_on`.

    GE and %ST, which the UBG-04LX does not know, are refused by it with 0E, as `HokuyoStatusException`.
    """

    _tn = 0

    def __init__(self, transport: ScipTransport, answer_timeout_s: float) -> None:
        self._transport = transport
        super().__init__(False, False, False, timeout=answer_timeout_s, logger=_library_log, convert_time=False)

    @property
    def name(self) -> str:
        return self._transport.name

    def wake(self) -> bool:
        """End streaming, time mode and SCIP 1.1; False when there is no answer.

        A sensor in SCIP 1.1 answers QT with 'E', one in time mode with 0E.
        """
        self._transport.clear()
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

    def find(self, rates: tuple[int, ...], set_baud_rate: Callable[[int], None]) -> BaudRates:
        """Bring the scanner to SCIP 2.0, idle, looking for it at each of `rates`, and to the first of them.

        Raises `DeviceError` when nobody answers.
        """
        for rate in dict.fromkeys(rates):
            set_baud_rate(rate)
            if self.wake():
                return BaudRates(rate, rate if rate == rates[0] else self._change_rate(rate, rates[0], set_baud_rate))
        raise DeviceError(f"{self.name}: no scanner answers; does it have power, is it the right port?")

    def parameters(self) -> ScannerParameters:
        """PP. Raises `DeviceError` where it makes no sense."""
        with self._refusal_named("PP"):
            fields = self.sensor_parameters()
        texts = {name: str(fields.get(name)) for name in _NUMBERS}
        missing = [name for name, text in texts.items() if not text.isdecimal() or len(text) > _MAX_DIGITS]
        if missing:
            raise DeviceError(f"{self.name}: its parameters have no {missing[0]}; is it a SCIP 2.0 scanner?")
        p = ScannerParameters(str(fields.get("MODL", "unknown")), *(int(text) for text in texts.values()))
        if not (0 <= p.first_step <= p.front_step <= p.last_step < p.steps_per_turn <= _MAX_STEPS):
            raise DeviceError(f"{self.name}: its steps make no sense: {p}")
        self.dmin, self.dmax, self.ares = p.range_min_mm, p.range_max_mm, p.steps_per_turn
        self.amin, self.amax, self.aforw = p.first_step, p.last_step, p.front_step
        return p

    def identity(self) -> ScannerIdentity:
        with self._refusal_named("VV"):
            version = self.version()
        with self._refusal_named("II"):
            state = self.sensor_state()
        product, firmware, serial = (str(version.get(name, "unknown")) for name in ("PROD", "FIRM", "SERI"))
        return ScannerIdentity(product, firmware, serial, str(state.get("STAT", "unknown")))

    def laser_on(self) -> None:
        with self._refusal_named("BM"):
            code, _ = self.activate()
            if code == 1:
                raise HokuyoStatusException("01")

    def begin_stream(self, request: str) -> None:
        """MD or MS with its parameters; the scans come by `receive` of the transport."""
        with self._refusal_named(request[:2]):
            status, _ = self._send_req(request[:2], request[2:])
            if status != "00":
                raise HokuyoStatusException(status)

    def send_quit(self) -> None:
        """Laser off, no more scans; does not wait for the answer."""
        self._send_cmd("QT")

    def get_angles(self, start: int | None = None, end: int | None = None, grouping: int = 0) -> NDArray[np.float64]:
        """(B,) of the steps `start` to `end`, each of them or the first of each group, radians from the front."""
        first, last = (self.amin if start is None else start), (self.amax if end is None else end)
        steps = np.arange(first, last + 1, max(1, grouping), dtype=np.float64)
        angles: NDArray[np.float64] = (steps - self.aforw) * math.tau / self.ares
        return angles

    def _connect_to_laser(self, close: bool = True) -> None:
        self._sock = self._transport
        self._sock.settimeout(self.timeout)

    def _process_info_line(self, line: str) -> tuple[str, int | str]:
        text, semicolon, total = line.rpartition(";")
        if not semicolon or len(total) != 1:
            raise HokuyoException(f"this line has no sum: {line}")
        key, _, value = self._check_sum(text, total).partition(":")
        is_number = value.isdecimal() and len(value) <= _MAX_DIGITS and (value == "0" or not value.startswith("0"))
        return key, int(value) if is_number else value

    def _process_scan_data(self, data: list[str], with_intensity: bool) -> NDArray[np.int32]:
        """(B,) mm, or (B, 2) with the intensities; of MD, GD, ME and GE."""
        lines = [line for line in data if line]
        text = "".join(line + "\n" for line in lines).encode("ascii")
        values = ScanDecoder((len(text) - 2 * len(lines)) // _CHARACTERS, _CHARACTERS).values(text)
        if values is None or (with_intensity and values.size % 2):
            raise HokuyoChecksumMismatch("in the data of a scan")
        return values.reshape(-1, 2) if with_intensity else values

    def _exchange(self, request: bytes) -> Reply | None:
        self._transport.send(request + b"\n")
        return self._transport.reply()

    def _change_rate(self, found: int, wanted: int, set_baud_rate: Callable[[int], None]) -> int:
        reply = self._exchange(b"SS%06d" % wanted)
        if reply is None or reply.status not in {OK, b"03"}:
            _log.warning("%s: stays at %d baud; it does not take %d", self.name, found, wanted)
            return found
        set_baud_rate(wanted)
        if not self.wake():
            raise DeviceError(f"{self.name}: no answer after the change from {found} to {wanted} baud")
        return wanted

    @contextlib.contextmanager
    def _refusal_named(self, command: str) -> Iterator[None]:
        """The library's exceptions as `DeviceError`."""
        try:
            yield
        except HokuyoStatusException as error:
            meaning = status_name(command, str(error.code).encode("ascii", "replace"))
            raise DeviceError(f"{self.name}: {command} was refused, {meaning}") from error
        except HokuyoChecksumMismatch as error:
            raise DeviceError(f"{self.name}: the answer to {command} is damaged; is the cable in order?") from error
        except HokuyoException as error:
            raise DeviceError(f"{self.name}: no answer to {command} ({error}); is the cable in order?") from error
