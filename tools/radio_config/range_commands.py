"""`range-test` and its far end, `echo`."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from typing import Any

from shared.command_line import EXIT_OK, Refused
from shared.link.es920lr.driver import Es920lr
from shared.link.es920lr.settings import RadioSettings
from tools.radio_config import changes, plan
from tools.radio_config.commands import different, open_bench
from tools.radio_config.measure import Direction, echo, measure, measure_far
from tools.radio_config.session import Module, say

_START_S = 5.0
_FAR_END = "far end"
_HEAD = f"{'SF':>2}  {'direction':32} {'sent':>4} {'came':>4} {'loss':>5}  RSSI dBm: weakest, median, strongest"


def range_test(args: argparse.Namespace) -> int:
    names = different(args.ports)
    if len(names) > 2:
        raise Refused("give one port, with `radio-config echo` at the far end, or the two ports of a pair")
    factors = _spreading_factors(args.sf) if args.sf else None
    if not args.json:
        print(_HEAD)
    results = _test_pair(names, factors, args) if len(names) == 2 else _test_far(names[0], factors, args)
    if args.json:
        print(json.dumps({"payload_bytes": args.payload, "results": results}))
    return EXIT_OK


def echo_command(args: argparse.Namespace) -> int:
    factors = _spreading_factors(args.sf) if args.sf else None
    with open_bench(args) as bench, bench.module(args.port) as module:
        wanted = _settings(module.settings, _one(factors, module), args)
        radio = _started(module, plan.partner_of(wanted))
        on_air = f"SF{wanted.spreading_factor} at {wanted.bandwidth_hz / 1e3:g} kHz, channel {wanted.channel}"
        say(f"{args.port}: answers test packets, {on_air}; end with Ctrl-C")

        def tell(number: int, strength_dbm: int) -> None:
            if not args.json:
                print(f"packet {number}: {strength_dbm} dBm", flush=True)

        until_s = bench.clock.now_s() + (args.seconds or math.inf)
        heard = echo(radio, bench.clock, until_s, tell)
    if args.json:
        print(json.dumps({"port": args.port, "heard": heard}))
    return EXIT_OK


def _test_pair(names: list[str], factors: list[int] | None, args: argparse.Namespace) -> list[dict[str, Any]]:
    """Each spreading factor, both directions; at the end both modules hold what they held before."""
    results: list[dict[str, Any]] = []
    with open_bench(args) as bench, bench.module(names[0]) as first, bench.module(names[1]) as second:
        before = first.settings, second.settings
        wanted = [_settings(before[0], factor, args) for factor in factors or range(7, 13)]
        for settings in wanted:  # all of them have been checked before anything is sent
            partner = dataclasses.replace(plan.partner_of(settings), baud_rate=before[1].baud_rate)
            there, back = _started(first, settings), _started(second, partner)
            for sender, receiver in ((there, back), (back, there)):
                direction = measure(sender, receiver, args.count, args.payload, bench.clock)
                results.append(_result(settings, direction, args))
            for module in (first, second):
                module.configure_again()
        for module, settings in zip((first, second), before, strict=True):
            module.set(settings)
            module.save()
    return results


def _test_far(name: str, factors: list[int] | None, args: argparse.Namespace) -> list[dict[str, Any]]:
    with open_bench(args) as bench, bench.module(name) as module:
        settings = _settings(module.settings, _one(factors, module), args)
        radio = _started(module, settings)
        found = measure_far(radio, _FAR_END, args.count, args.payload, bench.clock)
        return [_result(settings, direction, args) for direction in found]


def _one(factors: list[int] | None, module: Module) -> int:
    if factors is None:
        return module.settings.spreading_factor
    if len(factors) > 1:
        raise Refused("both ends must have the same spreading factor: give one with --sf, at both")
    return factors[0]


def _started(module: Module, settings: RadioSettings) -> Es920lr:
    radio = module.operate(settings)
    radio.wait_until_operating(_START_S)
    return radio


def _settings(before: RadioSettings, factor: int, args: argparse.Namespace) -> RadioSettings:
    """Those of the first module of the pair. Raises `Refused`."""
    wanted = changes.changed(
        dataclasses.replace(before, **changes.FOR_RANGE_TEST),
        {
            "spreading_factor": factor,
            "bandwidth_hz": args.bandwidth_hz or before.bandwidth_hz,
            "own_id": 1,
            "destination_id": 2,
        },
    )
    changes.require_allowed(wanted, changes.RULES[args.carrier_sense], args.payload)
    return wanted


def _result(settings: RadioSettings, direction: Direction, args: argparse.Namespace) -> dict[str, Any]:
    if not args.json:
        print(_line(settings.spreading_factor, direction), flush=True)
    return {
        "spreading_factor": settings.spreading_factor,
        "bandwidth_hz": settings.bandwidth_hz,
        "loss": direction.loss,
        **dataclasses.asdict(direction),
    }


def _line(factor: int, d: Direction) -> str:
    strength = "nothing came" if d.median_dbm is None else f"{d.weakest_dbm}, {d.median_dbm:g}, {d.strongest_dbm}"
    refused = f", refused {d.refused}" if d.refused else ""
    ends = f"{d.sender} > {d.receiver}"
    return f"{factor:>2}  {ends:32} {d.sent:>4} {d.received:>4} {d.loss:>5.0%}  {strength}{refused}"


def _spreading_factors(text: str) -> list[int]:
    factors = [int(part) for part in text.split(",") if part.strip().isdecimal()]
    if not factors or len(factors) != len(text.split(",")) or not all(7 <= f <= 12 for f in factors):
        raise Refused(f"--sf {text}: write spreading factors from 7 to 12 with commas, for example 7,9,12")
    return factors
