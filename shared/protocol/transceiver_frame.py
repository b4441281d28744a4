"""Frames of the transceiver's USB protocol, sans-I/O: number, fields and CRC-16, stuffed by COBS.

Consistent overhead byte stuffing (Cheshire and Baker 1999) puts one length byte before each run of bytes without a
zero, so that a zero ends a frame and stands nowhere else: after any damage the next frame is read again.
"""

from __future__ import annotations

import struct

from shared.protocol.crc16 import crc16
from shared.protocol.transceiver import LAYOUT_OF, LAYOUTS, MAX_BODY_BYTES, MAX_DATA_BYTES, Frame

_CRC_BYTES = 2
_MAX_STUFFED_BYTES = 1 + 1 + MAX_BODY_BYTES + _CRC_BYTES  # one length byte: a frame is shorter than 254 bytes


def encode(frame: Frame) -> bytes:
    """The bytes on the wire, the zero at the end included. Raises `struct.error` for a number that does not fit."""
    layout = LAYOUT_OF[type(frame)]
    body = struct.pack(layout.format, *(getattr(frame, name) for name, _ in layout.codes))
    if layout.has_data:
        data = frame.data  # type: ignore[union-attr]
        if not 0 < len(data) <= MAX_DATA_BYTES:
            raise ValueError(f"{len(data)} bytes of data; a frame takes 1 to {MAX_DATA_BYTES}")
        body += data
    content = bytes((layout.number,)) + body
    return stuff(content + crc16(content).to_bytes(_CRC_BYTES, "little")) + b"\0"


def stuff(content: bytes) -> bytes:
    """COBS of up to 253 bytes."""
    return b"".join(bytes((len(run) + 1,)) + run for run in content.split(b"\0"))


def unstuff(stuffed: bytes) -> bytes | None:
    """The inverse of `stuff`; None when the lengths lead past the end."""
    runs = []
    at = 0
    while at < len(stuffed):
        end = at + stuffed[at]
        if end > len(stuffed):
            return None
        runs.append(stuffed[at + 1 : end])
        at = end
    return b"\0".join(runs)


class FrameReader:
    """Takes bytes in any portions and gives the frames in them; never holds more than one frame."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._too_long = False
        self.frames = 0
        self.bad_frames = 0

    def feed(self, data: bytes) -> list[Frame]:
        """All frames completed by `data`; what is damaged is counted and dropped."""
        frames = []
        *ended, rest = data.split(b"\0")
        for part in ended:
            self._collect(part)
            if (frame := self._finish()) is not None:
                frames.append(frame)
        self._collect(rest)
        return frames

    def _collect(self, part: bytes) -> None:
        self._too_long |= len(self._buffer) + len(part) > _MAX_STUFFED_BYTES
        if not self._too_long:
            self._buffer += part

    def _finish(self) -> Frame | None:
        stuffed, too_long = bytes(self._buffer), self._too_long
        self._buffer.clear()
        self._too_long = False
        if not stuffed and not too_long:
            return None
        frame = None if too_long else _decode(stuffed)
        if frame is None:
            self.bad_frames += 1
        else:
            self.frames += 1
        return frame


def _decode(stuffed: bytes) -> Frame | None:
    content = unstuff(stuffed)
    if content is None or len(content) <= _CRC_BYTES or crc16(content) != 0:
        return None
    layout = LAYOUTS.get(content[0])
    body = content[1:-_CRC_BYTES]
    if layout is None:
        return None
    data = body[layout.size :]
    if len(body) < layout.size or bool(data) != layout.has_data or len(data) > MAX_DATA_BYTES:
        return None
    values = struct.unpack(layout.format, body[: layout.size])
    frame: Frame = layout.kind(*values, data) if layout.has_data else layout.kind(*values)
    return frame
