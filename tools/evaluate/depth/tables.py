"""`evaluate tables`: measures what docs/extraction.md shows, and writes it there between its marks."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from robot_app.drivers.base import DepthImage
from robot_app.perception.config import PerceptionConfig
from robot_app.perception.object_extractor import ObjectExtractor
from robot_app.perception.point_cloud import Mount
from shared.geometry.camera import Intrinsics
from shared.messages import ObjectNetwork
from tools.evaluate.depth import learners
from tools.evaluate.depth.drawing import measure_drawing
from tools.evaluate.depth.extraction import Row, compare_labels, intrinsics_of, measure, mount_of, overall_of
from tools.evaluate.depth.files import DepthFileError, read_depth
from tools.evaluate.depth.lab_frames import lab_camera, lab_frames
from tools.evaluate.depth.pictures import draw
from tools.evaluate.depth.stability import measure_stability
from tools.evaluate.depth.variations import VARIATIONS, read_views
from tools.evaluate.depth.variations import measure as measure_variation

_KINECT_STEP = 96  # of the frames' numbers: ten of the sequence's first 960
_PAPER_TABLE_2 = (
    ("standard GNG", 150, 165, 67.9, 1.0),
    ("FastGNG", 150, 281, 22.2, 3.1),
    ("simplified FastGNG", 151, 138, 16.2, 4.2),
)
_PAPER_TABLE_4 = (
    ("paper, 14a", 8586, 77, 80, 8, 0.100, 2.430, 32.7),
    ("paper, 14b", 11647, 48, 49, 3, 0.100, 3.210, 27.6),
    ("paper, 14c", 10455, 61, 67, 5, 0.100, 3.180, 34.6),
    ("paper, 14d", 10802, 80, 86, 2, 0.102, 1.575, 35.6),
    ("paper, 14e", 13948, 54, 60, 1, 0.102, 1.217, 32.1),
    ("paper, 14f", 14094, 70, 76, 2, 0.100, 0.560, 30.0),
)
_NOISES = 3  # frames of each view, of which only the noise differs
_PICTURES = {
    "lab view 3": "lab",
    "flat view 3": "flat",
    "lab view 7": "lab-bare",
    "frame-000096.depth.png": "kinect",
    "test55.pcd": "tabletop",
    "depth_array.npy.gz": "parcel",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("data", type=Path, metavar="DIR", help="with kinect_sequence/, l515/ and labelled_tabletop/")
    parser.add_argument("document", type=Path, metavar="FILE", help="the document to write into")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw the frames that the document shows, here")


def run(args: argparse.Namespace) -> int:
    """Exit code 2 when a file cannot be read or the document has no marks."""
    try:
        text = args.document.read_text(encoding="utf-8")
        for name, table in (
            ("table 2", _table_2(args.data)),
            ("batches", _batches(args.data)),
            ("table 4", _table_4(args.data, args.pictures)),
            ("variations", _variations(args.data)),
            ("drawing", _drawing()),
            ("stability", _stability()),
        ):
            text = replace_between(text, name, table)
    except (DepthFileError, ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    args.document.write_text(text, encoding="utf-8")
    return 0


def replace_between(text: str, name: str, table: list[str]) -> str:
    """`text` with the lines of `table` between the marks of `name`. Raises ValueError when these are not there."""
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise ValueError(f"the document needs {begin} and {end}, once each and in this order")
    return text[: text.index(begin) + len(begin)] + "\n" + "\n".join(table) + "\n" + text[text.index(end) :]


def _kinect(data: Path) -> list[Path]:
    return [data / "kinect_sequence" / f"frame-{_KINECT_STEP * k:06d}.depth.png" for k in range(10)]


def _clouds(data: Path) -> list[Path]:
    return sorted((data / "labelled_tabletop").glob("*.pcd"))


def _table_2(data: Path) -> list[str]:
    lines = ["| learner | nodes | connections | ms | times as fast | |", "|---|---|---|---|---|---|"]
    lines += [f"| {name} | {n} | {c} | {ms} | {fast} | paper, Pi |" for name, n, c, ms, fast in _PAPER_TABLE_2]
    for where, files, lab in (("7-Scenes", _kinect(data), False), ("simulated lab", [], True)):
        frames, rows = learners.compare_all(files, lab=lab)
        for row in rows:
            lines.append(
                f"| {row.learner} | {row.nodes} | {row.connections} | {row.learn_ms} | {row.times_as_fast} "
                f"| {where}, {frames} frames |"
            )
    return lines


def _batches(data: Path) -> list[str]:
    lines = ["| samples in a batch | nodes | times as slow as one | node error mm | line error mm |", "|---" * 5 + "|"]
    lines += [
        f"| {row.batch} | {row.nodes} | {row.times_as_slow} | {row.node_error_mm} | {row.line_error_mm} |"
        for row in learners.compare_batches(_kinect(data))
    ]
    return lines


def _table_4(data: Path, pictures: Path | None) -> list[str]:
    lines = [
        "| frame | floor | points | nodes | connections | clusters | shortest | longest | ms | tracking | floor ms "
        "| tabled | objects found | boundary precision | recall |",
        "|---" * 15 + "|",
    ]
    for name, points, nodes, connections, found, low, high, ms in _PAPER_TABLE_4:
        lines.append(
            f"| {name} | | {points} | {nodes} | {connections} | {found} | {low} m | {high} m | {ms} | | | | | | |"
        )
    lab, flat = (_measure_views(scenario_name, pictures) for scenario_name in ("lab", "flat"))
    files = [*_kinect(data), *sorted((data / "l515").glob("*.npy.gz")), *_clouds(data)]
    read = [_measure_file(path, pictures) for path in files]
    for group in (lab, flat, read[:10], read[10:12], read[12:]):
        lines += [_line(row) for row in group]
        lines.append(_line(Row(overall_of(group), None), "**median**"))
    floorless = [_measure_file(path, None, "none") for path in files[12:]]
    lines.append(_line(Row(overall_of(floorless), None), "*labelled, no floor*"))
    return lines


def _line(row: Row, name: str = "") -> str:
    f = row.figures
    floor = None if f.camera_height_m is None else f"{-f.camera_height_m:.2f} m"
    values = [
        name or f.file,
        floor,
        f.points,
        f.nodes,
        f.connections,
        f.clusters,
        f.min_edge_m,
        f.max_edge_m,
        f.total_ms,
    ]
    values += [f.track_ms, f.floor_ms, f.floor_tabled_ms, f.object_recall, f.boundary_precision, f.boundary_recall]
    return "| " + " | ".join("" if value is None else str(value) for value in values) + " |"


def _measure_views(scenario_name: str, pictures: Path | None) -> list[Row]:
    camera = lab_camera(scenario_name)
    images = lab_frames(scenario_name=scenario_name)
    return [_measure(f"{scenario_name} view {k}", image, *camera, pictures) for k, image in enumerate(images)]


def _measure_file(path: Path, pictures: Path | None, floor: str = "search") -> Row:
    file = read_depth(path)
    intrinsics = intrinsics_of(path, file.image, file.lens_px)
    mount = mount_of(floor, file.image, intrinsics)
    row = _measure(path.name, file.image, intrinsics, mount, pictures)
    if file.labels is None:
        return row
    objects = _extractor(intrinsics, mount).extract(file.image)
    labels = compare_labels(file.image, file.labels, objects, intrinsics, mount)
    return Row.with_labels(row.figures, labels)


def _measure(name: str, image: DepthImage, intrinsics: Intrinsics, mount: Mount, pictures: Path | None) -> Row:
    extractor = _extractor(intrinsics, mount)
    objects: ObjectNetwork = extractor.extract(image)
    if pictures is not None and name in _PICTURES:
        draw(image, objects, intrinsics, mount).save(pictures / f"extraction-{_PICTURES[name]}.png")
    return measure(name, extractor, image, objects, intrinsics, mount)


def _extractor(intrinsics: Intrinsics, mount: Mount) -> ObjectExtractor:
    return ObjectExtractor(PerceptionConfig(), intrinsics, mount)


def _variations(data: Path) -> list[str]:
    views = read_views(_clouds(data))
    return [
        "| | objects found | boundary precision | recall |",
        "|---" * 4 + "|",
        *(
            f"| {row.variation} | {row.object_recall} | {row.boundary_precision} | {row.boundary_recall} |"
            for row in (measure_variation(name, views) for name in VARIATIONS)
        ),
    ]


def _drawing() -> list[str]:
    lines = [
        "| view | ideal nodes | connections | drawn nodes | connections | of the ideal drawn | of the drawn true |",
        "|---" * 7 + "|",
    ]
    for scenario_name in ("lab", "flat"):
        for row in measure_drawing(scenario_name, _NOISES):
            name = f"**{scenario_name}, overall**" if row.view == "overall" else row.view
            counts = f"{row.ideal_nodes} | {row.ideal_connections} | {row.nodes} | {row.connections}"
            lines.append(f"| {name} | {counts} | {_percent(row.ideal_drawn)} | {_percent(row.drawn_true)} |")
    return lines


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.0f} %"


def _stability() -> list[str]:
    lines = ["| | nodes within 3 cm | median step | connections kept |", "|---|---|---|---|"]
    for name, found in zip(("learned anew", "tracked"), measure_stability(), strict=True):
        lines.append(
            f"| {name} | {100 * found.nodes_within_3_cm:.0f} % | {found.median_step_mm:.1f} mm "
            f"| {100 * found.connections_kept:.0f} % |"
        )
    return lines
