"""Missions in MCAP files: everything that was received, as it was received, with the configuration at the head.

A channel per kind of message; its payload is the datagram. Chunks are small and reach the disk as they are made,
so that a station that is killed loses about a second, and a file without an end can still be read.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Message as McapMessage
from mcap.records import Metadata
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.writer import CompressionType, Writer

from shared.protocol import wire

_CHUNK_BYTES = 8_192
_PROFILE = "low-bandwidth-mapper"
_ENCODING = "low-bandwidth-mapper.datagram"
_HEAD = "mission"
_MOST_OF_A_NAME = 10_000
_RECORD_LIMIT_BYTES = 4_194_304
_BROKEN = (McapError, CRCValidationError, struct.error, EOFError, ValueError, OSError)


class RecordingError(Exception):
    """A recording that cannot be written or read; the text names the file."""


class Recorder:
    """Writes one mission; not thread-safe. `wall_ns` is the time of day at station time zero.

    Where a file of that name exists the name gets a number: a recording is never written over.
    """

    def __init__(self, path: Path, head: dict[str, str], wall_ns: int) -> None:
        self.error: str | None = None  # set when the disk refused; recording has ended then, the mission goes on
        self._wall_ns = wall_ns
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.path = _unused(path)
            self._file: BinaryIO | None = self.path.open("xb")
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written: {error.strerror}") from error
        self._writer = Writer(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile=_PROFILE, library=f"{_PROFILE} wire {wire.VERSION}")
        self._writer.add_metadata(_HEAD, head)
        self._channels: dict[int, int] = {}
        self._sequence = 0

    def write(self, datagram: bytes, time_s: float) -> None:
        """Keep a datagram that came at station time `time_s`. Never raises: a full disk ends the recording."""
        if self._file is None or len(datagram) < 2:
            return
        try:
            self._write(datagram, self._wall_ns + round(time_s * 1e9))
        except OSError as error:
            self.error = f"{self.path}: recording ended: {error.strerror or error}"
            self._let_go()

    def close(self) -> None:
        """Write the index; may be called twice."""
        if self._file is None:
            return
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
        except OSError as error:
            self.error = f"{self.path}: recording has no index: {error.strerror or error}"
        self._let_go()

    def _write(self, datagram: bytes, time_ns: int) -> None:
        type_id = datagram[1]
        if type_id not in self._channels:
            record = (wire.REPORTS | wire.COMMANDS).get(type_id)
            name = record.kind.__name__ if record is not None else f"type{type_id}"
            schema = self._writer.register_schema(name, "", b"")
            self._channels[type_id] = self._writer.register_channel(f"/{name.lower()}", _ENCODING, schema)
        self._sequence += 1
        self._writer.add_message(self._channels[type_id], time_ns, datagram, time_ns, self._sequence)
        if self._file is not None:
            self._file.flush()

    def _let_go(self) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.close()
            self._file = None


def _unused(path: Path) -> Path:
    names = (path, *(path.with_stem(f"{path.stem}-{i}") for i in range(2, _MOST_OF_A_NAME)))
    return next((name for name in names if not name.exists()), path)


@dataclass(frozen=True, slots=True)
class Recorded:
    time_s: float  # since the first datagram of the recording
    datagram: bytes


class MissionReader:
    """Reads a recording in its order; what can be read of a damaged one is read, then `truncated` tells."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.truncated: str | None = None  # one line that names the file, once the reading ended early
        self.head = self._read_head()

    def _read_head(self) -> dict[str, str]:
        try:
            with self._path.open("rb") as stream:
                header = make_reader(stream).get_header()
                stream.seek(0)
                head = next((m.metadata for m in _metadata(stream) if m.name == _HEAD), {})
        except OSError as error:
            raise RecordingError(f"{self._path}: cannot be read: {error.strerror}") from error
        except _BROKEN as error:
            raise RecordingError(f"{self._path}: is no MCAP file, or its head is damaged: {error}") from error
        if header.profile != _PROFILE:
            raise RecordingError(f"{self._path}: is an MCAP file of another program ({header.profile or 'no profile'})")
        return dict(head)

    def __iter__(self) -> Iterator[Recorded]:
        first_ns: int | None = None
        with self._path.open("rb") as stream:
            messages = self._messages(stream)
            for message in messages:
                first_ns = message.log_time if first_ns is None else first_ns
                yield Recorded((message.log_time - first_ns) / 1e9, message.data)

    def _messages(self, stream: BinaryIO) -> Iterator[McapMessage]:
        try:
            reader = NonSeekingReader(stream, record_size_limit=_RECORD_LIMIT_BYTES)
            for _, _, message in reader.iter_messages(log_time_order=False):
                yield message
        except _BROKEN as error:
            self.truncated = f"{self._path}: the recording is cut short or damaged ({type(error).__name__})"


def _metadata(stream: BinaryIO) -> Iterator[Metadata]:
    for record in StreamReader(stream, record_size_limit=_RECORD_LIMIT_BYTES).records:
        if isinstance(record, Metadata):
            yield record
