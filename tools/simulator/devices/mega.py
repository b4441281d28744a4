"""The station's Arduino Mega, emulated: the real firmware's hex on an ATmega2560 of libsimavr.

`LiveMega` runs by the wall's time, with pseudo-terminals for USB and the two radios. `StepMega` has virtual time: each
call moves it, the same bytes give the same answer. Both are programs of their own (`mega_host/`), which end with this
process, however it ends.
"""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from tools.simulator.devices.mega_build import MegaFiles, MegaUnavailableError

_ANSWER_S = 60.0  # an emulated second takes a third of one, longer on a busy machine
_START_S = 10.0
_END_S = 3.0
_MOST_AT_ONCE_BYTES = 8_192
_PORTS = 3


class MegaError(Exception):
    """The emulation died or does not answer."""


@dataclass(frozen=True, slots=True)
class MegaEvent:
    """`kind`: "reset"; "baud", with port and rate; "resetb", with radio and level; "crashed"."""

    kind: str
    values: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class MegaOutput:
    """What left the Mega while it ran, and what happened."""

    now_us: int
    usb: bytes
    radios: tuple[bytes, bytes]
    events: tuple[MegaEvent, ...]


def _event(line: str) -> MegaEvent:
    _, kind, *values = line.split()
    return MegaEvent(kind, tuple(int(value) for value in values))


class _Program:
    """The running host, its commands in and its lines out."""

    def __init__(self, arguments: list[str]) -> None:
        self._process = subprocess.Popen(
            arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        self._pending = bytearray()
        try:
            self.until("ready", _START_S)
        except MegaError as error:
            self.close()
            self.close_output()
            raise MegaError(f"{error}: {' '.join(arguments)}") from error

    def tell(self, command: str) -> None:
        try:
            _pipe(self._process.stdin).write(command.encode() + b"\n")
            _pipe(self._process.stdin).flush()
        except (OSError, ValueError) as error:
            raise MegaError(f"the emulated Mega has ended: {error}") from error

    def line(self, timeout_s: float) -> str | None:
        """The next line; None when none came in time. Raises `MegaError` at the end of the program."""
        until_s = time.monotonic() + timeout_s
        fd = _pipe(self._process.stdout).fileno()
        while b"\n" not in self._pending:
            if not select.select([fd], [], [], max(0.0, until_s - time.monotonic()))[0]:
                return None
            data = os.read(fd, 65_536)
            if not data:
                raise MegaError("the emulated Mega has ended")
            self._pending += data
        line, _, rest = bytes(self._pending).partition(b"\n")
        self._pending = bytearray(rest)
        return line.decode()

    def until(self, word: str, timeout_s: float) -> tuple[str, list[MegaEvent]]:
        """The line that begins with `word`, and the events before it."""
        until_s = time.monotonic() + timeout_s
        events: list[MegaEvent] = []
        while (line := self.line(max(0.0, until_s - time.monotonic()))) is not None:
            if line.startswith(word):
                return line, events
            if line.startswith("event"):
                events.append(_event(line))
        raise MegaError(f"the emulated Mega did not answer in {timeout_s:g} s")

    def close(self) -> None:
        with contextlib.suppress(OSError):
            _pipe(self._process.stdin).close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(_END_S)

    def close_output(self) -> None:
        _pipe(self._process.stdout).close()


def _pipe(pipe: IO[bytes] | None) -> IO[bytes]:
    if pipe is None:
        raise MegaError("the emulated Mega has no pipes")
    return pipe


class StepMega:
    """Virtual time: nothing happens between two calls of `run`. Raises `MegaError` when the emulation ends."""

    def __init__(self, files: MegaFiles, boot_loader: Path | None = None) -> None:
        self._program = _Program([str(files.host), "step", str(files.firmware), *_optional(boot_loader)])

    def __enter__(self) -> StepMega:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(self, us: int, usb: bytes = b"", radios: tuple[bytes, bytes] = (b"", b"")) -> MegaOutput:
        """Bytes come in on the three ports, each at its rate, and `us` microseconds pass. At most 8 KiB a port."""
        ports = (usb, *radios)
        if max(len(data) for data in ports) > _MOST_AT_ONCE_BYTES:
            raise ValueError(f"more than {_MOST_AT_ONCE_BYTES} bytes at once")
        self._program.tell(f"run {us} " + " ".join(data.hex() or "-" for data in ports))
        line, events = self._program.until("ran", _ANSWER_S)
        _, now_us, *hexes = line.split()
        out = [b"" if text == "-" else bytes.fromhex(text) for text in hexes]
        return MegaOutput(int(now_us), out[0], (out[1], out[2]), tuple(events))

    def reset(self) -> None:
        """The button."""
        self._program.tell("reset")

    def power_cycle(self) -> None:
        self._program.tell("unplug")
        self._program.tell("plug")

    def hang(self) -> None:
        """The main loop stays where it is until the next reset."""
        self._program.tell("hang")

    def mute(self, port: int) -> None:
        """A port's sending interrupt does nothing until the next reset."""
        self._program.tell(f"mute {port}")

    def close(self) -> None:
        self._program.close()
        self._program.close_output()


class LiveMega:
    """The wall's time. `usb`, `radio_a` and `radio_b` are names that serial drivers open.

    Opening `usb` resets the Mega, as DTR does on a real one. `on_event` is called from this object's own thread.
    Raises `MegaError`.
    """

    def __init__(
        self,
        files: MegaFiles,
        boot_loader: Path | None = None,
        on_event: Callable[[MegaEvent], None] = lambda _: None,
    ) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="mega-")
        names = [Path(self._folder.name) / name for name in ("usb", "radio_a", "radio_b")]
        self.usb, self.radio_a, self.radio_b = (str(name) for name in names)
        self._on_event = on_event
        self._answered = threading.Event()
        try:
            self._program = _Program(
                [str(files.host), "live", *map(str, names), str(files.firmware), *_optional(boot_loader)]
            )
        except (MegaError, MegaUnavailableError, OSError):
            self._folder.cleanup()
            raise
        self._thread = threading.Thread(target=self._listen, name="emulated mega", daemon=True)
        self._thread.start()

    def __enter__(self) -> LiveMega:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def reset(self) -> None:
        self._tell("reset")

    def hang(self) -> None:
        self._tell("hang")

    def unplug(self) -> None:
        """USB and the power go; the port's name vanishes."""
        self._tell("unplug")

    def plug(self) -> None:
        self._tell("plug")

    def close(self) -> None:
        """End the emulation; may be called twice."""
        self._program.close()
        self._thread.join(_END_S)
        self._program.close_output()
        self._folder.cleanup()

    def _tell(self, command: str) -> None:
        """Returns when it has been carried out."""
        self._answered.clear()
        self._program.tell(command)
        self._program.tell("ping")
        if not self._answered.wait(_ANSWER_S):
            raise MegaError(f"the emulated Mega did not answer in {_ANSWER_S:g} s")

    def _listen(self) -> None:
        with contextlib.suppress(MegaError):
            while True:
                line = self._program.line(_ANSWER_S)
                if line == "pong":
                    self._answered.set()
                elif line is not None and line.startswith("event"):
                    self._on_event(_event(line))


def _optional(boot_loader: Path | None) -> list[str]:
    if boot_loader is None:
        return []
    if not boot_loader.is_file():
        raise MegaUnavailableError(f"{boot_loader} is missing: install arduino-core-avr")
    return [str(boot_loader)]
