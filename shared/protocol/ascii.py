"""Profile ASCII: messages as lines that a person can read, as the paper sends them over Wi-Fi (paper 1, section 3.6).

The first line is the kind of message, the version and the CRC-32 of all lines after it; then one line for each value:
its name, a blank, the value. Lengths in arrays are whole millimetres, `-` where nothing was measured. The values are
those of the table in `wire`, rounded as in profile FULL, and to ten digits.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.messages import Message, NumberedCommand
from shared.protocol import wire
from shared.protocol.codec import DecodeCounts
from shared.protocol.fields import (
    MAX_ITEMS,
    Choice,
    DeltaSeries,
    Field,
    Flag,
    FloatTable,
    IndexPairs,
    LevelTable,
    Number,
    Reader,
    Record,
    Repeat,
    WireError,
)

_RECORDS = wire.REPORTS | wire.COMMANDS
_TYPE_OF_NAME = {record.kind.__name__.lower(): type_id for type_id, record in _RECORDS.items()}
_LONGEST_BYTES = 65_000
_LARGEST = 1e30
_NOT_THIS = (ValueError, TypeError, OverflowError, struct.error, RecursionError, LookupError, AttributeError)


def encode(message: Message) -> bytes:
    """The lines of a message."""
    lines = []
    inner: object = message
    if isinstance(message, NumberedCommand):
        lines.append(f"number {message.number}")
        inner = message.command
    name = type(inner).__name__.lower()
    _write(_RECORDS[_TYPE_OF_NAME[name]], "", inner, lines)
    body = "".join(f"{line}\n" for line in lines).encode("ascii")
    return f"{name} {wire.VERSION} {zlib.crc32(body):08x}\n".encode("ascii") + body


class Decoder:
    """Decodes one side's messages and counts what could not be decoded."""

    def __init__(self) -> None:
        self.counts = DecodeCounts()

    def decode(self, datagram: bytes) -> Message | None:
        """The message, or None for bytes that are none. Never raises."""
        head, _, body = datagram[:_LONGEST_BYTES].partition(b"\n")
        words = head.decode("ascii", "replace").split(" ")
        if len(words) != 3 or words[2] != f"{zlib.crc32(body):08x}":
            self.counts.damaged += 1
            return None
        if words[1] != str(wire.VERSION):
            self.counts.other_version += 1
            return None
        try:
            message = _message(words[0], body)
        except (WireError, *_NOT_THIS):
            self.counts.malformed += 1
            return None
        self.counts.good += 1
        return message


def _message(name: str, body: bytes) -> Message:
    lines = dict(line.partition(" ")[::2] for line in body.decode("ascii").splitlines())
    type_id = _TYPE_OF_NAME[name]
    number = (
        wire.COMMAND_NUMBER.read(Reader(wire.COMMAND_NUMBER.write(_whole(lines.pop("number")))))
        if (type_id in wire.COMMANDS)
        else None
    )
    value = _read(_RECORDS[type_id], "", lines)
    if lines:
        raise WireError(f"lines that are none: {', '.join(lines)[:80]}")
    message: Message = value if number is None else NumberedCommand(number, value)
    return message


def _write(field: Field, name: str, value: Any, lines: list[str]) -> None:
    if isinstance(field, Record) and not _is_row(field):
        for inner_name, inner in field.fields:
            _write(inner, f"{name}.{inner_name}" if name else inner_name, getattr(value, inner_name), lines)
    else:
        lines.append(f"{name} {_text(field, value)}".rstrip(" "))


def _read(field: Field, name: str, lines: dict[str, str]) -> Any:
    if isinstance(field, Record) and not _is_row(field):
        values = {inner: _read(f, f"{name}.{inner}" if name else inner, lines) for inner, f in field.fields}
        return field.kind(**values)
    # Through the binary field: it refuses what it cannot carry, and rounds as profile FULL does.
    return field.read(Reader(field.write(_value(field, lines.pop(name)))))


def _is_row(record: Record) -> bool:
    """A few numbers that are read better in one line, such as a pose."""
    return 0 < len(record.fields) <= 3 and all(isinstance(field, Number) for _, field in record.fields)


def _text(field: Field, value: Any) -> str:
    shown: str
    match field:
        case Record():
            shown = " ".join(_text(inner, getattr(value, name)) for name, inner in field.fields)
        case Number():
            sent = field.read(Reader(field.write(value)))
            shown = str(sent) if isinstance(sent, int) else f"{sent:.10g}" if math.isfinite(sent) else "-"
        case Flag():
            shown = "yes" if value else "no"
        case Choice():
            shown = f"{int(value)} {value.name.lower()}"
        case DeltaSeries():
            shown = " ".join("-" if math.isnan(v) else str(round(1e3 * v)) for v in value.tolist())
        case LevelTable():
            shown = " ".join(",".join(str(round(1e3 * v)) for v in row) for row in value.tolist())
        case FloatTable():
            shown = " ".join(",".join(f"{v:.9g}" for v in row) for row in value.tolist())
        case IndexPairs():
            shown = " ".join(f"{a}-{b}" for a, b in value.tolist())
        case Repeat(item=Record() as row):
            shown = json.dumps([[getattr(v, name) for name, _ in row.fields] for v in value])
        case _:
            shown = json.dumps(value)
    return shown


def _value(field: Field, text: str) -> Any:
    words = text.split(" ") if text else []
    if len(words) > MAX_ITEMS:
        raise WireError(f"{len(words)} words in a line")
    value: Any
    match field:
        case Record():
            parts = zip(field.fields, words, strict=True)
            value = field.kind(**{name: _value(inner, word) for (name, inner), word in parts})
        case Number():
            value = math.nan if text == "-" else _number(text)
        case Flag():
            value = {"yes": True, "no": False}[text]
        case Choice():
            value = _whole(words[0])
        case DeltaSeries():
            value = np.array([math.nan if word == "-" else 1e-3 * _whole(word) for word in words], np.float32)
        case LevelTable():
            value = 1e-3 * _table(words, ",", field.columns)
        case FloatTable():
            value = _table(words, ",", field.columns)
        case IndexPairs():
            value = _indices(words)
        case _:
            value = _repeated(field, json.loads(text))
    return value


def _whole(word: str) -> int:
    if not word.lstrip("-").isdigit() or len(word) > 20:
        raise WireError(f"{word[:20]!r} is no whole number")
    return int(word)


def _number(word: str) -> float:
    value = float(word) if len(word) <= 30 else math.nan
    if not abs(value) < _LARGEST:
        raise WireError(f"{word[:30]!r} is no number")
    return int(word) if word.lstrip("-").isdigit() else value


def _table(words: list[str], between: str, columns: int) -> NDArray[np.float64]:
    rows = [[_number(part) for part in word.split(between)] for word in words]
    if any(len(row) != columns for row in rows):
        raise WireError("a row of another length")
    return np.array(rows, np.float64).reshape(-1, columns)


def _indices(words: list[str]) -> NDArray[np.uint16]:
    pairs = _table(words, "-", 2)
    if len(pairs) and not 0 <= pairs.min() <= pairs.max() <= 0xFFFF:
        raise WireError("an index over 65535")
    return pairs.astype(np.uint16)


def _repeated(field: Field, value: Any) -> Any:
    if isinstance(field, Repeat) and isinstance(field.item, Record):
        return tuple(field.item.kind(*cells) for cells in value)
    return _tuples(value)


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
