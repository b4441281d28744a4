"""What a calibration found, and how it is written into robot.toml."""

from __future__ import annotations

import os
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robot_app.config import OmniRobotConfig, RobotConfig
from shared.config import ConfigError, parse

Value = float | bool | tuple[float, ...] | tuple[str, ...]
_BACKUP = ".before-calibration"
_HEADER = re.compile(r"^\s*\[\s*([A-Za-z0-9_.-]+)\s*\]\s*(#.*)?$")


@dataclass(frozen=True, slots=True)
class Change:
    """`key`: dotted, as in robot.toml. `certainty`: how sure `after` is, in words."""

    key: str
    before: Value
    after: Value
    certainty: str

    @property
    def is_any(self) -> bool:
        return toml(self.before) != toml(self.after)

    def row(self) -> str:
        return f"  {self.key:<36} {toml(self.before):>24}  ->  {toml(self.after):<24} {self.certainty}".rstrip()


def toml(value: Value) -> str:
    """As TOML has it; five digits are more than any of these is known to."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return "[" + ", ".join(f'"{v}"' if isinstance(v, str) else toml(v) for v in value) + "]"
    text = f"{value:.5g}"
    return text if any(c in text for c in ".e") else text + ".0"


def edited(text: str, changes: list[Change]) -> str:
    """`text` of a robot.toml with the new values; comments, order and everything else stay as they are.

    Raises `ConfigError` where that cannot be done, or where the robot would refuse the outcome.
    """
    wanted = tomllib.loads(text)
    for change in changes:
        table, _, key = change.key.rpartition(".")
        text = _with_value(text, table, key, toml(change.after))
        _set(wanted, change.key.split("."), tomllib.loads(f"v = {toml(change.after)}")["v"])
    try:
        written = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"this file is written in a way that cannot be edited: {error}") from error
    if written != wanted:
        raise ConfigError("this file is written in a way that cannot be edited; put the values in by hand")
    parse(written, OmniRobotConfig if "omni" in written else RobotConfig)
    return text


def write(path: Path, changes: list[Change]) -> Path:
    """Put the new values into the file, all or none, and keep what it was before beside it; returns where."""
    before = path.read_text("utf-8")
    after = edited(before, changes)
    backup = path.with_name(path.name + _BACKUP)
    backup.write_text(before, "utf-8")
    part = path.with_name(path.name + ".part")
    status = path.stat()
    with part.open("w", encoding="utf-8") as file:
        file.write(after)
        file.flush()
        os.fsync(file.fileno())
    part.chmod(status.st_mode & 0o7777)
    if os.geteuid() == 0:
        os.chown(part, status.st_uid, status.st_gid)
    part.replace(path)
    return backup


def _with_value(text: str, table: str, key: str, value: str) -> str:
    """The line of `key` in `[table]` with another value, or a new one at the table's end, or a new table."""
    lines = text.splitlines(keepends=True)
    begin = next((i for i, line in enumerate(lines) if (m := _HEADER.match(line)) and m[1] == table), None)
    if begin is None:
        return text.rstrip("\n") + f"\n\n[{table}]\n{key} = {value}\n"
    end = next((i for i in range(begin + 1, len(lines)) if lines[i].lstrip().startswith("[")), len(lines))
    entry = re.compile(rf"^(\s*{re.escape(key)}\s*=\s*)(\[[^\]#]*\]|[^#\n]*?)(\s*)(#.*)?$")
    for i in range(begin + 1, end):
        if match := entry.match(lines[i].rstrip("\n")):
            head, _, gap, comment = match.groups()
            lines[i] = head + value + (f"{gap or ' '}{comment}" if comment else "") + "\n"
            return "".join(lines)
    last = max(i for i in range(begin, end) if lines[i].strip() and not lines[i].lstrip().startswith("#"))
    if not lines[last].endswith("\n"):
        lines[last] += "\n"
    lines.insert(last + 1, f"{key} = {value}\n")
    return "".join(lines)


def _set(table: dict[str, Any], path: list[str], value: object) -> None:
    for name in path[:-1]:
        table = table.setdefault(name, {})
    table[path[-1]] = value
