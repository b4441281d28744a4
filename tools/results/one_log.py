"""One log by one method, in a process of its own: figures as one JSON object, and the map as a small picture."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from PIL import Image

from shared.command_line import EXIT_OK, Parser, existing_file, run
from station_gui.mapping.slam2d.graph_slam import GraphSlam
from station_gui.mapping.slam2d.particle.particle_slam import ParticleSlam
from tools.evaluate import slam as slam_log
from tools.evaluate import urg as urg_log
from tools.logs.base import LogError
from tools.logs.urg import UrgReader
from tools.pictures import draw_map, palette

_MAX_BYTES = 150_000
_LONG_SIDES_PX = (1000, 900, 800, 700, 500)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="one_log", description=__doc__)
    parser.add_argument("log", type=existing_file)
    parser.add_argument("--relations", type=existing_file, help="of a CARMEN log; without it the log is a URG's")
    parser.add_argument("--method", choices=("graph", "particle"), required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--picture", type=Path, required=True)
    parser.add_argument("--title", required=True)
    return parser


def measure(args: argparse.Namespace) -> dict[str, Any]:
    slam = slam_log.make_slam(args.method, args.seed)
    if args.relations is not None:
        relations = slam_log.read_relations(args.relations)
        figures = asdict(slam_log.summarise(slam_log.play(args.log, slam), relations))
    else:
        figures = urg_log.measure(urg_log.play(UrgReader(args.log), slam))[1]
    _draw(slam, args.picture, args.title)
    return figures


def _draw(slam: GraphSlam | ParticleSlam, path: Path, title: str) -> None:
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
    print(json.dumps(measure(_parser().parse_args())))
    return EXIT_OK


def main() -> int:
    return run("one_log", _work, also=(LogError,))


if __name__ == "__main__":
    sys.exit(main())
