"""Fetches the camera process's own Python 3.9, of Debian 11, and the last pyrealsense2 that knows the L515.

`systemd/camera-packages.txt` names them with their check sums: what differs is refused, wherever it came from, and a
file that lies in the folder already, put there by hand for instance, is taken.
"""

from __future__ import annotations

import hashlib
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from shared.command_line import Refused
from tools.flash.wheels import Say, download_wheel

MIRRORS = ("https://deb.debian.org/debian/", "https://archive.debian.org/debian/")  # old releases move to the second
INTERPRETER = "/opt/robot-app/camera/python"
_TIMEOUT_S = 120.0
_LONGEST_BYTES = 64 << 20


@dataclass(frozen=True, slots=True)
class CameraFile:
    """`path`: below a mirror for a package of Debian's, else the name of a wheel."""

    sha256: str
    path: str

    @property
    def name(self) -> str:
        return PurePosixPath(self.path).name

    def is_at(self, path: Path) -> bool:
        return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == self.sha256


def read_list(text: str) -> list[CameraFile]:
    """Lines as `sha256sum` has them."""
    return [CameraFile(*line.split()) for line in text.splitlines() if line.strip()]


def fetch_camera(packages: Path, into: Path, say: Say) -> list[Path]:
    """The files of the list in the folder `into`. Raises `Refused` when one cannot be had."""
    say("Python 3.9 and pyrealsense2 for the L515")
    into.mkdir(parents=True, exist_ok=True)
    return [_fetched(file, into) for file in read_list(packages.read_text(encoding="utf-8"))]


def _fetched(file: CameraFile, into: Path) -> Path:
    path = into / file.name
    if file.is_at(path):
        return path
    if file.path.startswith("pool/"):
        _download(file, path)
    else:
        name, version = file.name.split("-")[:2]
        download_wheel(f"{name}=={version}", file.sha256, "3.9", into)
    if not file.is_at(path):
        raise Refused(f"{path}: is not what it should be; remove it, or put the right one there")
    return path


def _download(file: CameraFile, path: Path) -> None:
    reasons = []
    for mirror in MIRRORS:
        try:
            with urllib.request.urlopen(mirror + file.path, timeout=_TIMEOUT_S) as answer:  # noqa: S310 - from the list
                data = answer.read(_LONGEST_BYTES)
        except (OSError, urllib.error.URLError) as error:
            reasons.append(f"{mirror}: {error}")
            continue
        if hashlib.sha256(data).hexdigest() == file.sha256:
            path.write_bytes(data)
            return
        reasons.append(f"{mirror}: sends another file")
    raise Refused(f"{file.name} cannot be fetched ({'; '.join(reasons)}); put it into {path.parent} by hand")
