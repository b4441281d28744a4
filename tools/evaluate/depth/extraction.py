"""`evaluate extraction`: how well and how fast 3D objects are extracted from depth images (paper 1, table 4)."""

from __future__ import annotations

import argparse
import functools
import json
import math
import operator
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import DepthImage
from robot_app.perception.config import PerceptionConfig
from robot_app.perception.fast_gng import FastGng, FastGngConfig
from robot_app.perception.growing_neural_gas import GngConfig, GrowingNeuralGas
from robot_app.perception.identity.tracker import ObjectTracker
from robot_app.perception.learner import Learner
from robot_app.perception.object_extractor import ObjectExtractor, clusters
from robot_app.perception.point_cloud import Mount
from shared.geometry.camera import CameraMount, Intrinsics
from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork
from tools.evaluate.depth._kernels import back_project, back_project_tabled
from tools.evaluate.depth.files import DepthFileError, read_depth
from tools.evaluate.depth.floor import find_floor
from tools.evaluate.depth.labels import LabelFigures, compare_with_labels
from tools.evaluate.depth.pictures import draw

_RUNS = 20
_LEAST_PX, _MOST_PX = 1.0, 100_000.0  # of a lens
_KINECT_WIDTHS = 585.0 / 640.0  # focal length of the 7-Scenes sequences, in widths of the image
_L515_FOV_RAD = (math.radians(70), math.radians(50))
_ROBOT_MOUNT = CameraMount(0.28, 0.17, 0.0)
_NOWHERE_M = 100.0  # so high that nothing in view is near the floor


@dataclass(frozen=True, slots=True)
class Figures:
    """A row of table 4; `points` as there: those of the decimated cloud.

    Times are medians of 20 warm runs: `learn_ms` steps 2-7, `total_ms` everything from the depth image to the network,
    `track_ms` to keep the objects' identity beyond that, of the same network again and again, `floor_ms` only reading
    every pixel and writing its point by the camera's equations, `floor_tabled_ms` the same with
    the slopes of all columns and rows worked out beforehand, as our own code has them. `camera_height_m`: over what was
    taken for the floor and is not drawn; None when nothing was. The shares are those of `labels`.
    """

    file: str
    camera_height_m: float | None
    points: int
    nodes: int
    connections: int
    clusters: int
    min_edge_m: float | None
    max_edge_m: float | None
    learn_ms: float
    total_ms: float
    track_ms: float
    floor_ms: float
    floor_tabled_ms: float
    object_recall: float | None
    boundary_precision: float | None
    boundary_recall: float | None


@dataclass(frozen=True, slots=True)
class Row:
    """The figures of one file, and what its shares are made of."""

    figures: Figures
    labels: LabelFigures | None

    @staticmethod
    def with_labels(figures: Figures, labels: LabelFigures) -> Row:
        """The same frame, compared with its labels too."""
        object_recall, precision, recall = _shares(labels)
        compared = replace(figures, object_recall=object_recall, boundary_precision=precision, boundary_recall=recall)
        return Row(compared, labels)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Extract 3D objects from depth images and print the figures of table 4 of paper 1."
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="PNG (16 bit, mm), .npy(.gz) (m), PCD")
    parser.add_argument("--intrinsics", type=parse_lens, metavar="FX,FY,CX,CY", help="of the camera, in pixels")
    parser.add_argument(
        "--mount",
        choices=("search", "robot", "none"),
        default="search",
        help="where the floor is: search it in each image, as the robot's camera has it, or nowhere",
    )
    parser.add_argument(
        "--learner",
        choices=("simplified", "fast", "standard"),
        default="simplified",
        help="simplified FastGNG, FastGNG or standard GNG (default simplified)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--picture", type=Path, metavar="DIR", help="draw each network over its image and in 3D from two sides"
    )


def run(args: argparse.Namespace) -> int:
    """Exit code 2 when a file cannot be read; the others are measured all the same."""
    rows = []
    refused = 0
    for path in args.files:
        try:
            rows.append(_evaluate(path, args))
        except DepthFileError as error:
            refused = 2
            print(error, file=sys.stderr)
    if not rows:
        return refused
    overall = overall_of(rows)
    if args.json:
        print(json.dumps({"files": [asdict(row.figures) for row in rows], "overall": asdict(overall)}))
    else:
        _print_table([*(row.figures for row in rows), overall])
    return refused


def parse_lens(text: str) -> tuple[float, ...]:
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 4 or not all(_LEAST_PX <= value <= _MOST_PX for value in values):  # NaN compares false
        raise argparse.ArgumentTypeError(f"four numbers FX,FY,CX,CY from {_LEAST_PX} to {_MOST_PX:.0f}, not {text!r}")
    return values


def _evaluate(path: Path, args: argparse.Namespace) -> Row:
    file = read_depth(path)
    intrinsics = intrinsics_of(path, file.image, args.intrinsics or file.lens_px)
    mount = mount_of(args.mount, file.image, intrinsics)
    try:
        extractor = extractor_with(args.learner, intrinsics, mount)
    except ValueError as error:
        raise DepthFileError(f"{path}: {error}") from error
    objects = extractor.extract(file.image)
    if args.picture:
        args.picture.mkdir(parents=True, exist_ok=True)
        draw(file.image, objects, intrinsics, mount).save(args.picture / f"{path.name}.png")
    labels = None if file.labels is None else compare_labels(file.image, file.labels, objects, intrinsics, mount)
    return measure(path.name, extractor, file.image, objects, intrinsics, mount, labels)


def extractor_with(name: str, intrinsics: Intrinsics, mount: Mount) -> ObjectExtractor:
    """An extractor as the robot has it, but with the learner of this name. Raises ValueError for a tiny image."""
    config = PerceptionConfig()
    learner: Learner | None = None
    if name == "fast":
        learner = FastGng(config.learning, FastGngConfig(), np.random.default_rng(1))
    elif name == "standard":
        learner = GrowingNeuralGas(GngConfig(), np.random.default_rng(1))
    return ObjectExtractor(config, intrinsics, mount, learner)


def compare_labels(
    image: DepthImage, labels: NDArray[np.int32], objects: ObjectNetwork, intrinsics: Intrinsics, mount: Mount
) -> LabelFigures:
    optical_from_robot = np.linalg.inv(mount.robot_from_optical())
    nodes_m = objects.nodes_m @ optical_from_robot[:3, :3].T + optical_from_robot[:3, 3]
    return compare_with_labels(image, labels, intrinsics, nodes_m, objects.edges.astype(np.int64), clusters(objects))


def intrinsics_of(path: Path, image: DepthImage, lens_px: tuple[float, ...] | None) -> Intrinsics:
    height, width = image.depth.shape
    if lens_px is None and path.suffix.lower() == ".png":
        lens_px = (_KINECT_WIDTHS * width, _KINECT_WIDTHS * width, width / 2, height / 2)
    if lens_px is None:
        return Intrinsics.from_field_of_view(width, height, *_L515_FOV_RAD)
    return Intrinsics(width, height, *lens_px)


def mount_of(choice: str, image: DepthImage, intrinsics: Intrinsics) -> Mount:
    if choice == "robot":
        return _ROBOT_MOUNT
    nowhere = CameraMount(0.0, _NOWHERE_M, 0.0)
    return nowhere if choice == "none" else find_floor(image, intrinsics) or nowhere


def camera_height_m(mount: Mount) -> float | None:
    """None when the camera was not told of a floor."""
    height_m = float(mount.robot_from_optical()[2, 3])
    return None if height_m >= _NOWHERE_M else round(height_m, 3)


def measure(
    name: str,
    extractor: ObjectExtractor,
    image: DepthImage,
    objects: ObjectNetwork,
    intrinsics: Intrinsics,
    mount: Mount,
    labels: LabelFigures | None = None,
) -> Row:
    """The figures of `image`, of which `extractor` made `objects`."""
    lengths_m = np.linalg.norm(np.diff(objects.nodes_m[objects.edges], axis=1)[:, 0], axis=1)
    extractor.find_edges(image)
    tracker = ObjectTracker(PerceptionConfig().tracking)
    columns, rows = intrinsics.ray_slopes()
    pinhole = (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)
    cloud_m = np.zeros((*image.depth.shape, 3), np.float32)
    figures = Figures(
        name,
        camera_height_m(mount),
        extractor.cloud.points,
        len(objects.nodes_m),
        len(objects.edges),
        len(set(clusters(objects).tolist())),
        round(float(lengths_m.min()), 3) if len(lengths_m) else None,
        round(float(lengths_m.max()), 3) if len(lengths_m) else None,
        _median_ms(extractor.learn),
        _median_ms(lambda: extractor.extract(image)),
        _median_ms(lambda: tracker.update(objects, Pose2())),
        _median_ms(lambda: back_project(image.depth, image.unit_m, *pinhole, cloud_m)),
        _median_ms(lambda: back_project_tabled(image.depth, image.unit_m, columns, rows, cloud_m)),
        *_shares(labels),
    )
    return Row(figures, labels)


def _shares(labels: LabelFigures | None) -> tuple[float | None, float | None, float | None]:
    if labels is None:
        return None, None, None
    return labels.object_recall, labels.boundary_precision, labels.boundary_recall


def _median_ms(work: Callable[[], object]) -> float:
    """Of this thread's time on its core: that of the clock when nothing else runs."""
    work()
    times = []
    for _ in range(_RUNS):
        start = time.thread_time()
        work()
        times.append(time.thread_time() - start)
    return round(1e3 * statistics.median(times), 3)


def overall_of(rows: list[Row]) -> Figures:
    """Medians, the extremes of the lengths, and the shares over all objects and points of all files."""
    figures = [row.figures for row in rows]
    shortest = [row.min_edge_m for row in figures if row.min_edge_m is not None]
    longest = [row.max_edge_m for row in figures if row.max_edge_m is not None]
    labels = [row.labels for row in rows if row.labels is not None]
    return Figures(
        "overall",
        None,
        round(statistics.median(row.points for row in figures)),
        round(statistics.median(row.nodes for row in figures)),
        round(statistics.median(row.connections for row in figures)),
        round(statistics.median(row.clusters for row in figures)),
        min(shortest, default=None),
        max(longest, default=None),
        round(statistics.median(row.learn_ms for row in figures), 3),
        round(statistics.median(row.total_ms for row in figures), 3),
        round(statistics.median(row.track_ms for row in figures), 3),
        round(statistics.median(row.floor_ms for row in figures), 3),
        round(statistics.median(row.floor_tabled_ms for row in figures), 3),
        *_shares(functools.reduce(operator.add, labels) if labels else None),
    )


def _print_table(rows: list[Figures]) -> None:
    names = list(asdict(rows[0]))
    width = max(len(row.file) for row in rows)
    print("  ".join([names[0].ljust(width), *(name.rjust(11) for name in names[1:])]))
    for row in rows:
        values = list(asdict(row).values())
        cells = ["-" if value is None else str(value) for value in values[1:]]
        print("  ".join([row.file.ljust(width), *(cell.rjust(11) for cell in cells)]))
