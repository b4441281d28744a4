"""`replay`: a recorded mission or a public log through the station's own pipeline, to pictures and a summary."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from shared.command_line import EXIT_MISUSE, EXIT_OK, Parser, Refused, existing_file, run, set_up_logging
from shared.geometry.se2 import Pose2
from shared.messages import Observation
from shared.protocol import wire
from shared.protocol.codec import Decoder
from shared.recording import MissionReader, RecordingError
from shared.runtime.clock import stopwatch_s
from station_gui.build import build_pipeline
from station_gui.config import load_config
from station_gui.export.bundle import export_map
from station_gui.export.map_picture import draw_map
from station_gui.export.tum import write_tum
from station_gui.mapping.pipeline import MappingPipeline
from station_gui.mapping.saved_map import MapFileError, read_map, write_map
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.snapshot import Tracking
from tools.logs.base import LogError
from tools.logs.carmen import CarmenReader
from tools.logs.urg import UrgReader

tqdm.monitor_interval = 0  # its thread would outlive the bar


class Source(Protocol):
    """A log of observations."""

    @property
    def truncated(self) -> str | None:
        """One line that names the log and where it ended early; None for a whole one."""
        ...

    def __iter__(self) -> Iterator[Observation]: ...

    def count(self) -> int:
        """How many observations there are, for the progress bar."""
        ...


class MissionSource:
    """The observations of a mission recorded by the station."""

    def __init__(self, path: Path) -> None:
        self._reader = MissionReader(path)
        self._path = path
        self._decoder = Decoder()

    @property
    def truncated(self) -> str | None:
        if self._reader.truncated is not None:
            return self._reader.truncated
        counts = self._decoder.counts
        damaged = counts.damaged + counts.malformed
        if counts.other_version:
            return f"{self._path}: {counts.other_version} messages of another protocol version were left out"
        return f"{self._path}: {damaged} damaged messages were left out" if damaged else None

    def __iter__(self) -> Iterator[Observation]:
        for recorded in self._reader:
            message = self._decoder.decode(recorded.datagram)
            if isinstance(message, Observation):
                yield message

    def count(self) -> int:
        kind = wire.TYPE_OF[Observation]
        return sum(recorded.datagram[1] == kind for recorded in MissionReader(self._path))


@dataclass(slots=True)
class Played:
    """Counters of a replay."""

    observations: int = 0
    refused: int = 0
    located: int = 0  # observations after which the robot's place in the map was known
    first_s: float = math.nan
    last_s: float = math.nan
    seconds: float = 0.0
    way: list[tuple[float, Pose2]] = field(default_factory=list)  # stamp and map_from_robot of the located ones


def play(source: Source, pipeline: MappingPipeline, name: str) -> Played:
    """Everything through the pipeline, with a progress bar on stderr."""
    played = Played()
    began_s = stopwatch_s()
    shown = sys.stderr.isatty()
    total = source.count() if shown else None
    for observation in tqdm(source, name, total, unit=" scans", disable=not shown, dynamic_ncols=True):
        try:
            pipeline.add(observation)
        except MappingError as error:
            played.refused += 1
            if played.refused == 1:
                tqdm.write(f"replay: {error}", file=sys.stderr)
            continue
        if played.observations == 0:
            played.first_s = observation.stamp_s
        played.observations += 1
        played.last_s = observation.stamp_s
        if pipeline.tracking is Tracking.LOCATED:
            played.located += 1
            played.way.append((observation.stamp_s, pipeline.map_from_robot))
    pipeline.finish()
    played.seconds = stopwatch_s() - began_s
    return played


def _write(
    played: Played, pipeline: MappingPipeline, source: Source, title: str, folder: Path, *, localised: bool
) -> None:
    """`localised`: the map was given and not changed; the way is the robot's through it."""
    snapshot = pipeline.snapshot()
    way, closures = snapshot.trajectory, snapshot.closures
    if localised:
        way, closures = _located(played), np.zeros((0, 2), np.int32)
    folder.mkdir(parents=True, exist_ok=True)
    draw_map(snapshot.grid, way, closures, folder / "map2d.png", title=title)
    write_tum(folder / "trajectory.tum", way)
    log_s = played.last_s - played.first_s
    steps = np.diff(way[:, 1:3], axis=0)
    summary = {
        "source": title,
        "observations": played.observations,
        "observations_refused": played.refused,
        "observations_located": played.located,
        "tracking": snapshot.tracking.name.lower(),
        "keyframes": len(snapshot.trajectory),
        "loop_closures": len(snapshot.closures),
        "distance_m": round(float(np.hypot(*steps.T).sum()), 2),
        "log_s": round(log_s, 2),
        "seconds": round(played.seconds, 2),
        "realtime_factor": round(log_s / played.seconds, 1) if played.seconds > 0 else None,
        "ms_per_scan": round(1000 * played.seconds / max(played.observations, 1), 3),
        "objects_3d_segments": len(snapshot.objects.segments_m),
        "cell_m": snapshot.grid.cell_m,
        "occupied_cells": len(snapshot.grid.occupied_m()),
        "truncated": source.truncated,
    }
    (folder / "summary.json").write_text(json.dumps(summary, indent=1) + "\n", "utf-8")


def _located(played: Played) -> NDArray[np.float64]:
    """(K, 4): stamp_s, x_m, y_m, theta_rad of every scan whose place in the map was known, map frame."""
    return np.array([(stamp_s, *pose.as_array()) for stamp_s, pose in played.way]).reshape(-1, 4)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="replay",
        description="Plays a recording through the station's own mapping as fast as it goes and writes map2d.png, "
        "trajectory.tum (of the scans that are in the map; with --localise of every scan that was located) and "
        "summary.json.",
        epilog="example: replay --mission out/demo/mission.mcap --out out/again",
    )
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--mission", metavar="MCAP", type=existing_file, help="a mission recorded by the station")
    source.add_argument(
        "--carmen", metavar="LOG", type=existing_file, help="a CARMEN log: .clf, .log, also .gz or .bz2"
    )
    source.add_argument(
        "--urg",
        metavar="LOG",
        type=existing_file,
        help="a URG-04LX log with wheel encoders: .dat, .dat.gz; "
        "of the robot and the scanner of the public logs, whose errors are taken out",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="where the results are written")
    parser.add_argument("--station", metavar="FILE", type=Path, help="station.toml instead of the one that comes along")
    parser.add_argument(
        "--export", metavar="DIR", type=Path, help="write the map here for other programs: PLY, glTF, Nav2, PNG, TUM"
    )
    parser.add_argument("--save-map", metavar="FILE", type=Path, help="keep the map in this file")
    parser.add_argument("--map", metavar="FILE", type=existing_file, help="begin with this map and go on mapping in it")
    parser.add_argument("--localise", action="store_true", help="only localise in the --map; it is not changed")
    parser.add_argument("--verbose", action="store_true", help="log everything")
    return parser


def _source(args: argparse.Namespace) -> tuple[Source, str]:
    if args.mission is not None:
        return MissionSource(args.mission), args.mission.name
    if args.carmen is not None:
        return CarmenReader(args.carmen), args.carmen.name
    return UrgReader(args.urg), args.urg.name


def _work(args: argparse.Namespace) -> int:
    if args.localise and args.map is None:
        raise Refused("--localise needs the --map to localise in")
    pipeline = build_pipeline(load_config(args.station))
    if args.map is not None:
        pipeline.open_map(read_map(args.map), fixed=args.localise)
    source, title = _source(args)
    played = play(source, pipeline, title)
    if played.observations == 0:
        raise Refused(source.truncated or f"{title}: no scan in it")
    if args.save_map is not None:
        write_map(pipeline.saved_map(), args.save_map)
    if args.export is not None:
        export_map(pipeline.snapshot(), args.export, title)
    try:
        _write(played, pipeline, source, title, args.out, localised=args.localise)
    except OSError as error:
        raise Refused(f"{error.filename or args.out}: cannot be written: {error.strerror}") from error
    print(f"{played.observations} scans in {played.seconds:.1f} s: results in {args.out}")
    if source.truncated is not None:
        print(f"replay: {source.truncated}", file=sys.stderr)
        return EXIT_MISUSE
    return EXIT_OK


def main() -> int:
    args = _parser().parse_args()
    set_up_logging(args.verbose)
    return run("replay", lambda: _work(args), also=(LogError, RecordingError, MapFileError))


if __name__ == "__main__":
    sys.exit(main())
