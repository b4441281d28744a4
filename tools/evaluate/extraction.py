"""`evaluate extraction`: how well and how fast 3D objects are extracted from depth images (paper 1, table 4)."""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from robot_app.drivers.base import DepthImage
from robot_app.perception.config import PerceptionConfig
from robot_app.perception.object_extractor import ObjectExtractor, clusters
from robot_app.perception.point_cloud import Mount
from shared.geometry.camera import CameraMount, Intrinsics
from shared.messages import ObjectNetwork
from tools.evaluate.depth_files import DepthFileError, read_depth

_RUNS = 20
_KINECT_PX = (585.0, 585.0, 320.0, 240.0)  # of the 7-Scenes sequences
_L515_FOV_RAD = (math.radians(70), math.radians(50))
_ROBOT_MOUNT = CameraMount(0.28, 0.17, 0.0)
_COLOURS = (
    (255, 70, 70),
    (80, 255, 80),
    (100, 140, 255),
    (255, 170, 0),
    (0, 255, 255),
    (255, 90, 255),
    (255, 255, 150),
)


@dataclass(frozen=True, slots=True)
class Figures:
    """A row of table 4; `points` as there: those of the decimated cloud."""

    file: str
    points: int
    nodes: int
    connections: int
    clusters: int
    min_edge_m: float | None
    max_edge_m: float | None
    learn_ms: float
    total_ms: float
    floor_ms: float


@dataclass(frozen=True, slots=True, eq=False)
class FloorMount:
    """A camera held by hand: `matrix` (4, 4) takes its optical frame to one that stands on the floor."""

    matrix: NDArray[np.float64]

    def robot_from_optical(self) -> NDArray[np.float64]:
        return self.matrix


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Extract 3D objects from depth images and print the figures of table 4 of paper 1."
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="PNG (16 bit, mm), .npy(.gz) (m), PCD")
    parser.add_argument("--intrinsics", type=_lens, metavar="FX,FY,CX,CY", help="of the camera, in pixels")
    parser.add_argument(
        "--mount",
        choices=("search", "robot", "none"),
        default="search",
        help="where the floor is: search it in each image, as the robot's camera has it, or nowhere",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--picture", type=Path, metavar="DIR", help="draw each network over its image")


def run(args: argparse.Namespace) -> int:
    """Exit code 2 when a file cannot be read."""
    rows = []
    for path in args.files:
        try:
            rows.append(_evaluate(path, args))
        except DepthFileError as error:
            print(error, file=sys.stderr)
            return 2
    overall = _overall(rows)
    if args.json:
        print(json.dumps({"files": [asdict(row) for row in rows], "overall": asdict(overall)}))
    else:
        _print_table([*rows, overall])
    return 0


def _lens(text: str) -> tuple[float, ...]:
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 4 or min(values, default=0.0) <= 0.0:
        raise argparse.ArgumentTypeError(f"four positive numbers FX,FY,CX,CY, not {text!r}")
    return values


def _evaluate(path: Path, args: argparse.Namespace) -> Figures:
    file = read_depth(path)
    intrinsics = _intrinsics(path, file.image, args.intrinsics or file.lens_px)
    mount = _mount(args.mount, file.image, intrinsics)
    try:
        extractor = ObjectExtractor(PerceptionConfig(), intrinsics, mount, np.random.default_rng(1))
    except ValueError as error:
        raise DepthFileError(f"{path}: {error}") from error
    objects = extractor.extract(file.image)
    figures = _measure(path.name, extractor, file.image, objects, intrinsics)
    if args.picture:
        args.picture.mkdir(parents=True, exist_ok=True)
        _draw(file.image, objects, intrinsics, mount).save(args.picture / f"{path.name}.png")
    return figures


def _intrinsics(path: Path, image: DepthImage, lens_px: tuple[float, ...] | None) -> Intrinsics:
    height, width = image.depth.shape
    if lens_px is None and path.suffix == ".png":
        lens_px = _KINECT_PX
    if lens_px is None:
        return Intrinsics.from_field_of_view(width, height, *_L515_FOV_RAD)
    return Intrinsics(width, height, *lens_px)


def _mount(choice: str, image: DepthImage, intrinsics: Intrinsics) -> Mount:
    if choice == "robot":
        return _ROBOT_MOUNT
    nowhere = CameraMount(0.0, 100.0, 0.0)
    return nowhere if choice == "none" else find_floor(image, intrinsics) or nowhere


def find_floor(image: DepthImage, intrinsics: Intrinsics) -> FloorMount | None:
    """The lowest large plane that faces up, if less than 2 % of the points lie below it; None without one."""
    points = _points_m(image, intrinsics)[::37]
    if len(points) < 100:
        return None
    rng = np.random.default_rng(1)
    best: tuple[float, NDArray[np.float64]] | None = None
    for _ in range(600):
        a, b, c = points[rng.integers(0, len(points), 3)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-3:
            continue
        normal = normal / length * (-1.0 if normal[1] > 0 else 1.0)
        if -normal[1] < 0.5:  # the camera is held upright to within 60 degrees
            continue
        heights = (points - a) @ normal
        share = float(np.mean(np.abs(heights) < 0.02))
        if share > 0.04 and np.mean(heights < -0.05) < 0.02 and (best is None or share > best[0]):
            best = share, np.append(normal, -normal @ a)
    return None if best is None else FloorMount(_standing_frame(best[1]))


def _standing_frame(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) for a floor `plane[:3] @ p + plane[3] == 0`: z up, x where the camera looks."""
    up = plane[:3]
    forward = np.array([0.0, 0.0, 1.0]) - up[2] * up
    forward /= np.linalg.norm(forward)
    matrix = np.eye(4)
    matrix[:3, :3] = forward, np.cross(up, forward), up
    matrix[2, 3] = plane[3]
    return matrix


def _points_m(image: DepthImage, intrinsics: Intrinsics) -> NDArray[np.float64]:
    """(N, 3) optical frame."""
    columns, rows = intrinsics.ray_slopes()
    depth_m = image.depth * image.unit_m
    points = np.stack((columns[None, :] * depth_m, rows[:, None] * depth_m, depth_m), axis=-1)
    picked: NDArray[np.float64] = points[image.depth > 0].astype(np.float64)
    return picked


def _measure(
    name: str, extractor: ObjectExtractor, image: DepthImage, objects: ObjectNetwork, intrinsics: Intrinsics
) -> Figures:
    lengths_m = np.linalg.norm(np.diff(objects.nodes_m[objects.edges], axis=1)[:, 0], axis=1)
    extractor.find_edges(image)
    columns, rows = intrinsics.ray_slopes()
    cloud_m = np.zeros((*image.depth.shape, 3), np.float32)
    return Figures(
        name,
        extractor.cloud.points,
        len(objects.nodes_m),
        len(objects.edges),
        len(set(clusters(objects).tolist())),
        round(float(lengths_m.min()), 3) if len(lengths_m) else None,
        round(float(lengths_m.max()), 3) if len(lengths_m) else None,
        _median_ms(extractor.learn),
        _median_ms(lambda: extractor.extract(image)),
        _median_ms(lambda: _back_project(image.depth, image.unit_m, columns, rows, cloud_m)),
    )


@njit(nogil=True, cache=True)
def _back_project(
    depth: NDArray[np.uint16],
    unit_m: float,
    slope_x: NDArray[np.float32],
    slope_y: NDArray[np.float32],
    cloud_m: NDArray[np.float32],
) -> None:
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            z = np.float32(depth[i, j] * unit_m)
            cloud_m[i, j, 0] = slope_x[j] * z
            cloud_m[i, j, 1] = slope_y[i] * z
            cloud_m[i, j, 2] = z


def _median_ms(work: Callable[[], object]) -> float:
    work()
    times = []
    for _ in range(_RUNS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return round(1e3 * statistics.median(times), 3)


def _overall(rows: list[Figures]) -> Figures:
    """Medians, and the extremes of the lengths."""
    shortest = [row.min_edge_m for row in rows if row.min_edge_m is not None]
    longest = [row.max_edge_m for row in rows if row.max_edge_m is not None]
    return Figures(
        "overall",
        round(statistics.median(row.points for row in rows)),
        round(statistics.median(row.nodes for row in rows)),
        round(statistics.median(row.connections for row in rows)),
        round(statistics.median(row.clusters for row in rows)),
        min(shortest, default=None),
        max(longest, default=None),
        round(statistics.median(row.learn_ms for row in rows), 3),
        round(statistics.median(row.total_ms for row in rows), 3),
        round(statistics.median(row.floor_ms for row in rows), 3),
    )


def _print_table(rows: list[Figures]) -> None:
    names = list(asdict(rows[0]))
    width = max(len(row.file) for row in rows)
    print("  ".join([names[0].ljust(width), *(name.rjust(11) for name in names[1:])]))
    for row in rows:
        values = list(asdict(row).values())
        cells = ["-" if value is None else str(value) for value in values[1:]]
        print("  ".join([row.file.ljust(width), *(cell.rjust(11) for cell in cells)]))


def _draw(image: DepthImage, objects: ObjectNetwork, intrinsics: Intrinsics, mount: Mount) -> Image.Image:
    """The network over the depth image, near is light; a colour for each cluster."""
    depth_m = image.depth * image.unit_m
    far_m = float(np.percentile(depth_m[depth_m > 0], 99)) if (depth_m > 0).any() else 1.0
    shade = np.where(depth_m > 0, np.clip(200.0 * (1.1 - depth_m / far_m), 20.0, 200.0), 0.0)
    picture = Image.fromarray(shade.astype(np.uint8)).convert("RGB")
    pen = ImageDraw.Draw(picture)
    optical = np.linalg.inv(mount.robot_from_optical())
    points = objects.nodes_m @ optical[:3, :3].T + optical[:3, 3]
    u = points[:, 0] / points[:, 2] * intrinsics.fx + intrinsics.cx
    v = points[:, 1] / points[:, 2] * intrinsics.fy + intrinsics.cy
    colours = [_COLOURS[c % len(_COLOURS)] for c in clusters(objects).tolist()]
    for a, b in objects.edges.tolist():
        pen.line((u[a], v[a], u[b], v[b]), fill=colours[a], width=2)
    for x, y, colour in zip(u.tolist(), v.tolist(), colours, strict=True):
        pen.ellipse((x - 3, y - 3, x + 3, y + 3), outline=colour)
    return picture
