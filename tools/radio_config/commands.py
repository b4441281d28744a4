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
from shared.runtime.clock import MonotonicClock
from tools.radio_config import changes, plan
from tools.radio_config.measure import Direction, Estimate, estimate, measure
from tools.radio_config.session import Bench, Module, list_serial_ports, say

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
    with _bench(args) as bench, bench.module(args.port) as module:
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
    with _bench(args) as bench, bench.module(args.port) as module:
        wanted = changes.changed(module.settings, asked)
        changes.require_allowed(wanted, rule, payload_bytes)
        _print(args, _report(args, module, wanted), _write(args, module, wanted))
    return EXIT_OK


def save(args: argparse.Namespace) -> int:
    with _bench(args) as bench, bench.module(args.port) as module:
        module.save()
    _print(args, {"port": args.port, "saved": True}, [f"{args.port}: saved"])
    return EXIT_OK


def load(args: argparse.Namespace) -> int:
    with _bench(args) as bench, bench.module(args.port) as module:
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
    names = _different([args.source, *args.others])
    _, rule, payload_bytes = _band(args)
    lines: list[str] = []
    with _bench(args) as bench:
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
    names = _different(args.ports)
    if len(names) not in {2, 4}:
        raise Refused(f"check two modules or four, not {len(names)}")
    _, rule, payload_bytes = _band(args)
    found: dict[str, RadioSettings] = {}
    with _bench(args) as bench:
        for name in names:
            with bench.module(name) as module:
                found[name] = module.settings
    wrong = plan.disagreements(found, rule, payload_bytes)
    _print(args, {"agree": not wrong, "problems": wrong}, wrong or [f"the {len(names)} modules agree"])
    return EXIT_FAILED if wrong else EXIT_OK


def range_test(args: argparse.Namespace) -> int:
    names = _different(args.ports)
    factors = _spreading_factors(args.sf)
    if not 7 <= args.payload <= MAX_PAYLOAD_BYTES or args.count < 1:
        raise Refused(f"--payload is 7 to {MAX_PAYLOAD_BYTES}, --count 1 or more")
    results: list[dict[str, Any]] = []
    if not args.json:
        print(f"{'SF':>2}  {'direction':32} {'sent':>4} {'came':>4} {'loss':>5}  RSSI dBm: weakest, median, strongest")
    with _bench(args) as bench, bench.module(names[0]) as first, bench.module(names[1]) as second:
        before = [first.settings, second.settings]
        tests = [_range_settings(before, factor, args) for factor in factors]  # refused before anything is sent
        for factor, wanted in zip(factors, tests, strict=True):
            for direction in _range_at([first, second], wanted, args):
                results.append({"spreading_factor": factor, "loss": direction.loss, **dataclasses.asdict(direction)})
                if not args.json:
                    print(_range_line(factor, direction), flush=True)
        for module, settings in zip((first, second), before, strict=True):
            module.set(settings)
            module.save()
    if args.json:
        print(json.dumps({"payload_bytes": args.payload, "results": results}))
    return EXIT_OK


def _range_settings(before: list[RadioSettings], factor: int, args: argparse.Namespace) -> list[RadioSettings]:
    """Those of both modules for one spreading factor; each keeps its baud rate."""
    base = changes.changed(
        dataclasses.replace(before[0], **changes.FOR_RANGE_TEST),
        {
            "spreading_factor": factor,
            "bandwidth_hz": args.bandwidth_hz or before[0].bandwidth_hz,
            "own_id": 1,
            "destination_id": 2,
        },
    )
    changes.require_allowed(base, changes.RULES[args.carrier_sense], args.payload)
    return [base, dataclasses.replace(plan.partner_of(base), baud_rate=before[1].baud_rate)]


def _range_at(modules: list[Module], wanted: list[RadioSettings], args: argparse.Namespace) -> list[Direction]:
    """Both directions at one spreading factor. Raises `LinkError`."""
    clock = MonotonicClock()
    there, back = (module.operate(settings) for module, settings in zip(modules, wanted, strict=True))
    for radio in (there, back):
        radio.wait_until_operating(5.0)
    found = [measure(*ends, args.count, args.payload, clock) for ends in ((there, back), (back, there))]
    for module in modules:
        module.configure_again()
    return found


def _range_line(factor: int, d: Direction) -> str:
    strength = "nothing came" if d.median_dbm is None else f"{d.weakest_dbm}, {d.median_dbm:g}, {d.strongest_dbm}"
    refused = f", refused {d.refused}" if d.refused else ""
    ends = f"{d.sender} > {d.receiver}"
    return f"{factor:>2}  {ends:32} {d.sent:>4} {d.received:>4} {d.loss:>5.0%}  {strength}{refused}"


def _spreading_factors(text: str) -> list[int]:
    factors = [int(part) for part in text.split(",") if part.strip().isdecimal()]
    if not factors or len(factors) != len(text.split(",")) or not all(7 <= f <= 12 for f in factors):
        raise Refused(f"--sf {text}: write spreading factors from 7 to 12 with commas, for example 7,9,12")
    return factors


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


def _bench(args: argparse.Namespace) -> Bench:
    return Bench(MonotonicClock(), args.baud, args.wait)


def _different(names: list[str]) -> list[str]:
    if len(set(names)) < len(names):
        raise Refused("the same port is given twice")
    return names


def _print(args: argparse.Namespace, figures: dict[str, Any], lines: list[str]) -> None:
    print(json.dumps(figures) if args.json else "\n".join(lines))
