"""What each command of `radio-config` does."""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Callable
from typing import Any

from shared.command_line import EXIT_FAILED, EXIT_OK, Refused
from shared.link.es920lr.airtime import MAX_PAYLOAD_BYTES
from shared.link.es920lr.band import BandRule
from shared.link.es920lr.settings import RadioSettings, differences
from shared.link.serial_port import list_serial_ports
from shared.runtime.clock import MonotonicClock
from tools.radio_config import changes, plan
from tools.radio_config.measure import Estimate, estimate
from tools.radio_config.session import Bench, Module, say

Work = Callable[[argparse.Namespace], int]


def list_ports(args: argparse.Namespace) -> int:
    if args.profiles:
        found = [(name, changes.load_profile(name).description) for name in changes.profile_names()]
        _print(args, {"profiles": dict(found)}, [f"{name:12} {text}" for name, text in found])
        return EXIT_OK
    ports = list_serial_ports()
    lines = [
        f"{p.path:16} {p.description}" + (f", serial number {p.serial_number}" * bool(p.serial_number)) for p in ports
    ]
    _print(args, {"ports": [dataclasses.asdict(p) for p in ports]}, lines or ["no serial port is plugged in"])
    return EXIT_OK


def show(args: argparse.Namespace) -> int:
    with open_bench(args) as bench, bench.module(args.port) as module:
        values = plan.listed(module.settings)
        other = dict(module.shown.other)
        lines = [f"{name} = {value}" for name, value in values.items()]
        lines += [f"# {name}: {value}" for name, value in other.items()]
        frequency_mhz = module.settings.frequency_hz / 1e6
        head = f"# {args.port}: {module.version}, {frequency_mhz:.1f} MHz"
        _print(args, {"port": args.port, "version": module.version, "settings": values, "other": other}, [head, *lines])
    return EXIT_OK


def set_values(args: argparse.Namespace) -> int:
    asked, rule, payload_bytes = _changes(args)
    if not asked:
        raise Refused("nothing to set; give KEY=VALUE or --profile")
    changes.require_possible(asked, rule, payload_bytes)
    with open_bench(args) as bench, bench.module(args.port) as module:
        wanted = changes.changed(module.settings, asked)
        changes.require_allowed(wanted, rule, payload_bytes)
        _print(args, _report(args, module, wanted), _write(args, module, wanted))
    return EXIT_OK


def save(args: argparse.Namespace) -> int:
    with open_bench(args) as bench, bench.module(args.port) as module:
        module.save()
    _print(args, {"port": args.port, "saved": True}, [f"{args.port}: saved"])
    return EXIT_OK


def load(args: argparse.Namespace) -> int:
    with open_bench(args) as bench, bench.module(args.port) as module:
        module.load_defaults()
        if args.save:
            module.save()
    _print(args, {"port": args.port, "saved": args.save}, [f"{args.port}: factory settings" + ", saved" * args.save])
    return EXIT_OK


def copy(args: argparse.Namespace) -> int:
    if len(args.others) not in {1, 3}:
        raise Refused(
            f"copy to one port (the partner) or to three (the partner and the second pair), not {len(args.others)}"
        )
    names = different([args.source, *args.others])
    _, rule, payload_bytes = _band(args)
    lines: list[str] = []
    with open_bench(args) as bench:
        with bench.module(args.source) as source:
            wanted = _targets(source.settings, len(args.others), args.second_channel)
            changes.require_allowed(source.settings, rule, payload_bytes)
        report: list[dict[str, Any]] = []
        for name, settings in zip(names[1:], wanted, strict=True):
            with bench.module(name) as module:
                complete = dataclasses.replace(settings, baud_rate=module.settings.baud_rate)
                report.append(_report(args, module, complete))
                lines += _write(args, module, complete)
    _print(args, {"source": args.source, "copied": report}, lines)
    return EXIT_OK


def _targets(source: RadioSettings, count: int, second_channel: int | None) -> list[RadioSettings]:
    partner = plan.partner_of(source)
    if count == 1:
        return [partner]
    return [partner, *plan.second_pair(source, second_channel)]


def check(args: argparse.Namespace) -> int:
    names = different(args.ports)
    if len(names) not in {2, 4}:
        raise Refused(f"check two modules or four, not {len(names)}")
    _, rule, payload_bytes = _band(args)
    found: dict[str, RadioSettings] = {}
    with open_bench(args) as bench:
        for name in names:
            with bench.module(name) as module:
                found[name] = module.settings
    wrong = plan.disagreements(found, rule, payload_bytes)
    warnings = plan.sleepers(found)
    figures = {"agree": not wrong, "problems": wrong, "warnings": warnings}
    _print(args, figures, [*(wrong or [f"the {len(names)} modules agree"]), *warnings])
    return EXIT_FAILED if wrong else EXIT_OK


def airtime(args: argparse.Namespace) -> int:
    asked, rule, payload_bytes = _changes(args)
    base = dataclasses.replace(changes.LINK, own_id=1, destination_id=2)
    settings = changes.changed(base, asked)
    found = estimate(settings, payload_bytes, rule)
    _print(args, dataclasses.asdict(found), _estimate_lines(found))
    return EXIT_FAILED if found.forbidden else EXIT_OK


def _estimate_lines(e: Estimate) -> list[str]:
    return [
        f"SF{e.spreading_factor} at {e.bandwidth_hz / 1e3:g} kHz, {e.bit_rate_bps:.0f} bit/s, {e.payload_bytes} bytes",
        f"airtime            {e.airtime_ms:9.1f} ms (an acknowledgement {e.ack_airtime_ms:.1f} ms)",
        f"carrier sense      {e.carrier_sense_ms:9.1f} ms before, 50.0 ms pause after",
        f"packets/s          {e.packets_per_s_ahead:9.2f} (airtime and pause alone {e.packets_per_s_at_most:.2f}, "
        f"one by one over the serial line {e.packets_per_s:.2f})",
        f"goodput            {e.goodput_bps / 1e3:9.2f} kbps, two modules {e.goodput_two_modules_bps / 1e3:.2f} kbps",
        f"longest payload    {e.longest_payload_bytes:9d} bytes that the band allows",
        *(f"forbidden: {text}" for text in e.forbidden),
    ]


def _changes(args: argparse.Namespace) -> tuple[dict[str, Any], BandRule, int]:
    profile, rule, payload_bytes = _band(args)
    named = profile.changes if profile is not None else {}
    return named | changes.read_assignments(args.assignments), rule, payload_bytes


def _band(args: argparse.Namespace) -> tuple[changes.Profile | None, BandRule, int]:
    profile = changes.load_profile(args.profile) if getattr(args, "profile", None) else None
    rule = profile.rule if profile else changes.RULES["long"]
    payload_bytes = profile.payload_bytes if profile else MAX_PAYLOAD_BYTES
    if args.carrier_sense:
        rule = changes.RULES[args.carrier_sense]
    if args.payload is not None:
        payload_bytes = args.payload
    if not 1 <= payload_bytes <= MAX_PAYLOAD_BYTES:
        raise Refused(f"a packet has 1 to {MAX_PAYLOAD_BYTES} bytes of payload, not {payload_bytes}")
    return profile, rule, payload_bytes


def _report(args: argparse.Namespace, module: Module, wanted: RadioSettings) -> dict[str, Any]:
    changed = {
        name: {"from": plan.shown(old), "to": plan.shown(new)}
        for name, old, new in differences(wanted, module.settings)
    }
    return {
        "port": module.name,
        "changed": changed,
        "written": not args.dry_run,
        "saved": args.save and not args.dry_run,
    }


def _write(args: argparse.Namespace, module: Module, wanted: RadioSettings) -> list[str]:
    """Do it, or not; what was done in words."""
    changed = differences(wanted, module.settings)
    old, new = plan.listed(module.settings), plan.listed(wanted)
    lines = [f"{module.name}: {name} {old[name]} -> {new[name]}" for name, _, _ in changed]
    if not changed:
        lines = [f"{module.name}: is so already"]
    if args.dry_run:
        return [*lines, f"{module.name}: dry run, nothing was changed"]
    if changed:
        module.set(wanted)
    if args.save:
        module.save()
        lines.append(f"{module.name}: saved")
    elif changed:
        say(f"{module.name}: not saved, holds until its power is cut")
    return lines


def open_bench(args: argparse.Namespace) -> Bench:
    return Bench(MonotonicClock(), args.baud, args.wait)


def different(names: list[str]) -> list[str]:
    """Raises `Refused` when a port is given twice."""
    if len(set(names)) < len(names):
        raise Refused("the same port is given twice")
    return names


def _print(args: argparse.Namespace, figures: dict[str, Any], lines: list[str]) -> None:
    print(json.dumps(figures) if args.json else "\n".join(lines))
