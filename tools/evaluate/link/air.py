"""`evaluate link`: what the link carries, on emulated modules and an emulated Wi-Fi that is cut, all on one clock."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from shared.command_line import EXIT_FAILED, EXIT_OK, number_in, whole_number_in
from shared.command_line import seed as seed_number
from shared.link.es920lr.airtime import PAUSE_S, airtime_s, carrier_sense_s, packets_per_s
from shared.link.radio_pair.config import PairConfig
from tools.evaluate.link.cut import CutFigures, measure_cuts
from tools.evaluate.link.observed import lab_bytes
from tools.evaluate.link.quiet import quiet
from tools.evaluate.link.traffic import Traffic
from tools.simulator.radio.loss import Bursts, Independent, LossModel
from tools.simulator.radio.pair_rig import PairRig, link_settings

_PACKET_BYTES = 50
_WARM_UP_S = 5.0
_DRAIN_S = 120.0
_SIZES, _WIFI_SIZES = (8, 500), (8, 4_000)  # bytes of an observation: its number is in it; the paper's are 471 and 932
_EPILOG = """\
The scenarios send synthetic observations as fast as the link takes them: what the channel carries. What the lab's
observations take is measured beside that, on the beginning of a mission. `evaluate mission --link lora` is the whole
mission of the lab over the channel of the scenario `paper`.
"""
_FASTEST = link_settings(500_000, 7)


@dataclass(frozen=True, slots=True)
class Scenario:
    text: str
    bandwidth_hz: int = 500_000
    loss: Callable[[], LossModel] = Independent
    radios: int = 2
    fails_after_s: float | None = None  # the radio that does not ask, of the station


SCENARIOS = {
    "paper": Scenario("250 kHz and SF7: two modules carry 6.02 kbps, the paper's rate", 250_000),
    "sf7bw500": Scenario("500 kHz and SF7, the fastest setting; nothing is lost"),
    "lossy20": Scenario("the same, and every fifth packet is lost, each direction", loss=lambda: Independent(0.2)),
    "burst": Scenario("the same, and nothing is heard for 0.3 s every 3 s on average", loss=lambda: Bursts(3.0, 0.3)),
    "one-radio": Scenario("the same, and one module loses its power at the beginning", fails_after_s=0.0),
    "cut": Scenario("Wi-Fi is cut at random moments and comes back"),
}


@dataclass(frozen=True, slots=True)
class LinkFigures:
    """Bits of datagrams a second; observations are synthetic, of the size that was asked for.

    `module_limit_bps`: 50-byte packets back to back, carrier sense left out, as the data collected for the project
    count it. `possible_bps`: with carrier sense, which no setting avoids. `carried`: the same with whole packets
    for what is in them: all that was read, headers counted as carried.
    """

    scenario: str
    observations: str
    duration_s: float
    goodput_bps: float
    module_limit_bps: float
    efficiency: float
    possible_bps: float
    carried_bps: float
    carried_efficiency: float
    refresh_hz: float
    bytes_per_observation: float
    latency_ms_p50: float
    latency_ms_p99: float
    command_latency_ms_p50: float
    command_latency_ms_p99: float
    command_latency_ms_max: float
    stop_latency_ms_p50: float
    stop_latency_ms_p99: float
    stop_latency_ms_max: float
    turns_per_s: float
    lost: int
    duplicated: int
    out_of_order: int


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument("--scenario", choices=[*SCENARIOS, "all"], default="all")
    parser.add_argument(
        "--seconds", type=number_in(1, 3_600), default=120.0, help="simulated, of each scenario (default: 120)"
    )
    parser.add_argument(
        "--size", type=whole_number_in(*_SIZES), default=110, help="bytes of an observation on LoRa (default: 110)"
    )
    parser.add_argument(
        "--wifi-size",
        type=whole_number_in(*_WIFI_SIZES),
        default=932,
        help="the same on Wi-Fi (default: 932, the paper's)",
    )
    parser.add_argument(
        "--turn", type=number_in(0.1, 10.0), default=PairConfig().turn_s, metavar="S", help="how often to ask"
    )
    parser.add_argument(
        "--cuts", type=whole_number_in(1, 1_000), default=100, help="of Wi-Fi, in the scenario cut (default: 100)"
    )
    parser.add_argument("--seed", type=seed_number, default=1)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    names = list(SCENARIOS) if args.scenario == "all" else [args.scenario]
    figures: dict[str, LinkFigures | CutFigures] = {}
    with quiet(args.verbose):
        for name in names:
            figures[name] = _measure(name, args)
            if not args.json:
                _print(f"{name}: {SCENARIOS[name].text}", dataclasses.asdict(figures[name]))
        lab = lab_bytes(args.seconds, args.seed)
    if args.json:
        every = dict.fromkeys(key for f in (LinkFigures, CutFigures) for key in f.__dataclass_fields__)
        found = {name: _rounded(every | dataclasses.asdict(f) | lab) for name, f in figures.items()}
        print(json.dumps(found[names[0]] if len(names) == 1 else found, indent=1))
    else:
        _print("bytes of an observation in the lab", lab)
    clean = all(f.lost == f.duplicated == 0 for f in figures.values())
    return EXIT_OK if clean else EXIT_FAILED


def _measure(name: str, args: argparse.Namespace) -> LinkFigures | CutFigures:
    if name == "cut":
        return measure_cuts(args.cuts, args.seed, args.size, args.wifi_size)
    return measure(name, args.seconds, args.seed, args.size, PairConfig(turn_s=args.turn))


def measure(name: str, seconds: float, seed: int, size: int, config: PairConfig) -> LinkFigures:
    """One scenario; commands flow the other way, one a second, and now and then a stop."""
    scenario = SCENARIOS[name]
    settings = link_settings(scenario.bandwidth_hz, 7)
    rig = PairRig(seed, settings, config, scenario.loss, scenario.radios)
    rig.connect(60.0)
    traffic = Traffic(rig, size, np.random.default_rng(seed + 10))
    rig.run(_WARM_UP_S)
    if scenario.fails_after_s is not None:
        rig.run(scenario.fails_after_s)
        rig.station_modules[0].power_off()
        rig.run(_WARM_UP_S)
    before, segments, turns = (
        len(traffic.came_s),
        rig.station.statistics.lanes.read_segments,
        rig.robot.statistics.turns.turns,
    )
    rig.run(seconds)
    observations = len(traffic.came_s) - before
    packets, turns = rig.station.statistics.lanes.read_segments - segments, rig.robot.statistics.turns.turns - turns
    waited_s = np.array(traffic.observation_waits_s[before:])
    rig.run(_DRAIN_S, traffic.drained)
    limit_bps = 2 * 8 * _PACKET_BYTES * packets_per_s(_FASTEST.modulation, _PACKET_BYTES)
    slot_s = airtime_s(settings.modulation, _PACKET_BYTES) + PAUSE_S
    goodput_bps, carried_bps = 8.0 * size * observations / seconds, 8.0 * _PACKET_BYTES * packets / seconds
    stops_s, commands_s = np.array(traffic.stop_waits_s), np.array(traffic.command_waits_s)
    return LinkFigures(
        scenario=scenario.text,
        observations="synthetic",
        duration_s=seconds,
        goodput_bps=goodput_bps,
        module_limit_bps=limit_bps,
        efficiency=goodput_bps / limit_bps,
        possible_bps=2 * 8 * _PACKET_BYTES / (slot_s + carrier_sense_s(scenario.bandwidth_hz)),
        carried_bps=carried_bps,
        carried_efficiency=carried_bps / limit_bps,
        refresh_hz=observations / seconds,
        bytes_per_observation=size,
        latency_ms_p50=_percentile_ms(waited_s, 50),
        latency_ms_p99=_percentile_ms(waited_s, 99),
        command_latency_ms_p50=_percentile_ms(commands_s, 50),
        command_latency_ms_p99=_percentile_ms(commands_s, 99),
        command_latency_ms_max=_percentile_ms(commands_s, 100),
        stop_latency_ms_p50=_percentile_ms(stops_s, 50),
        stop_latency_ms_p99=_percentile_ms(stops_s, 99),
        stop_latency_ms_max=_percentile_ms(stops_s, 100),
        turns_per_s=turns / seconds,
        lost=traffic.lost,
        duplicated=traffic.duplicated,
        out_of_order=traffic.out_of_order,
    )


def _percentile_ms(waited_s: np.ndarray[tuple[int], np.dtype[np.float64]], percent: float) -> float:
    return float(np.percentile(waited_s, percent)) * 1e3 if len(waited_s) else math.nan


def _rounded(figures: dict[str, object]) -> dict[str, object]:
    def tidy(value: object) -> object:
        if isinstance(value, float):
            return None if math.isnan(value) else float(f"{value:.4g}")
        return value

    return {key: tidy(value) for key, value in figures.items()}


def _print(title: str, figures: dict[str, object]) -> None:
    print(title)
    for key, value in _rounded(figures).items():
        if key != "scenario":
            print(f"  {key:26} {value}")
