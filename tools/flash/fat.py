"""Puts files on the boot partition of an image file, without mounting it: mtools does that with no root rights."""

from __future__ import annotations

import shutil
import struct
import subprocess
from dataclasses import dataclass
from pathlib import Path

from shared.command_line import Refused

_SECTOR = 512
_FAT_TYPES = frozenset({0x0B, 0x0C, 0x0E})
_TIMEOUT_S = 600.0


@dataclass(frozen=True, slots=True)
class BootPartition:
    """The first FAT partition of `image`; raises `Refused` when there is none."""

    image: Path
    offset: int

    def read(self, name: str) -> str:
        return self._mtools("mtype", [f"::{name}"], None).decode("utf-8", "replace")

    def write(self, name: str, data: bytes) -> None:
        self._mtools("mcopy", ["-o", "-", f"::{name}"], data)

    def has(self, name: str) -> bool:
        return (
            name.lower()
            in self._mtools("mdir", ["-b", "::"], None).decode("utf-8", "replace").lower().replace("::/", "").split()
        )

    def _mtools(self, command: str, words: list[str], data: bytes | None) -> bytes:
        if shutil.which(command) is None:
            raise Refused(f"{command} is missing: sudo apt install mtools")
        found = subprocess.run(
            [command, "-i", f"{self.image}@@{self.offset}", *words],
            input=data,
            capture_output=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
        if found.returncode:
            reason = " ".join(found.stderr.decode("utf-8", "replace").split())
            raise Refused(f"{self.image}: {reason or command + ' failed'}")
        return found.stdout


def boot_partition(image: Path) -> BootPartition:
    with image.open("rb") as file:
        table = file.read(_SECTOR)
    if len(table) < _SECTOR or table[510:] != b"\x55\xaa":
        raise Refused(f"{image}: is no disk image; unpack it first when it ends in .xz or .zip")
    for entry in range(446, 510, 16):
        kind, first = table[entry + 4], struct.unpack_from("<I", table, entry + 8)[0]
        if kind in _FAT_TYPES and first:
            return BootPartition(image, first * _SECTOR)
    raise Refused(f"{image}: has no boot partition; is it a Raspberry Pi OS image?")
