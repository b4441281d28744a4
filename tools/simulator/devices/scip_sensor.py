"""A SCIP 2.0 scanner without its port: requests in, replies out, byte for byte as the specification has them."""

from __future__ import annotations

import struct
from collections import deque
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_ZERO = 0x30
UBG_04LX = (
    ("MODL", "UBG-04LX-F01(Hokuyo Automatic Co.,Ltd.)"),
    ("DMIN", "20"),
    ("DMAX", "4095"),
    ("ARES", "1024"),
    ("AMIN", "44"),
    ("AMAX", "725"),
    ("AFRT", "384"),
    ("SCAN", "2142"),
)
UST_10LX = (
    ("MODL", "UST-10LX(Hokuyo Automatic Co.,Ltd.)"),
    ("DMIN", "20"),
    ("DMAX", "30000"),
    ("ARES", "1440"),
    ("AMIN", "0"),
    ("AMAX", "1080"),
    ("AFRT", "540"),
    ("SCAN", "2400"),
)
_IDENTITY = (
    ("VEND", "Hokuyo Automatic Co.,Ltd."),
    ("FIRM", "1.0.00(01/Jan./2008)"),
    ("PROT", "SCIP 2.0"),
    ("SERI", "H0000001"),
)
_STATE = (("LASR", "ON"), ("STAT", "Sensor works well."))


class Mode(Enum):
    SCIP_1_1 = "SCIP 1.1"
    TIME = "time mode"
    IDLE = "idle"
    STREAMING = "streaming"


def summed(text: bytes) -> bytes:
    return text + bytes([(sum(text) & 0x3F) + _ZERO])


def encode(number: int, characters: int) -> bytes:
    return bytes((number >> 6 * i & 0x3F) + _ZERO for i in reversed(range(characters)))


def status_reply(echo: bytes, status: bytes, lines: bytes = b"") -> bytes:
    return echo + b"\n" + summed(status) + b"\n" + lines + b"\n"


def scan_reply(
    echo: bytes, time_ms: int, values: NDArray[np.int_], characters: int = 2, status: bytes = b"99"
) -> bytes:
    """A whole reply with its time stamp and its data in lines of 64 characters."""
    text = b"".join(encode(int(value), characters) for value in values)
    lines = b"".join(summed(text[i : i + 64]) + b"\n" for i in range(0, len(text), 64))
    return status_reply(echo, status, summed(encode(time_ms & 0xFFFFFF, 4)) + b"\n" + lines)


class ScipSensor:
    """`first_scan`: (B,) mm, sent as soon as streaming is asked for; further ones by `scan`."""

    def __init__(
        self,
        first_scan: NDArray[np.int_] | None,
        parameters: tuple[tuple[str, str], ...] = UBG_04LX,
        mode: Mode = Mode.IDLE,
    ) -> None:
        self._first_scan = first_scan
        self._parameters = parameters
        self._partial = b""
        self._stream_echo = b"MS0044072501000"
        self._newest = first_scan
        self._laser_is_on = mode is Mode.STREAMING
        self.mode = mode
        self.baud_rate: int | None = None
        self.time_ms = 1000
        self.requests: list[bytes] = []
        self.refusals: dict[bytes, bytes] = {}  # command to the status that refuses it

    def become(self, parameters: tuple[tuple[str, str], ...], first_scan: NDArray[np.int_]) -> None:
        """Be another scanner from now on."""
        self._parameters, self._first_scan = parameters, first_scan

    def receive(self, data: bytes) -> bytes:
        """The bytes that answer `data`."""
        *lines, self._partial = (self._partial + data).replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
        return b"".join(self._answer(line) for line in lines if line)

    def scan(self, values: NDArray[np.int_], period_ms: int = 28) -> bytes:
        """The bytes of the next scan; none while it does not stream."""
        if self.mode is not Mode.STREAMING:
            return b""
        self.time_ms += period_ms
        self._newest = values
        return scan_reply(self._stream_echo, self.time_ms, values, _characters(self._stream_echo))

    def simulated_scan(self, ranges_m: NDArray[np.float32]) -> bytes:
        """The same of a scan of the simulator, (B,) with NaN where it measured nothing."""
        return self.scan(np.rint(np.nan_to_num(ranges_m, nan=0.0).astype(np.float64) * 1000).astype(np.int_))

    def _answer(self, line: bytes) -> bytes:
        self.requests.append(line)
        if self.mode is Mode.SCIP_1_1:
            if line == b"SCIP2.0":
                self.mode = Mode.IDLE
                return line + b"\n0\n\n"
            return line + b"\nE\n\n"
        if self.mode is Mode.TIME and not line.startswith(b"TM"):
            return status_reply(line, b"0E")
        if line[:2] in self.refusals:
            return status_reply(line, self.refusals[line[:2]])
        return self._reply(line)

    def _reply(self, line: bytes) -> bytes:  # noqa: PLR0911 - one for each command of the specification
        match line[:2]:
            case b"VV":
                model = dict(self._parameters)["MODL"].partition("(")[0]
                return self._fields(line, (("PROD", f"SOKUIKI Sensor {model}"), *_IDENTITY))
            case b"PP":
                return self._fields(line, self._parameters)
            case b"II":
                return self._fields(line, (self._parameters[0], *_STATE))
            case b"QT":
                self.mode, self._laser_is_on = Mode.IDLE, False
                return status_reply(line, b"00")
            case b"BM":
                was_on, self._laser_is_on = self._laser_is_on, True
                return status_reply(line, b"02" if was_on else b"00")
            case b"TM":
                return self._time_mode(line)
            case b"SS" if line[2:].isdigit() and len(line) == 8:
                self.baud_rate = int(line[2:])
                return status_reply(line, b"00")
            case b"MS" | b"MD" if len(line) == 15 and line[2:].isdigit():
                return self._stream(line)
            case b"GS" | b"GD" if len(line) == 12 and line[2:].isdigit():
                return self._single(line)
        return status_reply(line, b"0E")

    def _time_mode(self, line: bytes) -> bytes:
        wanted = {b"0": Mode.TIME, b"2": Mode.IDLE}.get(line[2:])
        if wanted is None:
            return status_reply(line, b"01")
        already, self.mode = self.mode is wanted, wanted
        return status_reply(line, (b"02" if wanted is Mode.TIME else b"03") if already else b"00")

    def _stream(self, line: bytes) -> bytes:
        self.mode, self._laser_is_on, self._stream_echo = Mode.STREAMING, True, line
        first = b"" if self._first_scan is None else self.scan(self._first_scan)
        return status_reply(line, b"00") + first

    def _single(self, line: bytes) -> bytes:
        if not self._laser_is_on or self._newest is None:
            return status_reply(line, b"10")
        return scan_reply(line, self.time_ms, self._newest, _characters(line), b"00")

    def _fields(self, line: bytes, fields: tuple[tuple[str, str], ...]) -> bytes:
        """The sum is that of the text before the semicolon."""
        texts = (f"{name}:{value}".encode() for name, value in fields)
        return status_reply(line, b"00", b"".join(t + b";" + summed(t)[-1:] + b"\n" for t in texts))


def _characters(request: bytes) -> int:
    return 2 if request[1:2] == b"S" else 3


@dataclass(frozen=True, slots=True)
class Exchange:
    request: bytes
    reply: bytes


def read_capture(path: Path) -> bytes:
    """All bytes of a `.logr` or `.logw`: records of seconds, microseconds and length, big-endian, then the bytes."""
    data, at, parts = path.read_bytes(), 0, []
    while at < len(data):
        *_, length = struct.unpack_from(">III", data, at)
        parts.append(data[at + 12 : at + 12 + length])
        at += 12 + length
    return b"".join(parts)


def read_session(folder: Path, name: str) -> tuple[Exchange, ...]:
    """What was asked and answered in a captured session, in order."""
    requests = read_capture(folder / f"{name}.logw").split(b"\n")
    replies = read_capture(folder / f"{name}.logr").split(b"\n\n")
    exchanges: list[Exchange] = []
    for reply in replies:
        if requests and requests[0] and reply.startswith(requests[0] + b"\n"):
            exchanges.append(Exchange(requests.pop(0), reply + b"\n\n"))
        elif reply and exchanges:  # a streamed reply of the request before
            last = exchanges.pop()
            exchanges.append(Exchange(last.request, last.reply + reply + b"\n\n"))
    return tuple(exchanges)


class CapturedSensor(ScipSensor):
    """Answers with the bytes that were captured, each reply once; what was not asked then is answered by the rules."""

    def __init__(self, session: tuple[Exchange, ...], first_scan: NDArray[np.int_] | None) -> None:
        super().__init__(first_scan)
        self._captured: dict[bytes, deque[bytes]] = {}
        for exchange in session:
            self._captured.setdefault(exchange.request, deque()).append(exchange.reply)

    def _reply(self, line: bytes) -> bytes:
        captured = self._captured.get(line)
        return captured.popleft() if captured else super()._reply(line)
