"""`evaluate mission`: the demo's mission in lock-step, no window."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from pathlib import Path

from robot_app.config import load_config as load_robot
from shared.command_line import seed
from shared.runtime.clock import stopwatch_s
from station_gui.config import load_config as load_station
from tools.evaluate.summary import summarise
from tools.pictures import draw_map
from tools.simulator.lockstep import MissionResult, run_mission
from tools.simulator.scenario import find_scenario


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenario", default="lab", help="a scenario's name or TOML file (default: lab)")
    parser.add_argument("--seed", type=seed, default=1, help="of all noise (default: 1)")
    parser.add_argument("--robot", metavar="FILE", type=Path, help="robot.toml instead of the one that comes along")
    parser.add_argument("--station", metavar="FILE", type=Path, help="station.toml instead of the one that comes along")
    parser.add_argument("--out", metavar="DIR", type=Path, help="write map2d.png and mission.mcap here")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    scenario = find_scenario(args.scenario)
    logging.getLogger("station").setLevel(logging.WARNING)
    began_s = stopwatch_s()

    if args.out is not None:
        args.out.mkdir(parents=True, exist_ok=True)

    def progress(simulated_s: float) -> None:
        if not sys.stderr.isatty():
            return
        pace = simulated_s / max(stopwatch_s() - began_s, 1e-6)
        print(f"\r{simulated_s:6.0f} s simulated, {pace:4.1f} x real time ", end="", file=sys.stderr, flush=True)

    result = run_mission(
        scenario,
        args.seed,
        load_robot(args.robot),
        load_station(args.station),
        say=lambda text: print(f"{_line_break()}{text}", file=sys.stderr),
        progress=progress,
        recording=args.out / "mission.mcap" if args.out is not None else None,
    )
    print(_line_break(), end="", file=sys.stderr)
    goal = scenario.goals[-1].position_m if scenario.goals else None
    summary = summarise(result.truth, result.snapshot, result.figures, result.outcome, goal).as_json()
    if args.out is not None:
        _draw(result, args.out)
    if args.json:
        print(json.dumps(summary))
    else:
        for key, value in summary.items():
            print(f"{key:24} {value}")
    return 0 if result.outcome.failure == "" else 1


def _line_break() -> str:
    """Ends the line of the progress, where there is one."""
    return "\n" if sys.stderr.isatty() else ""


def _draw(result: MissionResult, folder: Path) -> None:
    if result.snapshot is not None:
        snapshot = result.snapshot
        draw_map(snapshot.grid, snapshot.trajectory, snapshot.closures, folder / "map2d.png", title="Mission")
