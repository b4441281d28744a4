"""One log by one method, in a process of its own: figures as one JSON object, and the map as a small picture."""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from PIL import Image

from shared.command_line import EXIT_OK, Parser, Refused, existing_file, run
from station_gui.export.map_picture import draw_map, palette
from station_gui.mapping.slam2d.base import SessionSlam
from tools.evaluate import slam as slam_log
from tools.evaluate.playing import play, shipped_slam
from tools.evaluate.urg import command as urg_log
from tools.logs.base import LogError, LogReader
from tools.logs.carmen import CarmenReader
from tools.logs.urg import UrgReader
from tools.results import continued

_MAX_BYTES = 150_000
_LONG_SIDES_PX = (1000, 900, 800, 700, 500)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="one_log", description=__doc__)
    parser.add_argument("log", type=existing_file)
    parser.add_argument("--relations", type=existing_file, help="of a CARMEN log; without it the log is a URG's")
    parser.add_argument("--method", choices=("graph", "particle"), required=True)
    parser.add_argument("--continued", action="store_true", help="in two sessions, without a picture")
    parser.add_argument("--picture", type=Path, help="of the map")
    parser.add_argument("--title", default="", help="of the picture")
    return parser


def measure(args: argparse.Namespace) -> dict[str, Any]:
    if args.continued:
        return asdict(continued.measure(args.log, args.relations, args.method))
    slam = shipped_slam(args.method, 0)
    reader: LogReader = UrgReader(args.log) if args.relations is None else CarmenReader(args.log)
    played = play(reader, slam)
    figures: dict[str, Any]
    if args.relations is not None:
        figures = asdict(slam_log.summarise(played, slam_log.read_relations(args.relations)))
    else:
        figures = urg_log.measure(played, urg_log.log_name(args.log))[1]
    if args.picture is not None:
        _draw(slam, args.picture, args.title)
    return figures | {"trajectory_sha256": hashlib.sha256(played.poses.tobytes()).hexdigest()}


def _draw(slam: SessionSlam, path: Path, title: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    draw_map(slam.grid(), slam.trajectory(), slam.closures(), path, title=title)
    shrink(path)


def shrink(path: Path) -> None:
    """Make a picture small enough to keep beside the text: few colours, and as many pixels as there is room for."""
    with Image.open(path) as picture:
        whole = picture.convert("RGB")
    colours = Image.new("P", (1, 1))
    colours.putpalette([value for colour in palette() for value in colour])
    for long_side_px in _LONG_SIDES_PX:
        small = whole.copy()
        small.thumbnail((long_side_px, long_side_px), Image.Resampling.LANCZOS)
        small.quantize(palette=colours, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size <= _MAX_BYTES:
            return


def _work() -> int:
    args = _parser().parse_args()
    if args.continued and args.relations is None:
        raise Refused("--continued needs the --relations")
    print(json.dumps(measure(args)))
    return EXIT_OK


def main() -> int:
    return run("one_log", _work, also=(LogError,))


if __name__ == "__main__":
    sys.exit(main())
