"""Settings from profiles and from the command line, checked before a module hears of them."""

from __future__ import annotations

import dataclasses
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from shared.command_line import Refused
from shared.config import ConfigError, parse, read_table
from shared.link.es920lr.band import LONG_CARRIER_SENSE, SHORT_CARRIER_SENSE, BandRule, problems
from shared.link.es920lr.settings import BootMode, Format, RadioSettings, conflicts

PROFILES = Path(__file__).parent / "profiles"
RULES: dict[str, BandRule] = {"long": LONG_CARRIER_SENSE, "short": SHORT_CARRIER_SENSE}
# What the link needs of every module, whatever the profile says about the air.
LINK = RadioSettings(
    acknowledge=False, show_sender=True, show_rssi=True, format=Format.BINARY, boot_mode=BootMode.OPERATION
)
# Of the modules under test: no acknowledgements that would hide losses, nothing sent but the test.
FOR_RANGE_TEST: dict[str, Any] = {
    **{name: getattr(LINK, name) for name in ("acknowledge", "show_sender", "show_rssi", "format")},
    **{name: getattr(LINK, name) for name in ("transfer", "sleep", "auto_send_interval_s", "node")},
}
_LINK_FIELDS = ("acknowledge", "show_sender", "show_rssi", "format", "boot_mode", "transfer", "sleep")


@dataclass(frozen=True, slots=True)
class _ProfileFile:
    settings: RadioSettings
    description: str = ""
    payload_bytes: int = 50  # longest packet of whoever uses it
    carrier_sense: Literal["long", "short"] = "long"


@dataclass(frozen=True, slots=True)
class Profile:
    """`changes` are the settings it names; the others stay as they are."""

    name: str
    description: str
    changes: dict[str, Any] = field(hash=False)
    payload_bytes: int
    rule: BandRule


def profile_names() -> list[str]:
    return sorted(path.stem for path in PROFILES.glob("*.toml"))


def load_profile(name: str) -> Profile:
    """One that comes along, or a TOML file. Raises `ConfigError`, `Refused`."""
    path = PROFILES / f"{name}.toml"
    if not path.is_file():
        path = Path(name)
    if not path.is_file():
        raise Refused(f"no profile {name!r}: it is one of {', '.join(profile_names())}, or a TOML file")
    table = read_table(path)
    try:
        read = parse(table, _ProfileFile)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    named = {key: getattr(read.settings, key) for key in table["settings"]}
    link = {key: getattr(LINK, key) for key in _LINK_FIELDS}
    return Profile(path.stem, read.description, link | named, read.payload_bytes, RULES[read.carrier_sense])


def read_assignments(assignments: list[str]) -> dict[str, Any]:
    """KEY=VALUE pairs, the values as in TOML; words need no quotes. Raises `Refused`."""
    table: dict[str, Any] = {}
    for text in assignments:
        key, equals, value = text.partition("=")
        if not equals or not key.isidentifier():
            raise Refused(f"{text!r} is no setting; write KEY=VALUE, for example spreading_factor=7")
        table[key] = _value(value)
    changes: dict[str, Any] = {}
    for key, value in table.items():
        if key == "channel":  # what it may be depends on the bandwidth that it will meet
            changes[key] = _whole(key, value)
            continue
        try:
            changes[key] = getattr(parse({key: value}, RadioSettings), key)
        except ConfigError as error:
            raise Refused(str(error).removeprefix("file: ")) from error
    return changes


def _whole(key: str, value: Any) -> int:
    if type(value) is not int:
        raise Refused(f"{key} must be a whole number, not {value!r}")
    return value


def _value(text: str) -> Any:
    words = {"on": True, "yes": True, "off": False, "no": False}
    if text.lower() in words:
        return words[text.lower()]
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def require_possible(changes: dict[str, Any], rule: BandRule, payload_bytes: int) -> None:
    """Refuses what no module can have and what the band forbids on any, before a port is touched."""
    settings = _replaced(RadioSettings(), changes)
    if {"bandwidth_hz", "spreading_factor"} <= changes.keys():
        require_allowed(settings, rule, payload_bytes)


def changed(current: RadioSettings, changes: dict[str, Any]) -> RadioSettings:
    """Raises `Refused` for what the module does not have or cannot be meant."""
    settings, known = _replaced(current, changes), conflicts(current)
    for conflict in conflicts(settings):
        if conflict not in known:
            raise Refused(conflict)
    return settings


def _replaced(current: RadioSettings, changes: dict[str, Any]) -> RadioSettings:
    try:
        return dataclasses.replace(current, **changes)
    except ValueError as error:
        if "channel" in changes or not str(error).startswith("channel"):
            raise Refused(str(error)) from error
        return dataclasses.replace(current, **changes, channel=1)  # as the module does by itself


def require_allowed(settings: RadioSettings, rule: BandRule, payload_bytes: int) -> None:
    """Raises `Refused` for what the band forbids."""
    for problem in problems(settings, rule, payload_bytes):
        raise Refused(f"the 920 MHz band forbids it: {problem}")
