"""Walls and revisits of the map of a log that has no ground truth (URG-04LX with wheel encoders)."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from shared.command_line import EXIT_MISUSE, EXIT_OK, existing_file, seed
from station_gui.export.map_picture import draw_map
from tools.evaluate.playing import Run, play, shipped_slam
from tools.evaluate.urg.cloud import Cloud, cloud_of, range_noise_m
from tools.evaluate.urg.double_pictures import draw_double
from tools.evaluate.urg.free_poses import free_poses
from tools.evaluate.urg.revisit import MARKED_VISITS, revisit
from tools.evaluate.urg.walls import Wall, find_walls
from tools.logs.base import LogError
from tools.logs.urg import UrgReader

_MAX_RANGE_M = 4.0  # a URG-04LX promises no more


@dataclass(frozen=True, slots=True)
class WallFigures:
    """Over all walls, weighted by their length; `_worst` is that of the worst wall."""

    walls: int
    wall_length_m: float
    wall_thickness_m: float
    wall_thickness_worst_m: float
    wall_p95_m: float
    wall_scanner_m: float
    wall_bend_m: float
    wall_bend_worst_m: float
    double_walls: int
    double_length_m: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("logs", nargs="+", metavar="LOG", type=existing_file, help="URG-04LX logs: .dat, .dat.gz")
    parser.add_argument("--method", choices=("graph", "particle"), default="graph", help="of SLAM (default: graph)")
    parser.add_argument("--seed", type=seed, default=0, help="of the particle filter (default: 0)")
    parser.add_argument("--out", metavar="DIR", type=Path, help="write the map of each log here, and its doubles")
    parser.add_argument("--free", action="store_true", help="measure doubles also with every scan moved to fit (slow)")
    parser.add_argument("--walls", action="store_true", help="print each wall as well")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    reports, status = {}, EXIT_OK
    for log in args.logs:
        slam = shipped_slam(args.method, args.seed)
        played = play(UrgReader(log), slam)
        if played.truncated is not None:
            print(played.truncated, file=sys.stderr)
            status = EXIT_MISUSE
        name = log_name(log)
        walls, report = measure(played, name)
        clouds = {"": cloud_of(played.scans, played.poses, _MAX_RANGE_M)}
        if args.free:
            poses = free_poses(played.scans, played.poses, _MAX_RANGE_M)
            clouds["-free"] = cloud_of(played.scans, poses, _MAX_RANGE_M)
            report |= doubles_of_free_poses(clouds["-free"])
        reports[name] = report
        if args.out is not None:
            args.out.mkdir(parents=True, exist_ok=True)
            draw_map(slam.grid(), slam.trajectory(), slam.closures(), args.out / f"{name}.png", title=name)
            for kind, cloud in clouds.items():
                _draw_doubles(cloud, args.out, f"{name}{kind}")
        _print(name, report, walls if args.walls else [])
    if args.json:
        print(json.dumps({"method": args.method, "logs": reports}))
    return status


def log_name(log: Path) -> str:
    return log.name.split(".")[0]


def measure(played: Run, name: str) -> tuple[list[Wall], dict[str, float | int | None]]:
    """`name`: of the log, for the visits to its start that were marked by hand."""
    if not played.scans:
        raise LogError(played.truncated or "the log holds no scan")
    cloud = cloud_of(played.scans, played.poses, _MAX_RANGE_M)
    walls = find_walls(cloud)
    back = revisit(cloud, played.poses, MARKED_VISITS.get(name))
    odometry = np.array([scan.odom_from_robot.as_array() for scan in played.scans])
    figures: dict[str, float | int] = {"scans": len(played.scans), "unlocated": played.unlocated}
    figures |= {"loop_closures": played.loop_closures, "seconds": played.wall_s, "cpu_seconds": played.cpu_s}
    figures |= asdict(wall_figures(walls)) | {"scanner_noise_m": range_noise_m(np.array(played.ranges_m), odometry)}
    figures |= {f"revisit_{key}": value for key, value in (asdict(back) if back is not None else {}).items()}
    return walls, {key: _rounded(value) for key, value in figures.items()}


def doubles_of_free_poses(cloud: Cloud) -> dict[str, float | int]:
    """What is there twice whatever the trajectory: `cloud` has the poses that the surfaces themselves agree on."""
    figures = wall_figures(find_walls(cloud))
    return {"double_walls_free": figures.double_walls, "double_length_free_m": round(figures.double_length_m, 4)}


def wall_figures(walls: list[Wall]) -> WallFigures:
    length_m = np.array([wall.length_m for wall in walls])

    def mean(name: str) -> float:
        values = np.array([getattr(wall, name) for wall in walls])
        known = np.isfinite(values)
        return float(np.average(values[known], weights=length_m[known])) if known.any() else math.nan

    return WallFigures(
        walls=len(walls),
        wall_length_m=float(length_m.sum()),
        wall_thickness_m=mean("thickness_m"),
        wall_thickness_worst_m=max((wall.thickness_m for wall in walls), default=math.nan),
        wall_p95_m=mean("p95_m"),
        wall_scanner_m=mean("scanner_m"),
        wall_bend_m=mean("bend_m"),
        wall_bend_worst_m=max((wall.bend_m for wall in walls), default=math.nan),
        double_walls=sum(wall.double_m > 0 for wall in walls),
        double_length_m=sum(wall.double_m for wall in walls),
    )


def _draw_doubles(cloud: Cloud, folder: Path, name: str) -> None:
    spans = [(wall.line, span_m) for wall in find_walls(cloud) for span_m in wall.double_spans_m]
    for number, (line, span_m) in enumerate(spans, start=1):
        picture = folder / f"{name}-double{number}.png"
        draw_double(cloud, line, span_m, picture, title=f"{name}: {span_m[1] - span_m[0]:.1f} m twice")


def _print(name: str, report: dict[str, float | int | None], walls: list[Wall]) -> None:
    for key, value in report.items():
        print(f"{name:12} {key:26} {value}")
    for wall in sorted(walls, key=lambda w: -w.length_m):
        (x1, y1), (x2, y2) = wall.ends_m.tolist()
        print(
            f"{name:12} wall {x1:6.2f} {y1:6.2f} to {x2:6.2f} {y2:6.2f}, {wall.length_m:4.1f} m, {wall.scans:3} scans: "
            f"thickness {1e3 * wall.thickness_m:4.1f} mm, p95 {1e3 * wall.p95_m:4.1f}, "
            f"scanner {1e3 * wall.scanner_m:4.1f}, "
            f"bend {1e3 * wall.bend_m:4.1f}, double {wall.double_m:3.1f} m"
        )


def _rounded(value: float) -> float | int | None:
    if isinstance(value, int):
        return value
    return round(value, 4) if math.isfinite(value) else None
