"""`evaluate missions`: many observations in rooms that were re-arranged at random, in lock-step.

Each trial has its own room, start and noise. With `--out` each trial's figures are kept there as they come, with a
picture, and a later call goes on where this one was stopped.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from shared.command_line import EXIT_FAILED, EXIT_OK, Refused, whole_number_in
from station_gui.config import load_config as load_station
from tools.evaluate.missions.floor import CELL_M
from tools.evaluate.missions.trial import Trial, TrialFigures, run_trial
from tools.evaluate.seeds import seed_list
from tools.simulator.links import LINK_NAMES
from tools.simulator.plan_view import MARGIN_M, plan_view
from tools.simulator.robots import with_robot_of
from tools.simulator.scenario import ROBOT_NAMES, find_scenario

_COLUMNS = ("trial", "contacts", "floor_seen", "ended", "seconds", "distance_m", "mean_mps", "max_mps", "stuck_s")
_MISSED = np.array([255, 150, 140], np.float32)
_PIXELS_PER_M = 120


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenario", default="lab", help="a scenario's name or TOML file (default: lab)")
    parser.add_argument("--rearranged", action="store_true", help="its things elsewhere, and the start, at random")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--trials", type=whole_number_in(1, 1000), default=50, help="how many (default: 50)")
    which.add_argument("--only", type=seed_list, metavar="LIST", help="these trials, as in 1-15 or 1,4,7-9")
    parser.add_argument("--link", choices=LINK_NAMES, default="tcp", help="between robot and station (default: tcp)")
    parser.add_argument(
        "--unmapped",
        action="store_true",
        help="without the station's map and the depth camera, on which nothing here depends: three times as fast",
    )
    parser.add_argument(
        "--robot", default="car", help=f"{' or '.join(ROBOT_NAMES)}, or a file instead of its robot.toml (default: car)"
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="keep figures and a picture of each trial here")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    for name in ("station", "robot_app"):
        logging.getLogger(name).setLevel(logging.ERROR)
    numbers = args.only if args.only is not None else tuple(range(1, args.trials + 1))
    kept = _kept(args.out)
    print("".join(f"{key:>11}" for key in _COLUMNS), file=sys.stderr, flush=True)
    rows: list[TrialFigures] = []
    for number in numbers:
        figures = kept.get(number)
        if figures is None:
            figures = _run_one(number, args)
        rows.append(figures)
        print(_line(figures), file=sys.stderr, flush=True)
    summary = summarise(rows)
    if args.json:
        print(json.dumps({"scenario": args.scenario, **summary, "runs": [asdict(row) for row in rows]}))
    else:
        for key, value in summary.items():
            print(f"{key:24} {value}")
    return EXIT_OK if summary["good"] == len(rows) else EXIT_FAILED


def summarise(rows: Sequence[TrialFigures]) -> dict[str, Any]:
    seconds = sum(row.seconds for row in rows)
    return {
        "trials": len(rows),
        "good": sum(row.good for row in rows),
        "contacts": sum(row.contacts for row in rows),
        "ended": sum(row.ended for row in rows),
        "floor_seen_mean": round(float(np.mean([row.floor_seen for row in rows])), 4),
        "floor_seen_min": min(row.floor_seen for row in rows),
        "seconds_mean": round(seconds / len(rows), 1),
        "seconds_max": max(row.seconds for row in rows),
        "mean_mps": round(sum(row.distance_m for row in rows) / max(seconds, 1e-9), 4),
        "mean_mps_min": min(row.mean_mps for row in rows),
        "max_mps": max(row.max_mps for row in rows),
        "stuck_s_max": max(row.stuck_s for row in rows),
    }


def _run_one(number: int, args: argparse.Namespace) -> TrialFigures:
    scenario, robot = with_robot_of(find_scenario(args.scenario), args.robot)
    trial = run_trial(
        number,
        scenario,
        robot,
        load_station(None),
        args.link,
        at_random=args.rearranged,
        mapped=not args.unmapped,
        progress=_progress,
    )
    if args.out is not None:
        picture(trial).save(args.out / f"trial-{number}.png")
        (args.out / f"trial-{number}.json").write_text(json.dumps(asdict(trial.figures)) + "\n", "utf-8")
    return trial.figures


def picture(trial: Trial) -> Image.Image:
    """The room and the way driven; reachable floor that was not seen is red."""
    view = plan_view(trial.room, trial.poses[:, 1:3], _PIXELS_PER_M)
    missed = trial.floor.reachable & ~trial.floor.seen(trial.poses)
    pixels = np.asarray(view, np.float32).copy()
    for row, column in np.argwhere(missed).tolist():
        left = round((MARGIN_M + column * CELL_M) * _PIXELS_PER_M)
        low = view.height - round((MARGIN_M + row * CELL_M) * _PIXELS_PER_M)
        side = round(CELL_M * _PIXELS_PER_M)
        pixels[low - side : low, left : left + side] = _MISSED
    return Image.fromarray(pixels.astype(np.uint8))


def _kept(folder: Path | None) -> dict[int, TrialFigures]:
    """What an earlier call has measured."""
    if folder is None:
        return {}
    folder.mkdir(parents=True, exist_ok=True)
    found = {}
    for path in sorted(folder.glob("trial-*.json")):
        try:
            figures = TrialFigures(**json.loads(path.read_text("utf-8")))
        except (ValueError, TypeError) as error:
            raise Refused(f"{path}: is no trial's figures ({error}); remove it") from error
        found[figures.trial] = figures
    return found


def _line(figures: TrialFigures) -> str:
    values = asdict(figures)
    told = "".join(f"{values[key]!s:>11}" for key in _COLUMNS)
    return f"{told}  {figures.failure}{'' if figures.good else '  <-'}"


def _progress(simulated_s: float) -> None:
    if sys.stderr.isatty():
        print(f"\r{simulated_s:6.0f} s simulated ", end="\r", file=sys.stderr, flush=True)
