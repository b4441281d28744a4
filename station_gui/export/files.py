"""Files that are there whole or not at all."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


class ExportError(OSError):
    """Nothing was written; the text names the file and what to do."""

    def __str__(self) -> str:
        return f"{self.filename}: cannot be written: {self.strerror}"


def write_whole(path: Path, data: bytes) -> None:
    """Write all of it or nothing; an older file of this name gives way in one stroke. Raises `ExportError`."""
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink()
        raise ExportError(error.errno, f"{error.strerror}; choose another folder", str(path)) from error
