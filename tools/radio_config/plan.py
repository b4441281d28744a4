"""What the four modules must have in common, and what must differ."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from shared.command_line import Refused
from shared.link.es920lr.band import BandRule, problems
from shared.link.es920lr.procedures import require_usable
from shared.link.es920lr.settings import BROADCAST_ID, BootMode, RadioSettings, SettingsError, conflicts

_ALIKE = ("bandwidth_hz", "spreading_factor", "pan_id", "acknowledge", "transfer", "show_sender", "show_rssi", "format")
_CHANNELS = {62_500: 15, 125_000: 15, 250_000: 7, 500_000: 5}
_SECOND_PAIR = 2  # added to both identifiers


def partner_of(source: RadioSettings) -> RadioSettings:
    """The other end: the same, with the identifiers the other way round."""
    _require_addressed(source)
    return dataclasses.replace(source, own_id=source.destination_id, destination_id=source.own_id)


def second_pair(source: RadioSettings, channel: int | None) -> tuple[RadioSettings, RadioSettings]:
    """The other radio of each side: other identifiers, and the channel farthest from the first pair's."""
    _require_addressed(source)
    last = _CHANNELS[source.bandwidth_hz]
    if channel is None:
        channel = 1 if source.channel - 1 >= last - source.channel else last
    if channel == source.channel:
        raise Refused(
            f"both pairs on channel {channel} would destroy each other's packets; take another --second-channel"
        )
    try:
        first = dataclasses.replace(
            source,
            channel=channel,
            own_id=source.own_id + _SECOND_PAIR,
            destination_id=source.destination_id + _SECOND_PAIR,
        )
    except SettingsError as error:
        raise Refused(str(error)) from error
    if {first.own_id, first.destination_id} & {source.own_id, source.destination_id}:
        raise Refused("identifiers 2 apart are needed for the second pair; use own_id=1 destination_id=2 on the first")
    return first, partner_of(first)


def _require_addressed(source: RadioSettings) -> None:
    if source.destination_id in {source.own_id, BROADCAST_ID}:
        raise Refused(
            f"the source has own_id {source.own_id:#06x} and destination_id {source.destination_id:#06x}; "
            "set them to two different modules first, for example own_id=1 destination_id=2"
        )


def disagreements(modules: Mapping[str, RadioSettings], rule: BandRule, payload_bytes: int) -> list[str]:
    """What keeps two or four modules from working together, each as one sentence; `modules` by their ports."""
    found: list[str] = []
    for name, settings in modules.items():
        found += [f"{name}: {text}" for text in conflicts(settings) + problems(settings, rule, payload_bytes)]
        try:
            require_usable(settings)
        except SettingsError as error:
            found.append(f"{name}: {error}")
    found += _not_alike(modules)
    return found + _wrong_partners(modules)


def sleepers(modules: Mapping[str, RadioSettings]) -> list[str]:
    """Those that are silent when they get power, each as one sentence."""
    return [
        f"warning: {name} starts in configuration, and the link needs boot_mode=operation: "
        f"`radio-config set {name} boot_mode=operation --save`"
        for name, settings in modules.items()
        if settings.boot_mode is not BootMode.OPERATION
    ]


def _not_alike(modules: Mapping[str, RadioSettings]) -> list[str]:
    found = []
    for field in _ALIKE:
        values = {name: getattr(settings, field) for name, settings in modules.items()}
        if len(set(values.values())) > 1:
            listed = ", ".join(f"{shown(value)} at {name}" for name, value in values.items())
            found.append(f"{field} must be the same everywhere: it is {listed}")
    return found


def _wrong_partners(modules: Mapping[str, RadioSettings]) -> list[str]:
    found: list[str] = []
    by_id: dict[int, str] = {}
    for name, settings in modules.items():
        if settings.own_id in by_id:
            found.append(f"{name} and {by_id[settings.own_id]} both have own_id {settings.own_id:#06x}")
        by_id[settings.own_id] = name
    channels: dict[int, frozenset[str]] = {}
    for name, settings in modules.items():
        partner = by_id.get(settings.destination_id)
        if partner is None:
            found.append(f"{name}: nobody here has its destination_id {settings.destination_id:#06x}")
            continue
        other = modules[partner]
        pair = frozenset((name, partner))
        if other.destination_id != settings.own_id:
            found.append(f"{name} sends to {partner}, which sends to {other.destination_id:#06x}")
        if other.channel != settings.channel and name < partner:
            found.append(f"{name} is on channel {settings.channel}, its partner {partner} on {other.channel}")
        if channels.setdefault(settings.channel, pair) != pair:
            found.append(f"{name}: channel {settings.channel} is that of the other pair: they would destroy each other")
    return found


def shown(value: object) -> str:
    """A value as it is written on the command line."""
    name = getattr(value, "name", None)
    if name is not None:
        return str(name).lower()
    return str(value).lower() if isinstance(value, bool) else str(value)


def listed(settings: RadioSettings) -> dict[str, str]:
    """Every setting by name, as it is written on the command line."""
    values = {f.name: getattr(settings, f.name) for f in dataclasses.fields(settings)}
    return {
        name: f"{value:#06x}" if name.endswith("_id") else f"{value:g}" if isinstance(value, float) else shown(value)
        for name, value in values.items()
    }
