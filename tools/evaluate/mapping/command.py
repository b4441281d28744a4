"""`evaluate map`: missions in lock-step with different seeds, and how good their 2D and 3D maps are.

Missions are simulated once and mapped as often as wanted: with `--recording DIR` they are kept in DIR, a folder for
each, and taken from there the next time.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import sys
import tempfile
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

from tqdm import tqdm

from robot_app.config import load_config as load_robot
from shared.command_line import EXIT_FAILED, EXIT_OK, Refused, number_in, seed, whole_number_in
from station_gui.config import StationConfig
from station_gui.config import load_config as load_station
from tools.evaluate.mapping.pictures import draw_beside_truth, draw_overlay
from tools.evaluate.mapping.repeat import repeatability
from tools.evaluate.mapping.trial import Trial, is_recorded, map_again, simulate, warm_up
from tools.simulator.links import LINK_NAMES, LinkName
from tools.simulator.scenario import Scenario, find_scenario

tqdm.monitor_interval = 0  # its thread would outlive the bar

_MORE_IS_BETTER = frozenset({"map_completeness", "object_recall", "heights_known", "refresh_hz"})
_SHOWN = (
    "map_rmse_m", "map_completeness", "object_rmse_m", "object_recall", "phantom_objects", "height_error_m",
    "known_height_error_m", "heights_known", "slam_ms_p50", "combine_ms_p50", "bytes_per_observation", "refresh_hz",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenario", default="lab", help="a scenario's name or TOML file (default: lab)")
    parser.add_argument(
        "--trials", type=whole_number_in(1, 100), default=5, metavar="N", help="missions over each link (default: 5)"
    )
    parser.add_argument("--seed", type=seed, default=1, help="of the first; the next ones count on (default: 1)")
    parser.add_argument(
        "--link",
        type=link_list,
        default=("tcp",),
        metavar="LINKS",
        help="between robot and station: tcp, lora, switch, or several as in tcp,lora (default: tcp)",
    )
    parser.add_argument(
        "--minutes", type=number_in(1.0, 120.0), metavar="M", help="drive on from goal to goal until so much has passed"
    )
    parser.add_argument(
        "--steps",
        type=step_list,
        metavar="LIST",
        help="of the 2D-3D combination, as in 1 or 1,2,3 (default: 1,2,3,4,5)",
    )
    parser.add_argument(
        "--recording",
        metavar="DIR",
        type=Path,
        help="missions are kept here and mapped again the next time, which needs no simulation",
    )
    parser.add_argument("--robot", metavar="FILE", type=Path, help="robot.toml instead of the one that comes along")
    parser.add_argument("--station", metavar="FILE", type=Path, help="station.toml instead of the one that comes along")
    parser.add_argument(
        "--pictures", metavar="DIR", type=Path, help="write all maps over one another, and each beside the truth, here"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    logging.getLogger("station").setLevel(logging.ERROR)
    logging.getLogger("robot_app").setLevel(logging.ERROR)
    with tempfile.TemporaryDirectory() as passing:
        trials = _trials(args, args.recording if args.recording is not None else Path(passing))
    if args.pictures is not None:
        _draw(trials, args.pictures)
    report = {"scenario": args.scenario, "link": ",".join(args.link), **over_trials(trials)}
    print(_row("mean", report))
    print(_row("worst", report["worst"]))
    for key in ("repeatability_m", "only_in_one", "grid_repeatability_m"):
        print(f"{key:24} {report[key]:.4f}")
    if args.json:
        print(json.dumps({key: _rounded(value) for key, value in report.items()}))
    return EXIT_OK if report["finished"] else EXIT_FAILED


def _trials(args: argparse.Namespace, folder: Path) -> list[Trial]:
    scenario, robot, station = find_scenario(args.scenario), load_robot(args.robot), _station(args)
    print(_header(), flush=True)
    trials: list[Trial] = []
    for number, link in enumerate((link for link in args.link for _ in range(args.trials)), args.seed):
        place = folder / _name_of(args, scenario, link, number)
        if not is_recorded(place):
            with tqdm(desc=place.name, unit=" s simulated", disable=not sys.stderr.isatty(), leave=False) as bar:
                simulate(scenario, link, number, robot, station, place, partial(_show, bar), args.minutes)
        if not trials:
            warm_up(place, station)
        trials.append(map_again(place, station))
        print(_row(str(number), figures_of(trials[-1])), flush=True)
    return trials


def _draw(trials: list[Trial], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    scenario = trials[0].driven.scenario
    draw_overlay(trials, folder / f"{scenario}-overlay.png", f"{scenario}: {len(trials)} trials over one another")
    for trial in trials:
        name = f"{scenario}-{trial.driven.link}-{trial.driven.seed}"
        draw_beside_truth(trial, folder / f"{name}.png", name)


def _show(bar: tqdm[NoReturn], simulated_s: float) -> None:
    bar.update(round(simulated_s) - bar.n)


def _station(args: argparse.Namespace) -> StationConfig:
    station = load_station(args.station)
    if args.steps is None:
        return station
    try:
        return replace(station, combine=replace(station.combine, steps=args.steps))
    except ValueError as error:
        raise Refused(f"--steps {','.join(map(str, args.steps))}: {error}") from error


def _name_of(args: argparse.Namespace, scenario: Scenario, link: LinkName, number: int) -> str:
    length = f"-{args.minutes:g}min" if args.minutes is not None else ""
    return f"{scenario.name}-{link}{length}-{number}"


def link_list(text: str) -> tuple[LinkName, ...]:
    known: dict[str, LinkName] = {name: name for name in LINK_NAMES}
    parts = text.split(",")
    if not all(part in known for part in parts) or len(set(parts)) != len(parts):
        raise argparse.ArgumentTypeError(f"{text!r} is no list of links; write one or several of {','.join(known)}")
    return tuple(known[part] for part in parts)


def step_list(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    if not all(part.isdecimal() and len(part) == 1 for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is no list of steps; write 1 or 1,2,3")
    return tuple(int(part) for part in parts)


def figures_of(trial: Trial) -> dict[str, Any]:
    """By the names of the report."""
    driven = asdict(trial.driven)
    return {
        "seed": driven.pop("seed"),
        **asdict(trial.map_error),
        **asdict(trial.object_error),
        **trial.costs.figures(),
        "observations": len(trial.costs.slam),
        **{key: value for key, value in driven.items() if key != "scenario"},
    }


def over_trials(trials: list[Trial]) -> dict[str, Any]:
    """Means, the worst, what all maps together tell, and the figures of each trial."""
    runs = [figures_of(trial) for trial in trials]
    alike = asdict(repeatability([t.objects.segments_m for t in trials], [t.occupied_m for t in trials]))
    numbers = [key for key, value in runs[0].items() if type(value) in {int, float} and key != "seed"]
    mean = {key: _mean([run[key] for run in runs]) for key in numbers}
    worst = {key: _worst(key, [run[key] for run in runs]) for key in numbers}
    return {"finished": all(run["finished"] for run in runs), **mean, **alike, "worst": worst, "trials": runs}


def _mean(values: list[float]) -> float:
    there = [value for value in values if not math.isnan(value)]
    return sum(there) / len(there) if there else math.nan


def _worst(key: str, values: list[float]) -> float:
    there = [value for value in values if not math.isnan(value)] or [math.nan]
    return min(there) if key in _MORE_IS_BETTER else max(there)


def _rounded(value: Any) -> Any:
    """Without digits that mean nothing; what is no number becomes null."""
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(inner) for inner in value]
    if isinstance(value, float):
        return None if math.isnan(value) else round(value, 5)
    return value


def _header() -> str:
    return f"{'trial':>6}" + "".join(f"{key:>{len(key) + 2}}" for key in _SHOWN)


def _row(name: str, figures: dict[str, Any]) -> str:
    return f"{name:>6}" + "".join(f"{figures[key]:>{len(key) + 2}.4g}" for key in _SHOWN)
