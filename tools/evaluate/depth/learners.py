"""`evaluate learners`: the three learners side by side at the same number of nodes (paper 1, table 2)."""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import DepthImage
from robot_app.perception.config import LearningConfig, PerceptionConfig
from robot_app.perception.fast_gng import FastGng, FastGngConfig
from robot_app.perception.growing_neural_gas import GngConfig, GrowingNeuralGas
from robot_app.perception.learner import Learner, Network
from robot_app.perception.point_cloud import EdgeCloud, Mount
from robot_app.perception.simplified_fast_gng import SimplifiedFastGng
from shared.command_line import whole_number_in
from shared.geometry.camera import Intrinsics
from tools.evaluate.depth.extraction import intrinsics_of, mount_of, parse_lens
from tools.evaluate.depth.files import DepthFileError, read_depth
from tools.evaluate.depth.lab_frames import lab_camera, lab_frames

_BATCHES = (1, 2, 4, 8)  # samples of FastGNG's mini-batch
_ROOM = 200  # nodes, as in the robot
_TRIALS = 9
_SAMPLES_PER_NODE = 5  # the loops of equation 16 make 0.39 nodes a sample at the most, and FastGNG deletes some
_LEAST_GAP_M = 0.002  # between samples
_STANDARD, _FAST, _SIMPLIFIED, _SHIPPED = "standard GNG", "FastGNG", "simplified FastGNG", "simplified, with evidence"


@dataclass(frozen=True, slots=True)
class Figures:
    """A row of table 2. `steps`: iterations of standard GNG, samples that FastGNG learned, phases of the simplified.

    `length_scale`: what the lengths of table 3 were multiplied by to come to the number of nodes. `times_as_fast`: as
    standard GNG. `node_error_mm`, `line_error_mm`: mean distance of the samples to the nearest node and connection.
    """

    learner: str
    nodes: int
    connections: int
    steps: int
    length_scale: float | None
    learn_ms: float
    times_as_fast: float
    node_error_mm: float
    line_error_mm: float


@dataclass(frozen=True, slots=True)
class FileFigures:
    file: str
    samples: int
    learners: list[Figures]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Compare standard GNG, FastGNG and simplified FastGNG on the same samples (table 2 of paper 1)."
    )
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE", help="PNG (16 bit, mm), .npy(.gz) (m), PCD")
    parser.add_argument("--lab", action="store_true", help="take frames of the simulated lab too")
    parser.add_argument("--intrinsics", type=parse_lens, metavar="FX,FY,CX,CY", help="of the camera, in pixels")
    parser.add_argument("--nodes", type=whole_number_in(2, 180), default=150, help="of each network (150)")
    parser.add_argument("--runs", type=whole_number_in(1, 1000), default=20, help="whose median counts (20)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Exit code 1 when no frame has enough samples, 2 when none is given or a file cannot be read."""
    if not args.files and not args.lab:
        print("evaluate learners: give depth images, --lab or both", file=sys.stderr)
        return 2
    rows: list[FileFigures] = []
    skipped: list[str] = []
    try:
        for name, cloud in _clouds(args):
            if cloud.samples < _SAMPLES_PER_NODE * args.nodes:
                skipped.append(name)
                continue
            rows.append(FileFigures(name, cloud.samples, _compare(cloud, args.nodes, args.runs)))
    except DepthFileError as error:
        print(error, file=sys.stderr)
        return 2
    if skipped:
        print(f"with too few samples for {args.nodes} nodes: {', '.join(skipped)}", file=sys.stderr)
    if not rows:
        return 1
    rows.append(FileFigures("overall", round(statistics.median(row.samples for row in rows)), _overall(rows)))
    if args.json:
        named = {"files": [asdict(row) for row in rows[:-1]], "overall": asdict(rows[-1]), "skipped": skipped}
        print(json.dumps(named))
    else:
        _print_table(rows)
    return 0


def compare_all(files: list[Path], lab: bool, nodes: int = 150, runs: int = 20) -> tuple[int, list[Figures]]:
    """How many frames have enough samples, and the medians over them. Raises DepthFileError."""
    rows = [FileFigures(name, cloud.samples, _compare(cloud, nodes, runs)) for name, cloud in _rich(files, lab, nodes)]
    return len(rows), _overall(rows) if rows else []


@dataclass(frozen=True, slots=True)
class BatchFigures:
    """FastGNG with mini-batches of `batch` samples: medians over the frames; `times_as_slow`: as with one sample."""

    batch: int
    nodes: int
    times_as_slow: float
    node_error_mm: float
    line_error_mm: float


def compare_batches(files: list[Path], nodes: int = 150, runs: int = 20) -> list[BatchFigures]:
    """What the size of FastGNG's mini-batch, which the paper does not give, costs and brings. Raises DepthFileError."""
    clouds = [cloud for _, cloud in _rich(files, False, nodes)]
    figures = {batch: [_with_batch(cloud, nodes, runs, batch) for cloud in clouds] for batch in _BATCHES}
    alone_ms = [row.learn_ms for row in figures[1]]
    return [
        BatchFigures(
            batch,
            round(statistics.median(row.nodes for row in rows)),
            round(statistics.median(row.learn_ms / ms for row, ms in zip(rows, alone_ms, strict=True)), 2),
            round(statistics.median(row.node_error_mm for row in rows), 1),
            round(statistics.median(row.line_error_mm for row in rows), 1),
        )
        for batch, rows in figures.items()
    ]


def _with_batch(cloud: EdgeCloud, nodes: int, runs: int, batch: int) -> Figures:
    config = FastGngConfig(batch=batch)
    learner, scale = _with_nodes(_FAST, cloud, nodes, config)
    network = Network(_ROOM)
    times_ms = []
    for _ in range(runs):
        began_s = time.thread_time()
        learner.learn(cloud, network)
        times_ms.append(1e3 * (time.thread_time() - began_s))
    learn_ms = statistics.median(times_ms)
    return _figures(_FAST, learner, scale, cloud, learn_ms, learn_ms)


def _rich(files: list[Path], lab: bool, nodes: int) -> list[tuple[str, EdgeCloud]]:
    clouds = _clouds(argparse.Namespace(files=files, lab=lab, intrinsics=None, nodes=nodes))
    return [(name, cloud) for name, cloud in clouds if cloud.samples >= _SAMPLES_PER_NODE * nodes]


def _clouds(args: argparse.Namespace) -> list[tuple[str, EdgeCloud]]:
    clouds = []
    for path in args.files:
        file = read_depth(path)
        intrinsics = intrinsics_of(path, file.image, args.intrinsics or file.lens_px)
        clouds.append(
            (
                path.name,
                _cloud(path.name, file.image, intrinsics, mount_of("search", file.image, intrinsics), args.nodes),
            )
        )
    if args.lab:
        frames = enumerate(lab_frames())
        clouds += [(f"lab view {k}", _cloud(f"lab view {k}", image, *lab_camera(), args.nodes)) for k, image in frames]
    return clouds


def _cloud(name: str, image: DepthImage, intrinsics: Intrinsics, mount: Mount, nodes: int) -> EdgeCloud:
    """Edges and curves as the robot has them, sampled as densely as so many nodes need."""
    try:
        cloud = EdgeCloud(PerceptionConfig().edges, intrinsics, mount)
    except ValueError as error:
        raise DepthFileError(f"{name}: {error}") from error
    cloud.update(image)
    wanted = min(_SAMPLES_PER_NODE * nodes, len(cloud.sample_m))
    while cloud.samples < wanted and _sample_between(cloud, wanted - cloud.samples):
        pass
    return cloud


def _sample_between(cloud: EdgeCloud, most: int) -> bool:
    """Add samples in the middle of the widest gaps along the curves; False when there are none left."""
    count = cloud.samples
    sample_m, weight, curve = cloud.sample_m[:count], cloud.sample_weight[:count], cloud.sample_curve[:count]
    gap_m = np.linalg.norm(np.diff(sample_m, axis=0), axis=1) * (np.diff(curve) == 0)
    widest = np.sort(np.argsort(-gap_m, kind="stable")[:most])
    widest = widest[gap_m[widest] > _LEAST_GAP_M]
    middle_m, lighter = (sample_m[widest] + sample_m[widest + 1]) / 2, np.minimum(weight[widest], weight[widest + 1])
    denser_m, weights = np.insert(sample_m, widest + 1, middle_m, axis=0), np.insert(weight, widest + 1, lighter)
    curves = np.insert(curve, widest + 1, curve[widest])
    cloud.samples = len(curves)
    cloud.sample_m[: cloud.samples], cloud.sample_weight[: cloud.samples] = denser_m, weights
    cloud.sample_curve[: cloud.samples] = curves
    return len(widest) > 0


def _compare(cloud: EdgeCloud, nodes: int, runs: int) -> list[Figures]:
    """All learners on one cloud, in turns and by the thread's own time: what slows the machine slows all of them."""
    learners: dict[str, tuple[Learner, float | None]] = {
        _STANDARD: (GrowingNeuralGas(GngConfig(nodes=nodes), np.random.default_rng(1)), None),
        **{name: _with_nodes(name, cloud, nodes, FastGngConfig()) for name in (_FAST, _SIMPLIFIED, _SHIPPED)},
    }
    network = Network(_ROOM)
    times_ms: dict[str, list[float]] = {name: [] for name in learners}
    for turn in range(runs + 1):
        for name, (learner, _) in learners.items():
            began_s = time.thread_time()
            learner.learn(cloud, network)
            if turn > 0:
                times_ms[name].append(1e3 * (time.thread_time() - began_s))
    standard_ms = statistics.median(times_ms[_STANDARD])
    return [
        _figures(name, learner, scale, cloud, statistics.median(times_ms[name]), standard_ms)
        for name, (learner, scale) in learners.items()
    ]


def _make(name: str, scale: float, fast: FastGngConfig) -> Learner:
    config = PerceptionConfig()
    learning = _scaled(config.learning, scale)
    if name == _FAST:
        return FastGng(learning, fast, np.random.default_rng(1))
    return SimplifiedFastGng(learning, config.refine, config.edges.max_samples, evidence=name == _SHIPPED)


def _scaled(config: LearningConfig, scale: float) -> LearningConfig:
    low, mid, high = config.min_length_m
    far, further, furthest = config.max_length_m
    return replace(
        config,
        min_length_m=(scale * low, scale * mid, scale * high),
        max_length_m=(scale * far, scale * further, scale * furthest),
        max_nodes=_ROOM,
    )


def _with_nodes(name: str, cloud: EdgeCloud, nodes: int, fast: FastGngConfig) -> tuple[Learner, float]:
    """The learner whose lengths are such that it makes about `nodes`."""
    network = Network(_ROOM)
    low, high = 0.1, 6.0
    best_scale, best_off = 1.0, float("inf")
    for _ in range(14):
        scale = (low * high) ** 0.5
        learner = _make(name, scale, fast)
        counts = []
        for _ in range(_TRIALS):  # FastGNG draws its samples: each network is another one
            learner.learn(cloud, network)
            counts.append(network.nodes)
        off = statistics.median(counts) - nodes
        if abs(off) < best_off:
            best_scale, best_off = scale, abs(off)
        low, high = (scale, high) if off > 0 else (low, scale)
    return _make(name, best_scale, fast), best_scale


def _figures(
    name: str, learner: Learner, scale: float | None, cloud: EdgeCloud, learn_ms: float, standard_ms: float
) -> Figures:
    network = _typical(learner, cloud)
    nodes_m = network.node_m[: network.nodes].astype(np.float64)
    samples_m = cloud.sample_m[: cloud.samples].astype(np.float64)
    pairs = network.connections()
    steps = 3
    if isinstance(learner, GrowingNeuralGas):
        steps = learner.iterations
    elif isinstance(learner, FastGng):
        steps = learner.looked
    return Figures(
        name,
        network.nodes,
        len(pairs),
        steps,
        None if scale is None else round(scale, 3),
        round(learn_ms, 3),
        round(standard_ms / learn_ms, 2),
        round(1e3 * float(np.linalg.norm(samples_m[:, None] - nodes_m[None], axis=2).min(axis=1).mean()), 1),
        round(1e3 * _line_error_m(samples_m, nodes_m[pairs]), 1),
    )


def _typical(learner: Learner, cloud: EdgeCloud) -> Network:
    """Of _TRIALS networks the one with the median number of nodes."""
    networks = [Network(_ROOM) for _ in range(_TRIALS)]
    for network in networks:
        learner.learn(cloud, network)
    return sorted(networks, key=lambda network: network.nodes)[_TRIALS // 2]


def _line_error_m(points_m: NDArray[np.float64], segments_m: NDArray[np.float64]) -> float:
    """Mean distance of the points (N, 3) to the nearest of the segments (S, 2, 3)."""
    start, way = segments_m[:, 0], segments_m[:, 1] - segments_m[:, 0]
    share = np.einsum("nsk,sk->ns", points_m[:, None] - start, way) / np.maximum((way**2).sum(axis=1), 1e-12)
    foot = start + np.clip(share, 0.0, 1.0)[..., None] * way
    return float(np.linalg.norm(points_m[:, None] - foot, axis=2).min(axis=1).mean())


def _overall(rows: list[FileFigures]) -> list[Figures]:
    """Medians over the files."""
    table = []
    for k, first in enumerate(rows[0].learners):
        column = [row.learners[k] for row in rows]
        table.append(
            Figures(
                first.learner,
                round(statistics.median(f.nodes for f in column)),
                round(statistics.median(f.connections for f in column)),
                round(statistics.median(f.steps for f in column)),
                None,
                round(statistics.median(f.learn_ms for f in column), 3),
                round(statistics.median(f.times_as_fast for f in column), 2),
                round(statistics.median(f.node_error_mm for f in column), 1),
                round(statistics.median(f.line_error_mm for f in column), 1),
            )
        )
    return table


def _print_table(rows: list[FileFigures]) -> None:
    for row in rows:
        print(f"{row.file}, {row.samples} samples")
        names = list(asdict(row.learners[0]))
        print("  " + names[0].ljust(26) + "".join(name.rjust(14) for name in names[1:]))
        for figures in row.learners:
            cells = ["-" if value is None else str(value) for value in list(asdict(figures).values())[1:]]
            print("  " + figures.learner.ljust(26) + "".join(cell.rjust(14) for cell in cells))
