"""How single values are laid out on the wire; all numbers little-endian.

Reading foreign bytes raises `WireError` and nothing else; `codec.decode` catches it and counts.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

MAX_ITEMS = 16_384  # longest array that is believed


class WireError(Exception):
    """Bytes that are no message."""


class Reader:
    """Takes values off the front of a datagram's body."""

    def __init__(self, body: bytes) -> None:
        self._body = body
        self._at = 0

    def take(self, count: int) -> bytes:
        end = self._at + count
        if end > len(self._body):
            raise WireError(f"{count} bytes wanted, {len(self._body) - self._at} left")
        taken = self._body[self._at : end]
        self._at = end
        return taken

    def rest(self) -> bytes:
        return self._body[self._at :]

    def skip(self, count: int) -> None:
        self.take(count)

    @property
    def finished(self) -> bool:
        return self._at == len(self._body)


class Field(Protocol):
    """A kind of value: writes it and reads it back."""

    def write(self, value: Any) -> bytes: ...
    def read(self, reader: Reader) -> Any: ...


class Number:
    """A number in a `struct` format; `scale` is the size of one unit on the wire, None sends it as it is."""

    def __init__(self, code: str, scale: float | None = None, allow_nan: bool = False) -> None:
        self._struct = struct.Struct("<" + code)
        self._scale = scale
        self._allow_nan = allow_nan
        if code not in "fd":
            bits = 8 * self._struct.size
            signed = code.islower()
            self._low, self._high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)

    def write(self, value: float) -> bytes:
        if self._scale is None:
            return self._struct.pack(value)
        if self._allow_nan and not math.isfinite(value):
            return self._struct.pack(self._low)
        lowest = self._low + self._allow_nan  # the lowest number stands for "none"
        return self._struct.pack(max(lowest, min(self._high, round(value / self._scale))))

    def read(self, reader: Reader) -> Any:
        (raw,) = self._struct.unpack(reader.take(self._struct.size))
        if self._scale is None:
            if isinstance(raw, float) and not self._allow_nan and not math.isfinite(raw):
                raise WireError("a number that is none")
            return raw
        if self._allow_nan and raw == self._low:
            return math.nan
        return raw * self._scale


class Flag:
    def write(self, value: bool) -> bytes:
        return b"\x01" if value else b"\x00"

    def read(self, reader: Reader) -> bool:
        byte = reader.take(1)[0]
        if byte > 1:
            raise WireError(f"{byte} is no flag")
        return bool(byte)


class Choice:
    """A member of an `IntEnum`, in one byte."""

    def __init__(self, kind: Callable[[int], Any]) -> None:
        self._kind = kind

    def write(self, value: int) -> bytes:
        return bytes((value,))

    def read(self, reader: Reader) -> Any:
        byte = reader.take(1)[0]
        try:
            return self._kind(byte)
        except ValueError as error:
            raise WireError(str(error)) from error


class Text:
    """UTF-8 of at most 255 bytes; longer texts are cut."""

    def write(self, value: str) -> bytes:
        data = value.encode()[:255].decode("utf-8", "ignore").encode()
        return bytes((len(data),)) + data

    def read(self, reader: Reader) -> str:
        try:
            return reader.take(reader.take(1)[0]).decode()
        except UnicodeDecodeError as error:
            raise WireError("a text that is not UTF-8") from error


@dataclass(frozen=True, slots=True)
class Repeat:
    """Up to 255 values of one kind, as a tuple."""

    item: Field

    def write(self, value: tuple[Any, ...]) -> bytes:
        shown = value[:255]
        return bytes((len(shown),)) + b"".join(self.item.write(v) for v in shown)

    def read(self, reader: Reader) -> tuple[Any, ...]:
        return tuple(self.item.read(reader) for _ in range(reader.take(1)[0]))


@dataclass(frozen=True, slots=True)
class Both:
    """A tuple of two of different kinds."""

    first: Field
    second: Field

    def write(self, value: tuple[Any, Any]) -> bytes:
        return self.first.write(value[0]) + self.second.write(value[1])

    def read(self, reader: Reader) -> tuple[Any, Any]:
        return self.first.read(reader), self.second.read(reader)


@dataclass(frozen=True, slots=True)
class Pair:
    """A tuple of two."""

    item: Field

    def write(self, value: tuple[Any, Any]) -> bytes:
        return self.item.write(value[0]) + self.item.write(value[1])

    def read(self, reader: Reader) -> tuple[Any, Any]:
        return self.item.read(reader), self.item.read(reader)


@dataclass(frozen=True, slots=True)
class Record:
    """A dataclass, field by field in the order of the table."""

    kind: type[Any]
    fields: tuple[tuple[str, Field], ...]

    def write(self, value: Any) -> bytes:
        return b"".join(f.write(getattr(value, name)) for name, f in self.fields)

    def read(self, reader: Reader) -> Any:
        values = {name: f.read(reader) for name, f in self.fields}
        try:
            return self.kind(**values)
        except ValueError as error:
            raise WireError(str(error)) from error


def write_varints(values: NDArray[np.integer]) -> bytes:
    """Unsigned integers below 2**21 as 1 to 3 bytes of 7 bits each, lowest first, the last with its top bit clear."""
    v = np.asarray(values, np.uint32)
    groups = np.stack((v & 0x7F, v >> 7 & 0x7F, v >> 14 & 0x7F), axis=1).astype(np.uint8)
    lengths = 1 + (v > 0x7F) + (v > 0x3FFF)
    position = np.arange(3)
    groups |= np.where(position < lengths[:, None] - 1, 0x80, 0).astype(np.uint8)
    return groups[position < lengths[:, None]].tobytes()


def read_varints(reader: Reader, count: int) -> NDArray[np.int64]:
    """The inverse of `write_varints`."""
    if count == 0:
        return np.zeros(0, np.int64)
    data = np.frombuffer(reader.rest()[: 3 * count], np.uint8)
    ends = np.flatnonzero(data < 0x80)[:count]
    if len(ends) < count:
        raise WireError("varints end early")
    starts = np.concatenate(([0], ends[:-1] + 1))
    lengths = ends - starts + 1
    if lengths.max() > 3:
        raise WireError("a varint of more than three bytes")
    values = np.zeros(count, np.int64)
    for i in range(3):
        has = lengths > i
        values[has] |= (data[starts[has] + i] & 0x7F).astype(np.int64) << 7 * i
    reader.skip(int(ends[-1]) + 1)
    return values


def zigzag(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Small numbers of either sign to small numbers: 0, -1, 1, -2 … become 0, 1, 2, 3 …"""
    return (values << 1) ^ (values >> 63)


def unzigzag(values: NDArray[np.int64]) -> NDArray[np.int64]:
    return (values >> 1) ^ -(values & 1)


def _read_count(reader: Reader) -> int:
    count = int.from_bytes(reader.take(2), "little")
    if count > MAX_ITEMS:
        raise WireError(f"an array of {count} items")
    return count


class DeltaSeries:
    """A series of lengths, NaN where there is none: steps of `unit`, each as its difference from the last one.

    Neighbouring beams mostly differ by little, so most take one byte. A beam without a measurement is a zero
    and does not move the prediction.
    """

    def __init__(self, unit_m: float) -> None:
        self._unit_m = unit_m

    def write(self, value: NDArray[np.float32]) -> bytes:
        valid = np.isfinite(value)
        levels = np.clip(np.round(value[valid].astype(np.float64) / self._unit_m), 0, 65_535).astype(np.int64)
        symbols = np.zeros(len(value), np.int64)
        symbols[valid] = zigzag(np.diff(levels, prepend=0)) + 1
        return len(value).to_bytes(2, "little") + write_varints(symbols)

    def read(self, reader: Reader) -> NDArray[np.float32]:
        symbols = read_varints(reader, _read_count(reader))
        valid = symbols > 0
        ranges = np.full(len(symbols), np.nan, np.float32)
        ranges[valid] = np.cumsum(unzigzag(symbols[valid] - 1)) * self._unit_m
        if (ranges[valid] < 0).any():
            raise WireError("a negative length")
        return ranges


@dataclass(frozen=True, slots=True)
class LevelTable:
    """A (N, `columns`) array in steps of `unit`, two bytes each, signed; what lies outside is clipped."""

    columns: int
    unit: float

    def write(self, value: NDArray[np.floating]) -> bytes:
        levels = np.clip(np.round(np.asarray(value, np.float64) / self.unit), -32_768, 32_767).astype("<i2")
        data: bytes = levels.tobytes()
        return len(value).to_bytes(2, "little") + data

    def read(self, reader: Reader) -> NDArray[np.float32]:
        count = _read_count(reader)
        levels = np.frombuffer(reader.take(2 * count * self.columns), "<i2")
        scaled: NDArray[np.float32] = (levels * self.unit).astype(np.float32).reshape(count, self.columns)
        return scaled


@dataclass(frozen=True, slots=True)
class FloatTable:
    """A (N, `columns`) array of finite 32-bit floats."""

    columns: int

    def write(self, value: NDArray[np.floating]) -> bytes:
        data: bytes = np.asarray(value, "<f4").tobytes()
        return len(value).to_bytes(2, "little") + data

    def read(self, reader: Reader) -> NDArray[np.float32]:
        count = _read_count(reader)
        values = np.frombuffer(reader.take(4 * count * self.columns), "<f4").astype(np.float32)
        if not np.isfinite(values).all():
            raise WireError("a number that is none")
        return values.reshape(count, self.columns)


@dataclass(frozen=True, slots=True)
class DeltaTable:
    """A (N, columns) array on a grid of `units`, each row as its difference from the one before; most take a byte a
    column. What is farther than a difference of 2**20 units is clipped.
    """

    units: tuple[float, ...]

    def write(self, value: NDArray[np.floating]) -> bytes:
        levels = np.round(np.asarray(value, np.float64) / self.units).astype(np.int64)
        steps = np.diff(levels, axis=0, prepend=np.zeros((1, len(self.units)), np.int64))
        symbols = zigzag(np.clip(steps, -(1 << 20) + 1, (1 << 20) - 1))
        return len(value).to_bytes(2, "little") + write_varints(symbols.ravel())

    def read(self, reader: Reader) -> NDArray[np.float32]:
        count, columns = _read_count(reader), len(self.units)
        steps = unzigzag(read_varints(reader, count * columns)).reshape(count, columns)
        scaled: NDArray[np.float32] = (np.cumsum(steps, axis=0) * self.units).astype(np.float32)
        return scaled


class IndexPairs:
    """A (M, 2) array of indices."""

    def write(self, value: NDArray[np.uint16]) -> bytes:
        return len(value).to_bytes(2, "little") + write_varints(value.ravel())

    def read(self, reader: Reader) -> NDArray[np.uint16]:
        values = read_varints(reader, 2 * _read_count(reader))
        if len(values) and values.max() > 0xFFFF:
            raise WireError("an index over 65535")
        return values.astype(np.uint16).reshape(-1, 2)
