"""`evaluate mission`: the demo's mission in lock-step, no window, for one seed or for several."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from robot_app.config import AnyRobotConfig
from shared.command_line import EXIT_FAILED, EXIT_OK, seed
from shared.runtime.clock import stopwatch_s
from station_gui.config import StationConfig
from station_gui.config import load_config as load_station
from station_gui.export.map_picture import draw_map
from tools.evaluate.link.on_missions import link_figures
from tools.evaluate.seeds import Figures, header, over_seeds, row, seed_list
from tools.evaluate.summary import summarise
from tools.simulator.links import LINK_NAMES, LinkName
from tools.simulator.lockstep import MissionResult, run_mission
from tools.simulator.robots import with_robot_of
from tools.simulator.scenario import ROBOT_NAMES, Scenario, SlipParameters, find_scenario
from tools.simulator.witness import Witness


@dataclass(frozen=True, slots=True)
class _Plan:
    scenario: Scenario
    robot: AnyRobotConfig
    station: StationConfig
    link: LinkName


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenario", default="lab", help="a scenario's name or TOML file (default: lab)")
    seeds = parser.add_mutually_exclusive_group()
    seeds.add_argument("--seed", type=seed, default=1, help="of all noise (default: 1)")
    seeds.add_argument("--seeds", type=seed_list, metavar="LIST", help="a mission for each, as in 1-15 or 1,4,7-9")
    parser.add_argument("--slip", type=_share, metavar="SHARE", help="encoder slip instead of the scenario's, as 0.05")
    parser.add_argument(
        "--gyro-bias",
        type=_positive,
        metavar="DPS",
        help="standard deviation of the gyro's bias at switching on, instead of the scenario's",
    )
    parser.add_argument(
        "--method", choices=("graph", "particle"), help="of SLAM, instead of what the station's file says"
    )
    parser.add_argument(
        "--link",
        choices=LINK_NAMES,
        default="tcp",
        help="Wi-Fi alone, LoRa alone at the paper's rate, or Wi-Fi that is cut and LoRa (default: tcp)",
    )
    parser.add_argument(
        "--robot", default="car", help=f"{' or '.join(ROBOT_NAMES)}, or a file instead of its robot.toml (default: car)"
    )
    parser.add_argument("--station", metavar="FILE", type=Path, help="station.toml instead of the one that comes along")
    parser.add_argument("--out", metavar="DIR", type=Path, help="write map2d.png, mission.mcap and truth/ here")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    plan = _plan(args)
    logging.getLogger("station").setLevel(logging.WARNING)
    if args.seeds is not None:
        return _run_seeds(plan, args)
    figures = _run_one(plan, args.seed, args.out)
    if args.json:
        print(json.dumps(figures))
    else:
        for key, value in figures.items():
            print(f"{key:24} {value}")
    return EXIT_OK if figures["finished"] else EXIT_FAILED


def _plan(args: argparse.Namespace) -> _Plan:
    station = load_station(args.station)
    scenario, robot = with_robot_of(find_scenario(args.scenario), args.robot)
    if args.slip is not None:
        scenario = replace(scenario, encoders=replace(scenario.encoders, slip=SlipParameters.of(args.slip)))
    if args.gyro_bias is not None:
        scenario = replace(scenario, imu=replace(scenario.imu, gyro_bias_dps=args.gyro_bias))
    if args.method is not None:
        station = replace(station, method=args.method)
    return _Plan(scenario, robot, station, args.link)


def _run_seeds(plan: _Plan, args: argparse.Namespace) -> int:
    runs: dict[int, Figures] = {}
    print(header(), flush=True)
    for number in args.seeds:
        runs[number] = _run_one(plan, number, args.out / f"seed-{number}" if args.out is not None else None)
        print(row(str(number), runs[number]), flush=True)
    summary = over_seeds(runs)
    for name in ("mean", "worst"):
        print(row(name, summary[name]))
    if args.json:
        print(json.dumps({"scenario": plan.scenario.name} | summary))
    return EXIT_OK if all(figures["finished"] for figures in runs.values()) else EXIT_FAILED


def _run_one(plan: _Plan, number: int, out: Path | None) -> Figures:
    began_s, witness = stopwatch_s(), Witness()
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)

    def progress(simulated_s: float) -> None:
        if not sys.stderr.isatty():
            return
        pace = simulated_s / max(stopwatch_s() - began_s, 1e-6)
        print(f"\r{simulated_s:6.0f} s simulated, {pace:4.1f} x real time ", end="", file=sys.stderr, flush=True)

    result = run_mission(
        plan.scenario,
        number,
        plan.robot,
        plan.station,
        say=lambda text: print(f"{_line_break()}{text}", file=sys.stderr),
        progress=progress,
        recording=out / "mission.mcap" if out is not None else None,
        link=plan.link,
        witness=witness,
    )
    print(_line_break(), end="", file=sys.stderr)
    if out is not None:
        _draw(result, out)
    link = asdict(link_figures(witness, result.cuts, result.outcome.ended_s)) if plan.link != "tcp" else {}
    return {**_figures(plan.scenario, result), **{f"link_{key}": round(value, 4) for key, value in link.items()}}


def _figures(scenario: Scenario, result: MissionResult) -> Figures:
    goal = scenario.goals[-1].position_m if scenario.goals else None
    figures = summarise(result.truth, result.snapshot, result.figures, result.outcome, goal).as_json()
    slip = result.slip
    return figures | {
        "encoder_slip_net": round(sum(slip.net) / 2, 4),
        "encoder_slip_mean_abs": round(sum(slip.mean_abs) / 2, 4),
        "gyro_bias_dps": round(result.gyro_bias_dps, 3),
    }


def _share(text: str) -> float:
    value = _positive(text)
    if value > 0.5:
        raise argparse.ArgumentTypeError(f"{text!r} is no share from 0 to 0.5")
    return value


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from error
    if not 0 <= value < 1000:
        raise argparse.ArgumentTypeError(f"{text!r} is not from 0 to 1000")
    return value


def _line_break() -> str:
    """Ends the line of the progress, where there is one."""
    return "\n" if sys.stderr.isatty() else ""


def _draw(result: MissionResult, folder: Path) -> None:
    if result.snapshot is not None:
        snapshot = result.snapshot
        draw_map(snapshot.grid, snapshot.trajectory, snapshot.closures, folder / "map2d.png", title="Mission")
