"""Accuracy and speed of 2D SLAM on a public log, by relations made by hand (Kümmerle et al. 2009)."""

from __future__ import annotations

import argparse
import bz2
import gzip
import json
import resource
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TextIO, cast

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.scan import to_points
from station_gui.mapping.slam2d.config import GraphSlamConfig
from station_gui.mapping.slam2d.graph_slam import GraphSlam
from station_gui.mapping.slam2d.particle.config import ParticleSlamConfig
from station_gui.mapping.slam2d.particle.particle_slam import ParticleSlam
from station_gui.mapping.slam2d.se2_arrays import between
from tools.logs.base import LogError
from tools.logs.carmen import CarmenReader
from tools.tum import write_tum

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SlamFigures:
    """What `evaluate slam` prints."""

    scans: int
    relations: int
    translation_mean_m: float
    translation_std_m: float
    rotation_mean_deg: float
    rotation_std_deg: float
    seconds: float
    realtime_factor: float
    step_ms_p50: float
    step_ms_p99: float
    step_ms_p99_first_1000: float
    step_ms_p99_last_1000: float
    peak_rss_mb: float
    loop_closures: int


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """`stamps_s`: (N,), `poses`: (N, 3) after the last optimisation, `steps_s`: (N,) time of each step."""

    stamps_s: FloatArray
    poses: FloatArray
    steps_s: FloatArray
    finish_s: float
    loop_closures: int
    truncated: str | None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", type=Path, help="CARMEN log, plain, .gz or .bz2")
    parser.add_argument("--relations", type=Path, required=True, help="relations made by hand: t1 t2 x y z r p yaw")
    parser.add_argument("--method", choices=("graph", "particle"), default="graph", help="of SLAM (default: graph)")
    parser.add_argument("--seed", type=_seed, default=0, help="of the particle filter (default: 0)")
    parser.add_argument("--trajectory", type=Path, help="write `time x y z qx qy qz qw` of every scan to this file")
    parser.add_argument("--json", action="store_true", help="print the figures as one JSON object")


def run(args: argparse.Namespace) -> int:
    try:
        relations = read_relations(args.relations)
        result = play(args.log, make_slam(args.method, args.seed))
        figures = asdict(summarise(result, relations))
    except LogError as error:
        print(error, file=sys.stderr)
        return 2
    if args.trajectory is not None:
        write_tum(args.trajectory, np.column_stack((result.stamps_s, result.poses)))
    if args.json:
        print(json.dumps(figures))
    else:
        for key, value in figures.items():
            print(f"{key:24s} {value:.4f}" if isinstance(value, float) else f"{key:24s} {value}")
    if result.truncated is not None:
        print(result.truncated, file=sys.stderr)
        return 2
    return 0


def _seed(text: str) -> int:
    seed = int(text)
    if seed < 0:
        raise argparse.ArgumentTypeError(f"a seed is not negative: {seed}")
    return seed


def make_slam(method: str, seed: int) -> GraphSlam | ParticleSlam:
    """`method` with the parameters that it is shipped with; `seed`: of the particle filter."""
    if method == "particle":
        return ParticleSlam(ParticleSlamConfig(), np.random.default_rng(seed))
    return GraphSlam(GraphSlamConfig())


def play(log: Path, slam: GraphSlam | ParticleSlam) -> Run:
    """The whole log through the shipped SLAM, in the order of the file."""
    reader = CarmenReader(log)
    stamps, steps = [], []
    for observation in reader:
        began_s = time.perf_counter()
        slam.add(to_points(observation))
        steps.append(time.perf_counter() - began_s)
        stamps.append(observation.stamp_s)
    began_s = time.perf_counter()
    slam.finish()
    finish_s = time.perf_counter() - began_s
    return Run(np.array(stamps), slam.scan_poses(), np.array(steps), finish_s, len(slam.closures()), reader.truncated)


def summarise(result: Run, relations: FloatArray) -> SlamFigures:
    translation_m, rotation_rad = relation_errors(result.stamps_s, result.poses, relations)
    milliseconds = result.steps_s * 1e3
    seconds = float(result.steps_s.sum()) + result.finish_s
    played_s = float(result.stamps_s.max() - result.stamps_s.min())
    return SlamFigures(
        scans=len(result.stamps_s),
        relations=len(translation_m),
        translation_mean_m=float(translation_m.mean()),
        translation_std_m=float(translation_m.std()),
        rotation_mean_deg=float(np.degrees(rotation_rad).mean()),
        rotation_std_deg=float(np.degrees(rotation_rad).std()),
        seconds=seconds,
        realtime_factor=played_s / seconds,
        step_ms_p50=float(np.percentile(milliseconds, 50)),
        step_ms_p99=float(np.percentile(milliseconds, 99)),
        step_ms_p99_first_1000=float(np.percentile(milliseconds[:1000], 99)),
        step_ms_p99_last_1000=float(np.percentile(milliseconds[-1000:], 99)),
        peak_rss_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        loop_closures=result.loop_closures,
    )


def read_relations(path: Path) -> FloatArray:
    """(N, 5): t1, t2, x, y, yaw."""
    try:
        with _open_text(path) as stream:
            rows = [[float(v) for v in line.split()] for line in stream if line.strip()]
    except (OSError, EOFError, ValueError) as error:
        raise LogError(f"{path}: cannot be read as relations: {error}") from error
    for number, row in enumerate(rows, 1):
        if len(row) != 8:
            raise LogError(f"{path}: line {number}: {len(row)} of 8 fields")
    if not rows:
        raise LogError(f"{path}: holds no relation")
    return np.array(rows)[:, [0, 1, 2, 3, 7]]


def _open_text(path: Path) -> TextIO:
    if path.suffix == ".gz":
        return cast("TextIO", gzip.open(path, "rt"))
    if path.suffix == ".bz2":
        return cast("TextIO", bz2.open(path, "rt"))
    return path.open()


def relation_errors(stamps_s: FloatArray, poses: FloatArray, relations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Absolute error of every relation whose stamps are in the log: metres and radians."""
    index = {round(float(stamp) * 1e6): k for k, stamp in enumerate(stamps_s)}
    translation, rotation = [], []
    for t1, t2, x, y, yaw in relations:
        first, second = index.get(round(t1 * 1e6)), index.get(round(t2 * 1e6))
        if first is None or second is None:
            continue
        error = between(np.array([x, y, yaw]), between(poses[first], poses[second]))
        translation.append(float(np.hypot(error[0], error[1])))
        rotation.append(abs(float(error[2])))
    if not translation:
        raise LogError("no relation names two stamps of the log")
    return np.array(translation), np.array(rotation)


def main() -> int:
    parser = argparse.ArgumentParser(prog="evaluate slam", description=__doc__)
    add_arguments(parser)
    return run(parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
