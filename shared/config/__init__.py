"""TOML files to frozen dataclasses.

Every key of a file must be a field, every field without a default must be in the file, and every value must
have the field's type: a wrong one is refused by its dotted name, with the nearest right one.
"""

from __future__ import annotations

import dataclasses
import difflib
import enum
import math
import tomllib
import types
import typing
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")


class ConfigError(Exception):
    """A configuration that cannot be used; the text names the file and the dotted key."""


def load(path: Path, kind: type[T]) -> T:
    """Read the TOML file at `path` into the dataclass `kind`."""
    table = read_table(path)
    try:
        return parse(table, kind)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def read_table(path: Path) -> dict[str, Any]:
    """The TOML file at `path` as it is written."""
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: is not valid TOML: {error}") from error


def parse(table: dict[str, Any], kind: type[T], prefix: str = "") -> T:
    """Make the dataclass `kind` of `table`; `prefix` is the dotted name of the table itself."""
    hints = typing.get_type_hints(kind)
    fields = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    for key in table:
        if key not in fields:
            near = difflib.get_close_matches(key, fields, n=1)
            hint = f", did you mean {prefix}{near[0]}?" if near else f"; known here: {', '.join(fields)}"
            raise ConfigError(f"unknown key {prefix}{key}{hint}")
    values = {}
    for name, f in fields.items():
        if name in table:
            values[name] = _convert(table[name], hints[name], prefix + name)
        elif f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING:
            raise ConfigError(f"missing key {prefix}{name}")
    try:
        return kind(**values)
    except ValueError as error:
        where = f"{prefix.rstrip('.')}: " if prefix else ""
        raise ConfigError(f"{where}{error}") from error


def _convert(value: Any, hint: Any, name: str) -> Any:
    origin = typing.get_origin(hint)
    if dataclasses.is_dataclass(hint):
        if not isinstance(value, dict):
            raise ConfigError(f"{name} must be a table, not {_shown(value)}")
        return parse(value, typing.cast("type[Any]", hint), name + ".")
    if origin is tuple:
        return _convert_list(value, typing.get_args(hint), name)
    if origin is typing.Literal:
        choices = typing.get_args(hint)
        if value not in choices:
            raise ConfigError(f"{name} must be one of {', '.join(map(repr, choices))}, not {_shown(value)}")
        return value
    if origin in {typing.Union, types.UnionType}:
        inner = [a for a in typing.get_args(hint) if a is not type(None)]
        return _convert(value, inner[0], name)
    return _convert_scalar(value, hint, name)


def _convert_list(value: Any, items: tuple[Any, ...], name: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ConfigError(f"{name} must be a list, not {_shown(value)}")
    if len(items) == 2 and items[1] is Ellipsis:
        return tuple(_convert(v, items[0], f"{name}[{i}]") for i, v in enumerate(value))
    if len(value) != len(items):
        raise ConfigError(f"{name} must have {len(items)} values, not {len(value)}")
    return tuple(_convert(v, hint, f"{name}[{i}]") for i, (v, hint) in enumerate(zip(value, items, strict=True)))


def _convert_scalar(value: Any, hint: Any, name: str) -> Any:
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        by_name = {member.name.lower(): member for member in hint}
        if value not in by_name:
            raise ConfigError(f"{name} must be one of {', '.join(by_name)}, not {_shown(value)}")
        return by_name[value]
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not hint:
        raise ConfigError(f"{name} must be {_type_name(hint)}, not {_shown(value)}")
    if hint is float and not math.isfinite(value):  # both are legal in TOML and never a legal setting
        raise ConfigError(f"{name} must be a number, not {value}")
    return value


def _type_name(hint: Any) -> str:
    return {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}.get(hint, str(hint))


def _shown(value: Any) -> str:
    return repr(value) if len(repr(value)) < 60 else f"a {type(value).__name__}"
