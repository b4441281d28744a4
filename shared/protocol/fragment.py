"""Datagrams as one stream of bytes, cut into segments of any length, sans-I/O.

Each datagram is preceded by its length (7 bits a byte, lowest first, the highest bit says "more"): 1 byte up to 127,
2 up to 16383. Segments carry nothing of their own: the stream is reliable and in order, so that small datagrams share
a packet and large ones fill theirs to the last byte.
"""

from __future__ import annotations

from collections import deque

_LONGEST_LENGTH_BYTES = 3


class StreamError(Exception):
    """The other side's stream makes no sense: the session must begin anew."""


def length_prefix(length: int) -> bytes:
    prefix = bytearray()
    while length >= 0x80:
        prefix.append(length & 0x7F | 0x80)
        length >>= 7
    prefix.append(length)
    return bytes(prefix)


class Cutter:
    """Takes datagrams, gives segments."""

    def __init__(self) -> None:
        self._waiting: deque[bytes] = deque()
        self._offset = 0  # into the first of them
        self.waiting_bytes = 0

    def add(self, datagram: bytes) -> None:
        framed = length_prefix(len(datagram)) + datagram
        self._waiting.append(framed)
        self.waiting_bytes += len(framed)

    def cut(self, most_bytes: int) -> bytes:
        """The next bytes of the stream, at most so many."""
        segment = bytearray()
        while self._waiting and len(segment) < most_bytes:
            first = self._waiting[0]
            end = min(len(first), self._offset + most_bytes - len(segment))
            segment += first[self._offset : end]
            self._offset = end
            if end == len(first):
                self._waiting.popleft()
                self._offset = 0
        self.waiting_bytes -= len(segment)
        return bytes(segment)


class Assembler:
    """Takes segments in order, gives datagrams; never holds more than one and a segment."""

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._buffer = bytearray()

    def feed(self, segment: bytes) -> list[bytes]:
        """The datagrams that it completes. Raises `StreamError` for a length that no datagram has."""
        self._buffer += segment
        datagrams: list[bytes] = []
        while (start_and_end := self._next()) is not None:
            start, end = start_and_end
            datagrams.append(bytes(self._buffer[start:end]))
            del self._buffer[:end]
        return datagrams

    def _next(self) -> tuple[int, int] | None:
        """Where the first datagram begins and ends, once it is whole."""
        length = 0
        for i, byte in enumerate(self._buffer[:_LONGEST_LENGTH_BYTES]):
            length |= (byte & 0x7F) << 7 * i
            if byte < 0x80:
                if not 0 < length <= self._most_bytes:
                    raise StreamError(f"a datagram of {length} bytes")
                end = i + 1 + length
                return (i + 1, end) if end <= len(self._buffer) else None
        if len(self._buffer) >= _LONGEST_LENGTH_BYTES:
            raise StreamError("a length without an end")
        return None
