"""Builds what the emulated Mega needs: the firmware's hex and the program that runs it."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
BOOT_LOADER = Path("/usr/share/arduino/hardware/arduino/avr/bootloaders/stk500v2/stk500boot_v2_mega2560.hex")
_BUILD_TIMEOUT_S = 120.0
_FIRMWARE = ROOT / "arduino" / "transceiver"
_HOST = Path(__file__).with_name("mega_host")


class MegaUnavailableError(Exception):
    """The Mega cannot be emulated here; the text says what is missing."""


@dataclass(frozen=True, slots=True)
class MegaFiles:
    host: Path
    firmware: Path


def build_mega() -> MegaFiles:
    """Build what is not up to date. Raises `MegaUnavailableError`."""
    for tool, package in (("make", "make"), ("cc", "gcc"), ("avr-gcc", "gcc-avr and avr-libc")):
        if shutil.which(tool) is None:
            raise MegaUnavailableError(f"{tool} is missing: install {package}, or run `make setup`")
    if not Path("/usr/include/simavr/sim_avr.h").is_file():
        raise MegaUnavailableError("libsimavr is missing: install libsimavr-dev and libelf-dev, or run `make setup`")
    build = ROOT / "build"
    _make(_FIRMWARE, "firmware", build / "transceiver")
    _make(_HOST, str(build / "mega_host" / "mega_host"), build / "mega_host")
    return MegaFiles(build / "mega_host" / "mega_host", build / "transceiver" / "transceiver.hex")


def build_core_library() -> Path:
    """The firmware's core for this machine, with sanitizers. Raises `MegaUnavailableError`."""
    if shutil.which("make") is None or shutil.which("cc") is None:
        raise MegaUnavailableError("make or cc is missing: install make and gcc, or run `make setup`")
    _make(_FIRMWARE, "library", ROOT / "build" / "transceiver")
    return ROOT / "build" / "transceiver" / "libtransceiver.so"


def _make(folder: Path, target: str, build: Path) -> None:
    command = ["make", "-s", "-C", str(folder), f"BUILD={build}", target]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_BUILD_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise MegaUnavailableError(f"building {target} in {folder} took longer than {_BUILD_TIMEOUT_S:g} s") from error
    if done.returncode != 0:
        raise MegaUnavailableError(f"building {target} in {folder} failed:\n{done.stderr}")
