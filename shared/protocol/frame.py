"""Datagrams on a stream of bytes, sans-I/O.

A frame is 0xA5 0x5A, the datagram's length (2 bytes, little-endian), a check byte over the length, the datagram.
Content is checked by the datagram's own CRC; after a damaged length the parser looks for the next sync.
"""

from __future__ import annotations

SYNC = b"\xa5\x5a"
HEAD_BYTES = 5
MAX_PAYLOAD_BYTES = 65_000


def _check(length: bytes | bytearray) -> int:
    return (length[0] ^ length[1] ^ 0x5C) & 0xFF


def pack(datagram: bytes) -> bytes:
    """One frame. Raises `ValueError` for a datagram that is empty or too long."""
    if not 0 < len(datagram) <= MAX_PAYLOAD_BYTES:
        raise ValueError(f"a datagram of {len(datagram)} bytes; 1 to {MAX_PAYLOAD_BYTES} fit in a frame")
    length = len(datagram).to_bytes(2, "little")
    return SYNC + length + bytes((_check(length),)) + datagram


class FrameParser:
    """Takes bytes in any portions and gives the datagrams in them; never holds more than one frame."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.dropped_bytes = 0

    def feed(self, data: bytes) -> list[bytes]:
        """All datagrams completed by `data`."""
        self._buffer += data
        datagrams: list[bytes] = []
        while (datagram := self._next()) is not None:
            datagrams.append(datagram)
        return datagrams

    def _next(self) -> bytes | None:
        while True:
            self._seek_sync()
            if len(self._buffer) < HEAD_BYTES:
                return None
            length = int.from_bytes(self._buffer[2:4], "little")
            if self._buffer[4] == _check(self._buffer[2:4]) and 0 < length <= MAX_PAYLOAD_BYTES:
                break
            self._drop(1)
        if len(self._buffer) < HEAD_BYTES + length:
            return None
        datagram = bytes(self._buffer[HEAD_BYTES : HEAD_BYTES + length])
        del self._buffer[: HEAD_BYTES + length]
        return datagram

    def _seek_sync(self) -> None:
        at = self._buffer.find(SYNC)
        if at < 0:
            at = len(self._buffer) - (self._buffer[-1:] == SYNC[:1])
        self._drop(at)

    def _drop(self, count: int) -> None:
        self.dropped_bytes += count
        del self._buffer[:count]
