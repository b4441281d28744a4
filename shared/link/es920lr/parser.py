"""What a module in operation says, sans-I/O: any bytes in, events out.

With the binary format, RSSI and sender switched on, each thing it says is unmistakable at its beginning:

    0x02 "OK"                                     the packet is out
    0x06 "NG nnn"                                 it is not
    length 13..62, then 12 hex digits, payload    a packet came in: RSSI, PAN, sender
    CR LF, then nothing for a moment              it has just begun to operate
    CR LF "Select Mode [...]" CR LF               it has restarted and asks what to do

Bytes that are nothing of these are counted and dropped, one at a time, until something fits again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from shared.link.es920lr.airtime import MAX_PAYLOAD_BYTES

MODE_QUESTION = b"Select Mode [1.terminal or 2.processor]\r\n"
PREFIX_BYTES = 12  # RSSI, PAN and sender, 4 hex digits each
HALF_FRAME_S = 0.5  # after this much silence the rest of a frame does not come any more
_MOMENT_S = 0.1  # a question comes right after its empty line
_LONGEST = PREFIX_BYTES + MAX_PAYLOAD_BYTES
_OK = b"\x02OK"
_REFUSED = b"\x06NG "
_STARTED = b"\r\n"
_ASKS = _STARTED + MODE_QUESTION
_HEX = frozenset(b"0123456789ABCDEFabcdef")
_RSSI = _HEX | frozenset(b"+- ")  # some firmware writes it as a decimal number


@dataclass(frozen=True, slots=True)
class Heard:
    """A packet of another module."""

    payload: bytes
    rssi_dbm: int
    pan_id: int
    sender_id: int


@dataclass(frozen=True, slots=True)
class Reply:
    """The fate of the packet that was handed over: None is OK, else the number of its NG."""

    refusal: int | None


@dataclass(frozen=True, slots=True)
class Started:
    """The module begins to operate: its answer to `start`, or it has restarted."""


@dataclass(frozen=True, slots=True)
class AsksForMode:
    """The module has restarted and is to be configured."""


Utterance = Heard | Reply | Started | AsksForMode


class OperationParser:
    """Never holds more than one frame."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._last_byte_s = 0.0
        self.dropped_bytes = 0

    @property
    def deadline_s(self) -> float:
        """When `expire` is due if nothing more comes; infinite when nothing is half said."""
        if not self._buffer:
            return math.inf
        return self._last_byte_s + (_MOMENT_S if self._buffer == _STARTED else HALF_FRAME_S)

    def feed(self, data: bytes, now_s: float) -> list[Utterance]:
        """All that `data` completes."""
        heard: list[Utterance] = []
        if data:
            self._last_byte_s = now_s
        for start in range(0, len(data), _LONGEST):
            self._buffer += data[start : start + _LONGEST]
            heard += self._take()
        return heard

    def expire(self, now_s: float) -> list[Utterance]:
        """Nothing more has come by now: give up what has been half said for too long, and look through its rest."""
        heard: list[Utterance] = []
        while now_s >= self.deadline_s:
            if self._buffer == _STARTED:
                self._buffer.clear()
                heard.append(Started())
            else:
                self._drop(1)
                heard += self._take()
        return heard

    def clear(self) -> None:
        """Forget what has come so far: the module has been restarted."""
        self._drop(len(self._buffer))

    def _take(self) -> list[Utterance]:
        taken: list[Utterance] = []
        while self._buffer:
            needed = _needed_bytes(self._buffer)
            if needed == 0:
                self._drop(1)
            elif len(self._buffer) < needed:
                break
            elif (utterance := _parsed(bytes(self._buffer[:needed]))) is None:
                self._drop(1)
            else:
                del self._buffer[:needed]
                taken.append(utterance)
        return taken

    def _drop(self, count: int) -> None:
        self.dropped_bytes += count
        del self._buffer[:count]


def _needed_bytes(buffer: bytearray) -> int:
    """The length of what the buffer begins with; 0 when that can be nothing."""
    first = buffer[0]
    if PREFIX_BYTES < first <= _LONGEST:
        if buffer.startswith(_STARTED):
            return len(_ASKS) if _ASKS.startswith(buffer[: len(_ASKS)]) else len(_STARTED)
        return 1 + first if _is_prefix(buffer) else 0
    for text, length in ((_OK, len(_OK)), (_REFUSED, 1 + _REFUSED[0])):
        if text.startswith(buffer[: len(text)]):
            return length
    return 0


def _is_prefix(buffer: bytearray) -> bool:
    """Whether the bytes after the length, as far as they have come, are hex digits."""
    return all(b in _RSSI for b in buffer[1:5]) and all(b in _HEX for b in buffer[5 : 1 + PREFIX_BYTES])


def _parsed(frame: bytes) -> Utterance | None:
    if frame == _STARTED:
        return Started()
    if frame == _ASKS:
        return AsksForMode()
    if frame == _OK:
        return Reply(None)
    if frame.startswith(_REFUSED):
        number = frame[len(_REFUSED) :]
        return Reply(int(number)) if number.isdigit() else None
    rssi_dbm = _rssi(frame[1:5])
    if rssi_dbm is None:
        return None
    return Heard(frame[1 + PREFIX_BYTES :], rssi_dbm, int(frame[5:9], 16), int(frame[9:13], 16))


def _rssi(text: bytes) -> int | None:
    """16 bits in two's complement, or a decimal number with its sign; None when no radio hears that."""
    if all(b in _HEX for b in text):
        value = int(text, 16)
        value -= 0x10000 if value >= 0x8000 else 0
    else:
        try:
            value = int(text)
        except ValueError:
            return None
    return value if -200 <= value <= 50 else None
