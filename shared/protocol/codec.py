"""Messages to datagrams and back.

A datagram is version (1 byte), type (1), body, CRC-32 of all before it (4). A command's body begins with its number.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

from shared.messages import Message, NumberedCommand
from shared.protocol import wire
from shared.protocol.fields import Reader, WireError

_HEAD_BYTES = 2
_CRC_BYTES = 4


_COMMANDS = wire.COMMANDS | wire.BRIEF


def encode(message: Message, brief: bool = False) -> bytes:
    """The datagram of a message. `brief`: a command in as few bytes as it can be said in, for LoRa."""
    if isinstance(message, NumberedCommand):
        type_id = (wire.BRIEF_TYPE_OF if brief else wire.TYPE_OF)[type(message.command)]
        body = wire.COMMAND_NUMBER.write(message.number) + _COMMANDS[type_id].write(message.command)
    else:
        type_id = wire.TYPE_OF[type(message)]
        body = wire.REPORTS[type_id].write(message)
    head = bytes((wire.VERSION, type_id)) + body
    return head + zlib.crc32(head).to_bytes(_CRC_BYTES, "little")


@dataclass(slots=True)
class DecodeCounts:
    """What came in; foreign bytes are counted and dropped, never an error."""

    good: int = 0
    damaged: int = 0  # too short, or the CRC is wrong
    malformed: int = 0  # the CRC is right and the body is not
    other_version: int = 0
    other_version_seen: int = 0  # the last of them


class Decoder:
    """Decodes one side's datagrams and counts what could not be decoded."""

    def __init__(self) -> None:
        self.counts = DecodeCounts()

    def decode(self, datagram: bytes) -> Message | None:
        """The message, or None for bytes that are none. Never raises."""
        if len(datagram) < _HEAD_BYTES + _CRC_BYTES or zlib.crc32(datagram[:-_CRC_BYTES]) != int.from_bytes(
            datagram[-_CRC_BYTES:], "little"
        ):
            self.counts.damaged += 1
            return None
        if datagram[0] != wire.VERSION:
            self.counts.other_version += 1
            self.counts.other_version_seen = datagram[0]
            return None
        try:
            message = _read(datagram[1], Reader(datagram[_HEAD_BYTES:-_CRC_BYTES]))
        except WireError:
            self.counts.malformed += 1
            return None
        self.counts.good += 1
        return message


def _read(type_id: int, reader: Reader) -> Message:
    message: Message
    if type_id in _COMMANDS:
        number = wire.COMMAND_NUMBER.read(reader)
        message = NumberedCommand(number, _COMMANDS[type_id].read(reader))
    elif type_id in wire.REPORTS:
        message = wire.REPORTS[type_id].read(reader)
    else:
        raise WireError(f"unknown type {type_id}")
    if not reader.finished:
        raise WireError("bytes after the last field")
    return message
