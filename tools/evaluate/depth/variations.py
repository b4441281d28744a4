"""`evaluate variations`: labelled clouds changed in ways that must not matter, to see what is a fit to a few clouds."""

from __future__ import annotations

import argparse
import functools
import json
import operator
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import DepthImage
from robot_app.perception.config import PerceptionConfig
from robot_app.perception.object_extractor import ObjectExtractor
from shared.geometry.camera import Intrinsics
from tools.evaluate.depth.extraction import compare_labels, intrinsics_of, mount_of
from tools.evaluate.depth.files import DepthFileError, read_depth
from tools.evaluate.depth.labels import LabelFigures

_Labels = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class View:
    """A labelled depth image: `depth` (H, W) uint16 in `unit_m`, `labels` (H, W)."""

    depth: NDArray[np.uint16]
    unit_m: float
    lens: Intrinsics
    labels: _Labels


_Change = Callable[[View, np.random.Generator], View]


@dataclass(frozen=True, slots=True)
class Figures:
    """The shares of `labels` over all clouds."""

    variation: str
    object_recall: float | None
    boundary_precision: float | None
    boundary_recall: float | None


def mirrored(view: View, _: np.random.Generator) -> View:
    lens = replace(view.lens, cx=view.lens.width - view.lens.cx)
    return replace(view, depth=view.depth[:, ::-1], labels=view.labels[:, ::-1], lens=lens)


def _shifted(columns: int, rows: int) -> _Change:
    """The same scene in other pixels of the grid of cells; what leaves the image comes in on the other side."""

    def change(view: View, _: np.random.Generator) -> View:
        lens = replace(view.lens, cx=view.lens.cx + columns, cy=view.lens.cy + rows)
        depth, labels = np.roll(view.depth, (rows, columns), (0, 1)), np.roll(view.labels, (rows, columns), (0, 1))
        return replace(view, depth=depth, labels=labels, lens=lens)

    return change


def cropped(view: View, _: np.random.Generator, border: int = 40) -> View:
    lens = view.lens
    inner = slice(border, lens.height - border), slice(border, lens.width - border)
    smaller = replace(
        lens, width=lens.width - 2 * border, height=lens.height - 2 * border, cx=lens.cx - border, cy=lens.cy - border
    )
    return replace(view, depth=view.depth[inner], labels=view.labels[inner], lens=smaller)


def _noisy(noise: float) -> _Change:
    """`noise`: standard deviation at 1 m, in metres; grows with the square of the depth."""

    def change(view: View, rng: np.random.Generator) -> View:
        depth_m = view.depth * view.unit_m
        depth_m += rng.normal(0.0, noise, depth_m.shape) * depth_m * depth_m
        steps = np.clip(np.round(depth_m / view.unit_m), 0, np.iinfo(np.uint16).max)
        return replace(view, depth=steps.astype(np.uint16))

    return change


def _with_lens(share: float) -> _Change:
    """Seen as through another lens: things are narrower or wider than they are."""
    return lambda view, _: replace(view, lens=replace(view.lens, fx=view.lens.fx * share, fy=view.lens.fy * share))


def _resized(share: float) -> _Change:
    """The nearest pixel, for depths and labels have no mean."""

    def change(view: View, _: np.random.Generator) -> View:
        lens = view.lens
        height, width = int(lens.height * share), int(lens.width * share)
        rows = np.minimum(((np.arange(height) + 0.5) / share).astype(int), lens.height - 1)
        columns = np.minimum(((np.arange(width) + 0.5) / share).astype(int), lens.width - 1)
        resized = Intrinsics(width, height, *(share * px for px in (lens.fx, lens.fy, lens.cx, lens.cy)))
        pixels = np.ix_(rows, columns)
        return replace(view, depth=view.depth[pixels], labels=view.labels[pixels], lens=resized)

    return change


def _with_holes(share: float) -> _Change:
    def change(view: View, rng: np.random.Generator) -> View:
        return replace(view, depth=np.where(rng.random(view.depth.shape) < share, 0, view.depth).astype(np.uint16))

    return change


VARIATIONS: dict[str, _Change] = {
    "as it is": lambda view, _: view,
    "mirrored": mirrored,
    "1 pixel to the right": _shifted(1, 0),
    "2 pixels to the right, 1 down": _shifted(2, 1),
    "40 pixels cut off all round": cropped,
    "noise of 1 mm at 1 m": _noisy(0.001),
    "noise of 2 mm at 1 m": _noisy(0.002),
    "noise of 4 mm at 1 m": _noisy(0.004),
    "lens 10 % shorter": _with_lens(0.9),
    "lens 10 % longer": _with_lens(1.1),
    "three quarters of the pixels": _resized(0.75),
    "five quarters of the pixels": _resized(1.25),
    "2 % of the pixels missing": _with_holes(0.02),
    "10 % of the pixels missing": _with_holes(0.1),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Compare with labels what is extracted from clouds that are changed in various ways."
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="labelled clouds (PCD)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Exit code 2 when a file cannot be read or has no labels."""
    try:
        views = read_views(args.files)
    except DepthFileError as error:
        print(error, file=sys.stderr)
        return 2
    rows = [measure(name, views) for name in VARIATIONS]
    if args.json:
        print(json.dumps({"variations": [asdict(row) for row in rows]}))
        return 0
    for row in rows:
        shares = (row.object_recall, row.boundary_precision, row.boundary_recall)
        print(f"{row.variation:32s}" + "".join(f"{'-' if share is None else share:>9}" for share in shares))
    return 0


def read_views(paths: list[Path]) -> list[View]:
    """Raises DepthFileError."""
    return [_read(path) for path in paths]


def _read(path: Path) -> View:
    file = read_depth(path)
    if file.labels is None:
        raise DepthFileError(f"{path}: has no labels")
    return View(file.image.depth, file.image.unit_m, intrinsics_of(path, file.image, file.lens_px), file.labels)


def measure(name: str, views: list[View], seed: int = 1) -> Figures:
    """Over all `views`, each changed by the variation of this name."""
    rng = np.random.default_rng(seed)
    total = functools.reduce(operator.add, (_compare(VARIATIONS[name](view, rng)) for view in views))
    return Figures(name, total.object_recall, total.boundary_precision, total.boundary_recall)


def _compare(view: View) -> LabelFigures:
    image = DepthImage(0.0, np.ascontiguousarray(view.depth), view.unit_m)
    mount = mount_of("search", image, view.lens)
    objects = ObjectExtractor(PerceptionConfig(), view.lens, mount).extract(image)
    return compare_labels(image, np.ascontiguousarray(view.labels), objects, view.lens, mount)
