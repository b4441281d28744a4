"""Accuracy and speed of 2D SLAM on a public log, by relations made by hand (Kümmerle et al. 2009)."""

from __future__ import annotations

import argparse
import bz2
import gzip
import json
import os
import resource
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TextIO, cast

import numpy as np
from numpy.typing import NDArray

from shared.command_line import EXIT_MISUSE, EXIT_OK, existing_file, seed
from station_gui.export.tum import write_tum
from station_gui.mapping.slam2d.se2_arrays import between
from tools.evaluate.playing import Run, play, shipped_slam
from tools.logs.base import LogError
from tools.logs.carmen import CarmenReader

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SlamFigures:
    """What `evaluate slam` prints. Times are by the clock; those named cpu are what was computed in them.

    `cpu_seconds` is of all threads, `step_cpu_ms` of the mapping thread. `closure_offset_max_m`: as of
    `Run`, of the worst closure; a false one that was believed shows there, or in the relations. `unlocated`: scans that
    came while the station did not know where the robot is. `resamplings` and `effective_share`, the mean effective
    number as a share of the particles, are those of the particle filter.
    """

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
    closure_offset_max_m: float | None
    unlocated: int
    resamplings: int | None
    effective_share: float | None
    cpu_seconds: float
    cpu_realtime_factor: float
    step_ms_max: float
    step_cpu_ms_p50: float
    step_cpu_ms_p99: float
    step_cpu_ms_p99_first_1000: float
    step_cpu_ms_p99_last_1000: float
    step_cpu_ms_max: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", type=existing_file, help="CARMEN log, plain, .gz or .bz2")
    parser.add_argument(
        "--relations", type=existing_file, required=True, help="relations made by hand: t1 t2 x y z r p yaw"
    )
    parser.add_argument("--method", choices=("graph", "particle"), default="graph", help="of SLAM (default: graph)")
    parser.add_argument("--seed", type=seed, default=0, help="of the particle filter (default: 0)")
    parser.add_argument(
        "--trajectory", type=writable_file, help="write `time x y z qx qy qz qw` of every scan to this file"
    )
    parser.add_argument("--json", action="store_true", help="print the figures as one JSON object")


def run(args: argparse.Namespace) -> int:
    relations = read_relations(args.relations)
    result = play(CarmenReader(args.log), shipped_slam(args.method, args.seed))
    if result.truncated is not None:
        print(result.truncated, file=sys.stderr)
    figures = asdict(summarise(result, relations))
    if unused := len(relations) - figures["relations"]:
        print(f"{unused} of {len(relations)} relations are left out: their stamps are not in the log", file=sys.stderr)
    if args.json:
        print(json.dumps(figures), flush=True)
    else:
        for key, value in figures.items():
            print(f"{key:28s} {value:.4f}" if isinstance(value, float) else f"{key:28s} {value}", flush=True)
    if args.trajectory is not None:
        write_tum(args.trajectory, np.column_stack((result.stamps_s, result.poses)))
    return EXIT_OK if result.truncated is None else EXIT_MISUSE


def writable_file(text: str) -> Path:
    """For a command line: refused before the work, not after it."""
    path = Path(text)
    if path.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: is a folder, not a file")
    if not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: there is no folder {path.parent}")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise argparse.ArgumentTypeError(f"{text}: cannot be written")
    return path


def summarise(result: Run, relations: FloatArray) -> SlamFigures:
    if not result.scans:
        raise LogError(result.truncated or "the log holds no scan")
    translation_m, rotation_rad = relation_errors(result.stamps_s, result.poses, relations)
    wall_ms = 1e3 * np.array([step.wall_s for step in result.steps])
    cpu_ms = 1e3 * np.array([step.thread_s for step in result.steps])
    played_s = float(np.ptp(result.stamps_s))
    return SlamFigures(
        scans=len(result.scans),
        relations=len(translation_m),
        translation_mean_m=float(translation_m.mean()),
        translation_std_m=float(translation_m.std()),
        rotation_mean_deg=float(np.degrees(rotation_rad).mean()),
        rotation_std_deg=float(np.degrees(rotation_rad).std()),
        seconds=result.wall_s,
        realtime_factor=played_s / result.wall_s,
        step_ms_p50=float(np.percentile(wall_ms, 50)),
        step_ms_p99=float(np.percentile(wall_ms, 99)),
        step_ms_p99_first_1000=float(np.percentile(wall_ms[:1000], 99)),
        step_ms_p99_last_1000=float(np.percentile(wall_ms[-1000:], 99)),
        peak_rss_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        loop_closures=result.loop_closures,
        closure_offset_max_m=float(result.closure_offsets_m.max()) if len(result.closure_offsets_m) else None,
        unlocated=result.unlocated,
        resamplings=result.resamplings,
        effective_share=result.effective_share,
        cpu_seconds=result.cpu_s,
        cpu_realtime_factor=played_s / result.cpu_s,
        step_ms_max=float(wall_ms.max()),
        step_cpu_ms_p50=float(np.percentile(cpu_ms, 50)),
        step_cpu_ms_p99=float(np.percentile(cpu_ms, 99)),
        step_cpu_ms_p99_first_1000=float(np.percentile(cpu_ms[:1000], 99)),
        step_cpu_ms_p99_last_1000=float(np.percentile(cpu_ms[-1000:], 99)),
        step_cpu_ms_max=float(cpu_ms.max()),
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
        raise LogError("no relation names two stamps of the log: they are those of another one")
    return np.array(translation), np.array(rotation)
