"""`evaluate sweep`: how 2D SLAM stands changes of a recorded log, measured by the same relations.

What no parameter was tuned on: another beginning, fewer scans or beams, more noise, worse wheels, the way backwards,
and more or less time for closing loops than the log left.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np

from shared.command_line import EXIT_OK, existing_file, seed
from shared.geometry.se2 import Pose2
from shared.messages import Observation
from station_gui.build import build_slam
from station_gui.config import StationConfig
from tools.evaluate.playing import Part, play, shipped
from tools.evaluate.slam import FloatArray, read_relations, relation_errors
from tools.logs.carmen import CarmenReader

Observations = list[Observation]
Change = Callable[[Observations, np.random.Generator], Observations]

_RANGE_SIGMA_M = 0.01
_WAY_SCALE, _TURN_SCALE = 1.05, 1.03
_WAY_NOISE, _TURN_NOISE = 0.05, 0.02  # for each metre driven: m, rad


@dataclass(frozen=True, slots=True)
class Variation:
    """`loop_time`: for closing loops, times what the station gives them; of graph SLAM."""

    text: str
    change: Change
    loop_time: float = 1.0


@dataclass(frozen=True, slots=True)
class SweepFigures:
    """Of one variation; `unlocated` as of `SlamFigures`."""

    variation: str
    relations: int
    translation_mean_m: float
    translation_std_m: float
    translation_max_m: float
    rotation_mean_deg: float
    rotation_std_deg: float
    loop_closures: int
    unlocated: int
    scans: int


def _as_it_is(observations: Observations, rng: np.random.Generator) -> Observations:
    return observations


def _from(observations: Observations, rng: np.random.Generator, *, share: float) -> Observations:
    return observations[int(len(observations) * share) :]


def _every_second_scan(observations: Observations, rng: np.random.Generator) -> Observations:
    return observations[::2]


def _every_second_beam(observations: Observations, rng: np.random.Generator) -> Observations:
    return [
        replace(
            seen,
            ranges_m=seen.ranges_m[::2],
            geometry=replace(
                seen.geometry,
                step_rad=2 * seen.geometry.step_rad,
                beam_interval_s=2 * seen.geometry.beam_interval_s,
            ),
        )
        for seen in observations
    ]


def _noisier(observations: Observations, rng: np.random.Generator) -> Observations:
    return [
        replace(seen, ranges_m=seen.ranges_m + rng.normal(0.0, _RANGE_SIGMA_M, len(seen.ranges_m)).astype(np.float32))
        for seen in observations
    ]


def _worse_wheels(observations: Observations, rng: np.random.Generator) -> Observations:
    changed, before, pose = [], observations[0].odom_from_robot, observations[0].odom_from_robot
    for seen in observations:
        step, before = before.inverse() @ seen.odom_from_robot, seen.odom_from_robot
        way_m = float(np.hypot(step.x_m, step.y_m))
        slip_m, turn_rad = way_m * rng.standard_normal(2) * (_WAY_NOISE, _TURN_NOISE)
        pose = pose @ Pose2(_WAY_SCALE * step.x_m + slip_m, step.y_m, _TURN_SCALE * step.theta_rad + turn_rad)
        changed.append(replace(seen, odom_from_robot=pose))
    return changed


def _backwards(observations: Observations, rng: np.random.Generator) -> Observations:
    """The stamps stay those of the scans, for the relations: mapping never looks at how they go."""
    return observations[::-1]


VARIATIONS = {
    "whole": Variation("as it is", _as_it_is),
    "hurried": Variation("0.6 times the time for loops", _as_it_is, 0.6),
    "unhurried": Variation("2.4 times the time for loops", _as_it_is, 2.4),
    "late7": Variation("begins after 7 %", partial(_from, share=0.07)),
    "late20": Variation("begins after 20 %", partial(_from, share=0.2)),
    "late40": Variation("begins after 40 %", partial(_from, share=0.4)),
    "scans": Variation("every second scan", _every_second_scan),
    "beams": Variation("every second beam", _every_second_beam),
    "noise": Variation("1 cm more noise", _noisier),
    "wheels": Variation("wheels 5 % wrong, gyro 3 %, and as much at random", _worse_wheels),
    "backwards": Variation("backwards", _backwards),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", type=existing_file, help="CARMEN log, plain, .gz or .bz2")
    parser.add_argument(
        "--relations", type=existing_file, required=True, help="relations made by hand: t1 t2 x y z r p yaw"
    )
    parser.add_argument("--method", choices=("graph", "particle"), default="graph", help="of SLAM (default: graph)")
    parser.add_argument(
        "--only", nargs="+", choices=list(VARIATIONS), default=list(VARIATIONS), metavar="VARIATION",
        help=f"of {', '.join(VARIATIONS)}",
    )  # fmt: skip
    parser.add_argument("--seed", type=seed, default=0, help="of the noise and the particle filter (default: 0)")
    parser.add_argument("--json", action="store_true", help="print one JSON object for each variation")


def run(args: argparse.Namespace) -> int:
    observations, relations = list(CarmenReader(args.log)), read_relations(args.relations)
    for name in args.only:
        variation = VARIATIONS[name]
        config = with_loop_time(shipped(args.method, args.seed), variation.loop_time)
        figures = measure(variation, observations, relations, config, np.random.default_rng(args.seed))
        print(json.dumps(asdict(figures)) if args.json else _row(figures), flush=True)
    return EXIT_OK


def measure(
    variation: Variation,
    observations: Sequence[Observation],
    relations: FloatArray,
    config: StationConfig,
    rng: np.random.Generator,
) -> SweepFigures:
    played = play(Part(variation.change(list(observations), rng)), build_slam(config))
    shift_m, turn_rad = relation_errors(played.stamps_s, played.poses, relations)
    return SweepFigures(
        variation=variation.text,
        relations=len(shift_m),
        translation_mean_m=float(shift_m.mean()),
        translation_std_m=float(shift_m.std()),
        translation_max_m=float(shift_m.max()),
        rotation_mean_deg=float(np.degrees(turn_rad).mean()),
        rotation_std_deg=float(np.degrees(turn_rad).std()),
        loop_closures=played.loop_closures,
        unlocated=played.unlocated,
        scans=len(played.scans),
    )


def with_loop_time(config: StationConfig, times: float) -> StationConfig:
    """For graph SLAM; the particle filter takes what it needs at its steps."""
    loops = config.slam.loops
    loops = replace(loops, units_per_step=round(times * loops.units_per_step))
    return replace(config, slam=replace(config.slam, loops=loops))


def _row(figures: SweepFigures) -> str:
    """Of a Markdown table."""
    shift = f"{figures.translation_mean_m:.4f} ± {figures.translation_std_m:.4f} m"
    turn = f"{figures.rotation_mean_deg:.3f} ± {figures.rotation_std_deg:.3f}°"
    return (
        f"| {figures.variation} | {figures.relations} | {shift} | {figures.translation_max_m:.2f} m | {turn} | "
        f"{figures.loop_closures} | {figures.unlocated} of {figures.scans} |"
    )
