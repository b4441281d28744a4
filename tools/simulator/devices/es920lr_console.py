"""The configuration half of an ES920LR: lines in, answers out, as firmware 1.12 gives them."""

from __future__ import annotations

import dataclasses
import math
from typing import Protocol

from shared.link.es920lr.airtime import Modulation
from shared.link.es920lr.settings import ROWS, RadioSettings, Row, SettingsError

VERSION = "VER 1.12"
_LINE_BYTES = 256
_LABEL_WIDTH = 27
_ROWS = {name: row for row in ROWS for name in (row.command, row.short)}
_OK, _UNKNOWN, _BAD_VALUE = "OK\r\n", "NG 001\r\n", "NG 002\r\n"
_PROMPT = "\b" * 20 + " " * 20 + "\b" * 20 + "LORA > "
_HELP = "\r\n\r Configuration Mode\n\r------------------------------------------\n"


class Line(Protocol):
    def say(self, data: bytes) -> float: ...


class Configured(Protocol):
    """The module as its console sees it."""

    @property
    def line(self) -> Line: ...

    @property
    def settings(self) -> RadioSettings: ...

    def change(self, settings: RadioSettings) -> None: ...

    def save(self) -> int | None: ...

    def start(self) -> None: ...


class Console:
    """From one boot to `start`."""

    def __init__(self, module: Configured) -> None:
        self.for_people = False
        self._module = module
        self._line = bytearray()
        self._mode_is_chosen = False
        self._asked: Row | None = None  # a person is asked for this value

    def take(self, byte: int) -> None:
        if byte == 0x08:
            del self._line[-1:]
            return
        self._line.append(byte)
        if self._line.endswith(b"\r\n"):
            line = bytes(self._line[:-2]).partition(b"\x00")[0].decode("latin-1")
            self._line.clear()
            self._obey(line)
        elif len(self._line) >= _LINE_BYTES:
            self._line.clear()

    def _obey(self, line: str) -> None:
        if not self._mode_is_chosen:
            self._choose_mode(line)
        elif self._asked is not None:
            row, self._asked = self._asked, None
            self._say("  is set.\r\n\r\n" if self._set(row, line) else "  is invalid.\r\n\r\n")
            self._say(_PROMPT)
        else:
            started = self._command(line)
            if self.for_people and not started and self._asked is None:
                self._say(_PROMPT)

    def _choose_mode(self, line: str) -> None:
        if line not in {"1", "2", "terminal", "processor"}:
            self._say(_BAD_VALUE)
            return
        self._mode_is_chosen = True
        self.for_people = line in {"1", "terminal"}
        self._say(_OK)
        if self.for_people:
            self._say(f"\r\n\r\n\r Software Version : {VERSION}\r\n{_HELP}{_PROMPT}")

    def _command(self, line: str) -> bool:
        """Whether the configuration is over."""
        name, _, value = line.partition(" ")
        match name:
            case "start" | "z" if not value:
                self._say(_OK)
                self._module.start()
                return True
            case "show" | "y":
                self._say(shown(self._module.settings))
            case "version" | "v":
                self._say(f"\r\n{VERSION}\r\n\r\n" if self.for_people else f"{VERSION}\r\n")
            case "save" | "w":
                refusal = self._module.save()
                self._say(_OK if refusal is None else f"NG {refusal:03d}\r\n")
            case "load" | "x":
                self._say(_OK)
                self._module.change(RadioSettings())
            case "help" | "?":
                self._say(_HELP)
            case _ if name in _ROWS:
                self._setting(_ROWS[name], value)
            case _ if not self.for_people:
                self._say(_UNKNOWN)
        return False

    def _setting(self, row: Row, value: str) -> None:
        if self.for_people:
            self._asked = row
            self._say(f"\r\n  please set {row.label} > ")
        elif row.field == "auto_send_text":
            self._set(row, value[:50])
            self._say(_OK)
        else:
            changed = self._parsed(row, value)
            self._say(_BAD_VALUE if changed is None else _OK)
            if changed is not None:  # after the OK, which still goes out at the old rate
                self._module.change(changed)

    def _set(self, row: Row, value: str) -> bool:
        changed = self._parsed(row, value)
        if changed is not None:
            self._module.change(changed)
        return changed is not None

    def _parsed(self, row: Row, value: str) -> RadioSettings | None:
        settings = self._module.settings
        try:
            new = row.from_command(value)
            if row.field == "bandwidth_hz":
                return _with_bandwidth(settings, new)
            return dataclasses.replace(settings, **{row.field: new})
        except (SettingsError, ValueError, IndexError, KeyError):
            return None

    def _say(self, text: str) -> None:
        self._module.line.say(text.encode("latin-1"))


def _with_bandwidth(settings: RadioSettings, bandwidth_hz: int) -> RadioSettings:
    """A channel that the bandwidth does not have becomes channel 1."""
    try:
        return dataclasses.replace(settings, bandwidth_hz=bandwidth_hz)
    except SettingsError:
        return dataclasses.replace(settings, bandwidth_hz=bandwidth_hz, channel=1)


def shown(settings: RadioSettings) -> str:
    """The answer to `show`."""
    lines = ["\r\n  configuration setting is below.", "\r\n  -------------------------------------"]
    for row in ROWS:
        lines.append(_shown_line(row.label, row.to_show(getattr(settings, row.field))))
        if row.field == "spreading_factor":
            rate_bps = math.ceil(Modulation(settings.bandwidth_hz, settings.spreading_factor).bit_rate_bps)
            lines.append(_shown_line("Effective Bitrate", f"{rate_bps}bps"))
    return "".join(lines) + "\r\n\r\n"


def _shown_line(label: str, value: str) -> str:
    return f"\r\n  {label:<{_LABEL_WIDTH}} : {value}"
