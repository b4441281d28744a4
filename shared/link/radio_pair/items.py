"""What stands in a packet that is not one segment of the stream, sans-I/O.

An item begins with a byte: what it is (3 bits) and a small number (5 bits). Of a segment that is the upper part of the
sequence: with one byte alone a packet that somebody kept from coming could come later as another part of the stream.

    0, 1  Acknowledgement of the bulk, of the commands   number: bytes of the bitmap; base, bitmap
    2     Segment of the commands                        sequence, length, bytes
    3     Now                                            number: its identifier; length, datagram
    4     Now has come                                   number: the identifier
    5     Newest                                         number: slot; length, datagram
    6     Segment of the bulk                            sequence, the rest of the packet
    7     Goodbye
"""

from __future__ import annotations

from dataclasses import dataclass

from shared.link.base import Lane

MOST_SHORT_BYTES = 32  # of a datagram that has to fit into one item
NUMBERS = 32
SEGMENT_HEAD_BYTES = 3
BULK_HEAD_BYTES = 2
SHORT_HEAD_BYTES = 2


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    lane: Lane
    base_low: int
    bitmap: bytes


@dataclass(frozen=True, slots=True)
class SegmentItem:
    lane: Lane
    seq_low: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Now:
    identifier: int
    datagram: bytes


@dataclass(frozen=True, slots=True)
class NowHasCome:
    identifier: int


@dataclass(frozen=True, slots=True)
class Newest:
    slot: int
    datagram: bytes


@dataclass(frozen=True, slots=True)
class Goodbye:
    pass


Item = Acknowledgement | SegmentItem | Now | NowHasCome | Newest | Goodbye
_STREAMS = (Lane.BULK, Lane.COMMAND)
SEQ_MASK = 0x1FFF  # of what a segment says of its number


def write(item: Item) -> bytes:
    match item:
        case Acknowledgement():
            written = bytes((_STREAMS.index(item.lane) << 5 | len(item.bitmap), item.base_low)) + item.bitmap
        case SegmentItem(lane=Lane.BULK):
            written = bytes((6 << 5 | item.seq_low >> 8, item.seq_low & 0xFF)) + item.data
        case SegmentItem():
            written = bytes((2 << 5 | item.seq_low >> 8, item.seq_low & 0xFF, len(item.data))) + item.data
        case Now():
            written = bytes((3 << 5 | item.identifier, len(item.datagram))) + item.datagram
        case NowHasCome():
            written = bytes((4 << 5 | item.identifier,))
        case Newest():
            written = bytes((5 << 5 | item.slot, len(item.datagram))) + item.datagram
        case Goodbye():
            written = bytes((7 << 5,))
    return written


def read(body: bytes) -> tuple[list[Item], bool]:
    """The items, and whether nothing was wrong with them; those before what is wrong are good."""
    found: list[Item] = []
    at = 0
    while at < len(body):
        item, at = _read_one(body, at)
        if item is None:
            return found, False
        found.append(item)
    return found, True


def _read_one(body: bytes, at: int) -> tuple[Item | None, int]:
    """The item that begins there, and where the next one does."""
    kind, number = body[at] >> 5, body[at] & 0x1F
    rest = body[at + 1 :]
    item: Item | None = None
    took = 1
    if kind in {0, 1} and len(rest) > number:
        item, took = Acknowledgement(_STREAMS[kind], rest[0], rest[1 : 1 + number]), 2 + number
    elif kind == 2 and len(rest) >= 2 and len(rest) >= 2 + rest[1]:
        item, took = SegmentItem(Lane.COMMAND, number << 8 | rest[0], rest[2 : 2 + rest[1]]), 3 + rest[1]
    elif kind in {3, 5} and rest and 0 < rest[0] < len(rest):
        datagram = rest[1 : 1 + rest[0]]
        item = Now(number, datagram) if kind == 3 else Newest(number, datagram)
        took = 2 + rest[0]
    elif kind == 4:
        item = NowHasCome(number)
    elif kind == 6 and rest:
        item, took = SegmentItem(Lane.BULK, number << 8 | rest[0], rest[1:]), 1 + len(rest)
    elif kind == 7:
        item = Goodbye()
    return item, at + took
