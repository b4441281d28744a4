"""SCIP 2.0, the language of Hokuyo's scanners: bytes in, replies out; no port, no clock.

A request is a line. Its reply repeats the line, then a status with its check sum, then lines with a check sum each,
and ends with an empty line (specification C-42-03320B). Foreign bytes never raise: what is no reply is None.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

END = b"\n\n"
STREAMED = b"99"
RESUMED = b"98"
OK = b"00"
UNSTABLE = b"0M"
_LINE_CHARACTERS = 64
_BUFFER_BYTES = 65_536
_KEPT_BYTES = 8_192  # more than the longest reply, 2137 bytes for a scan of 3-character data
_FIRST_CHARACTER = 0x30
_LINE_FEED = 0x0A

_STATUS_NAMES = {
    b"00": "fine",
    b"0C": "parameters are missing",
    b"0D": "does not know this command",
    b"0E": "does not know this command",
    b"0F": "parameters are missing",
    b"0G": "the text is too long",
    b"0H": "the text has a wrong character",
    b"0I": "is waiting for new firmware",
    b"0L": "is in trouble",
    b"0M": "is not stable yet",
    b"10": "the laser is off",
    b"98": "measures again",
    b"99": "sends a scan",
}


def status_name(command: str, status: bytes) -> str:
    """What a status means, for the operator."""
    text = status.decode("ascii", "replace")
    if command == "BM" and status in {b"01", b"02"}:
        return f"{text}: the laser {'is faulty' if status == b'01' else 'is on already'}"
    if status in _STATUS_NAMES:
        return f"{text}: {_STATUS_NAMES[status]}"
    if command in {"MS", "MD"} and status.isdigit():
        code = int(status)
        if 1 <= code <= 7:
            return f"{text}: a parameter of the scan is wrong"
        if 21 <= code <= 49:
            return f"{text}: stopped to check an error of its own"
        if 50 <= code <= 97:
            return f"{text}: hardware trouble (laser, motor or supply)"
    return f"{text}: unknown status"


def checksum(text: bytes) -> int:
    """The character that follows `text` in a line."""
    return (sum(text) & 0x3F) + _FIRST_CHARACTER


@dataclass(frozen=True, slots=True)
class Reply:
    """`status`: two characters, one in SCIP 1.1. `body`: the lines after the status, without the last line feed."""

    echo: bytes
    status: bytes
    body: bytes

    @property
    def text(self) -> bytes:
        """As it came, without the two line feeds at its end."""
        total = bytes([checksum(self.status)]) if len(self.status) == 2 else b""
        head = self.echo + b"\n" + self.status + total
        return head + b"\n" + self.body if self.body else head


def parse_reply(block: bytes, request: bytes) -> Reply | None:
    """The last reply to a request that begins with `request`, out of what came up to an empty line.

    Before it there may be garbage, or a reply that was cut.
    """
    at = block.rfind(request)
    while at >= 0:
        reply = _reply_at(block, at)
        if reply is not None:
            return reply
        at = block.rfind(request, 0, at + len(request) - 1)
    return None


def _reply_at(block: bytes, at: int) -> Reply | None:
    echo_end = block.find(b"\n", at)
    if echo_end < 0:
        return None
    status_end = block.find(b"\n", echo_end + 1)
    status_end = len(block) if status_end < 0 else status_end
    status = block[echo_end + 1 : status_end]
    if len(status) == 3 and checksum(status[:2]) == status[2]:
        return Reply(block[at:echo_end], status[:2], block[status_end + 1 :])
    if status in {b"0", b"E"}:  # SCIP 1.1
        return Reply(block[at:echo_end], status, block[status_end + 1 :])
    return None


class ReplyBuffer:
    """Collects bytes until there are whole replies in it."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.discarded_bytes = 0

    def feed(self, data: bytes) -> None:
        self._bytes += data
        if len(self._bytes) > _BUFFER_BYTES:
            surplus = len(self._bytes) - _KEPT_BYTES
            self.discarded_bytes += surplus
            del self._bytes[:surplus]

    def take(self) -> list[bytes]:
        """Everything up to the last empty line, cut at the empty lines."""
        end = self._bytes.rfind(END)
        if end < 0:
            return []
        blocks = bytes(self._bytes[:end]).split(END)
        del self._bytes[: end + len(END)]
        return blocks

    def clear(self) -> None:
        self._bytes.clear()


def decode_number(text: bytes) -> int | None:
    """Six bits a character, the most significant first."""
    number = 0
    for character in text:
        if not 0 <= character - _FIRST_CHARACTER < 64:
            return None
        number = number << 6 | character - _FIRST_CHARACTER
    return number


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


@dataclass(frozen=True, slots=True, eq=False)
class ScanBlock:
    """`time_ms`: 24-bit counter of the scanner. `values`: (B,) int32, mm; below DMIN they are error codes."""

    time_ms: int
    values: NDArray[np.int32]


class ScanDecoder:
    """Decodes the bodies of scan replies of `beams` values of 2 or 3 characters; no loop over beams or lines."""

    def __init__(self, beams: int, characters: int) -> None:
        total = beams * characters
        self._characters = characters
        self._full_lines, self._rest = divmod(total, _LINE_CHARACTERS)
        self._text = np.empty(total, np.uint8)
        self._sums = np.empty(self._full_lines, np.uint32)
        self._data_bytes = self._full_lines * (_LINE_CHARACTERS + 2) + (self._rest + 2 if self._rest else 0)

    @property
    def reply_bytes(self) -> int:
        """Of a whole streamed reply: echo, status, time, data and the empty line."""
        return 16 + 4 + 6 + self._data_bytes + 1

    def decode(self, body: bytes) -> ScanBlock | None:
        """None where the length, a check sum or a character is wrong."""
        time_text, _, data = body.partition(b"\n")
        if len(time_text) != 5 or checksum(time_text[:4]) != time_text[4]:
            return None
        time_ms, values = decode_number(time_text[:4]), self.values(data + b"\n")
        return None if time_ms is None or values is None else ScanBlock(time_ms, values)

    def values(self, data: bytes) -> NDArray[np.int32] | None:
        """(B,) of the data lines, each with its sum and its line feed; None where something is wrong."""
        if len(data) != self._data_bytes or not self._unfold(np.frombuffer(data, np.uint8)):
            return None
        sextets = np.subtract(self._text, _FIRST_CHARACTER, out=self._text)  # what is below wraps to above 63
        if sextets.max(initial=0) >= 64:
            return None
        values = sextets[:: self._characters].astype(np.int32)
        for i in range(1, self._characters):
            np.left_shift(values, 6, out=values)
            np.bitwise_or(values, sextets[i :: self._characters], out=values)
        return values

    def _unfold(self, data: NDArray[np.uint8]) -> bool:
        """The lines without sums and line feeds into one text; False where one of those is wrong."""
        full = self._full_lines * _LINE_CHARACTERS
        lines = data[: self._full_lines * (_LINE_CHARACTERS + 2)].reshape(self._full_lines, _LINE_CHARACTERS + 2)
        texts = self._text[:full].reshape(self._full_lines, _LINE_CHARACTERS)
        texts[:] = lines[:, :_LINE_CHARACTERS]
        sums = np.add.reduce(texts, axis=1, dtype=np.uint32, out=self._sums)
        np.bitwise_and(sums, 0x3F, out=sums)
        if not (np.array_equal(sums + _FIRST_CHARACTER, lines[:, -2]) and (lines[:, -1] == _LINE_FEED).all()):
            return False
        if not self._rest:
            return True
        last = data[lines.size :]
        self._text[full:] = last[: self._rest]
        return checksum(last[: self._rest].tobytes()) == last[-2] and bool(last[-1] == _LINE_FEED)
