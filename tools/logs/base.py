"""What all log readers share: lines out of plain and compressed files, and honest errors."""

from __future__ import annotations

import bz2
import gzip
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Protocol, cast

from shared.messages import Observation

MAX_LINE_BYTES = 1_000_000


class LogError(Exception):
    """A log that cannot be used; the text is one line that names the file and, where there is one, the line."""


class LogReader(Protocol):
    """Gives the observations of a log once, in the order of the file.

    `truncated` is None, or, after the last observation, one line that says where a cut file ended.
    """

    @property
    def truncated(self) -> str | None: ...

    def __iter__(self) -> Iterator[Observation]: ...


@dataclass(frozen=True, slots=True)
class Line:
    number: int
    text: str
    complete: bool  # False where the file ended without a line feed


class LineSource:
    """The lines of a plain, .gz or .bz2 file; a cut stream ends the lines and is remembered in `cut`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cut: str | None = None
        if not path.is_file():
            raise LogError(f"{path}: {'is not a file' if path.exists() else 'no such file'}")

    def __iter__(self) -> Iterator[Line]:
        number = 0
        try:
            with self._open() as stream:
                while raw := stream.readline(MAX_LINE_BYTES):
                    number += 1
                    yield self._line(raw, number)
        except EOFError:
            self.cut = f"{self.path}: compressed stream is cut after line {number}"
        except (OSError, zlib.error) as error:
            if number == 0:
                raise LogError(f"{self.path}: cannot be read: {error}") from error
            self.cut = f"{self.path}: damaged after line {number}: {error}"

    def _open(self) -> BinaryIO:
        if self.path.suffix == ".gz":
            return cast("BinaryIO", gzip.open(self.path, "rb"))
        if self.path.suffix == ".bz2":
            return cast("BinaryIO", bz2.open(self.path, "rb"))
        return self.path.open("rb")

    def _line(self, raw: bytes, number: int) -> Line:
        if len(raw) >= MAX_LINE_BYTES:
            raise LogError(f"{self.path}: line {number} is longer than {MAX_LINE_BYTES} bytes")
        # Comments and host names are in whatever the writer's language was; readings are plain digits.
        return Line(number, raw.decode("ascii", errors="replace"), raw.endswith(b"\n"))
