"""Fetches what the robot installs, for its processor, so that the Pi needs no network."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from packaging.markers import Marker

from shared.command_line import Refused

PYTHONS = ("3.11", "3.13")  # of Raspberry Pi OS and Debian 12 and 13
_PLATFORMS = ("manylinux_2_28_aarch64", "manylinux_2_27_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64")
_TIMEOUT_S = 1800.0
_APP = "low_bandwidth_mapper"

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Pin:
    """A line of a lock: `requirement` with its marker, and the hashes of all files that are that release."""

    requirement: str
    marker: Marker | None
    hashes: tuple[str, ...]

    def is_for(self, python: str) -> bool:
        """Whether a 64 bit Raspberry Pi with this Python installs it."""
        target = {
            "platform_machine": "aarch64",
            "sys_platform": "linux",
            "platform_system": "Linux",
            "os_name": "posix",
            "platform_python_implementation": "CPython",
            "implementation_name": "cpython",
            "python_version": python,
            "python_full_version": f"{python}.0",
        }
        return self.marker is None or self.marker.evaluate(target)

    def line(self) -> str:
        return " ".join([self.requirement, *(f"--hash={h}" for h in self.hashes)])


def read_lock(text: str) -> list[Pin]:
    pins = []
    for line in text.replace("\\\n", " ").splitlines():
        head, *hashes = line.strip().split("--hash=")
        requirement, _, marker = (part.strip() for part in head.partition(";"))
        if requirement and not requirement.startswith("#"):
            pins.append(Pin(requirement, Marker(marker) if marker else None, tuple(h.strip() for h in hashes)))
    return pins


def fetch(lock: Path, project: Path, into: Path, say: Say) -> list[str]:
    """Wheels for both Pythons, of pip and of the project itself; returns the pinned requirements with their markers.

    Raises `Refused` when one cannot be had.
    """
    pins = read_lock(lock.read_text(encoding="utf-8"))
    into.mkdir(parents=True, exist_ok=True)
    sources = [pin for pin in pins if pin.requirement.startswith("hokuyolx")]  # has no wheel; it is pure Python
    for python in PYTHONS:
        say(f"packages for Python {python}")
        wanted = [pin for pin in pins if pin not in sources and pin.is_for(python)]
        _download(wanted, python, into)
    say("pip, hokuyolx and the app itself")
    _pip("download", "--no-deps", "--dest", str(into), "pip")
    _pip_pinned(sources, into, "wheel", "--wheel-dir", str(into))
    _forget_builds(project, into)
    _pip("wheel", "--no-deps", "--wheel-dir", str(into), str(project))
    return [f"{pin.requirement} ; {pin.marker}" if pin.marker else pin.requirement for pin in pins]


def _forget_builds(project: Path, into: Path) -> None:
    """Setuptools puts all that lies in build/lib into a wheel, modules too that are gone; two wheels pip refuses."""
    shutil.rmtree(project / "build" / "lib", ignore_errors=True)
    for wheel in into.glob(f"{_APP}-*.whl"):
        wheel.unlink()


def download_wheel(requirement: str, sha256: str, python: str, into: Path) -> None:
    """One wheel for another Python than the app's. Raises `Refused`."""
    _download([Pin(requirement, None, (f"sha256:{sha256}",))], python, into)


def _download(pins: list[Pin], python: str, into: Path) -> None:
    platforms = [word for platform in _PLATFORMS for word in ("--platform", platform)]
    target = [*platforms, "--python-version", python, "--implementation", "cp"]
    _pip_pinned(pins, into, "download", "--only-binary=:all:", *target, "--dest", str(into))


def _pip_pinned(pins: list[Pin], into: Path, *words: str) -> None:
    """Call pip for exactly these files, told by their hashes."""
    with_hashes = into / "requirements.tmp"
    with_hashes.write_text("\n".join(pin.line() for pin in pins) + "\n", encoding="utf-8")
    try:
        _pip(*words, "--no-deps", "--require-hashes", "--requirement", str(with_hashes))
    finally:
        with_hashes.unlink()


def _pip(*words: str) -> None:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", *words]
    found = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
    if found.returncode:
        reason = re.sub(r"\s+", " ", found.stderr.strip().splitlines()[-1]) if found.stderr.strip() else "no reason"
        raise Refused(f"pip {words[0]} failed: {reason}; is the network there?")
