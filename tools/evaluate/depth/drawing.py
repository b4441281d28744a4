"""`evaluate drawing`: how much of the ideal drawing of the simulated rooms is drawn, and what is drawn beside it.

The ideal drawing (`ideal`) is what a person who knows the boxes would draw: it says how many nodes and connections a
view can have without dividing straight lines.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
from collections.abc import Iterable
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from robot_app.perception.config import PerceptionConfig
from robot_app.perception.object_extractor import ObjectExtractor
from shared.command_line import whole_number_in
from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork
from tools.evaluate.depth.ideal import Drawing, View, ideal_drawing
from tools.evaluate.depth.lab_frames import VIEWS, lab_camera, lab_frames
from tools.evaluate.depth.labels import sample_connections
from tools.simulator.scenario import find_scenario
from tools.simulator.solids import solids_of

_DRAWN_M = 0.03
_TRUE_M = 0.04


@dataclass(frozen=True, slots=True)
class Figures:
    """A view: nodes and connections of the ideal drawing and of the network (the median over the frames).

    `ideal_drawn`: the share of the ideal drawing's length within 3 cm of a connection; `drawn_true`: the share of the
    connections' length within 4 cm of a line of the ideal drawing. None where there is nothing.
    """

    view: str
    ideal_nodes: int
    ideal_connections: int
    nodes: int
    connections: int
    ideal_drawn: float | None
    drawn_true: float | None


@dataclass(frozen=True, slots=True)
class Counts:
    """Points every centimetre along the lines: how many of how many."""

    ideal: int
    ideal_drawn: int
    drawn: int
    drawn_true: int

    @staticmethod
    def of(ideal: Drawing, room_nodes_m: NDArray[np.float64], connections: NDArray[np.int64]) -> Counts:
        true_m, drawn_m = ideal.points_m, sample_connections(room_nodes_m, connections)
        return Counts(
            len(true_m), _count_near(true_m, drawn_m, _DRAWN_M), len(drawn_m), _count_near(drawn_m, true_m, _TRUE_M)
        )

    @staticmethod
    def total(counts: list[Counts]) -> Counts:
        return Counts(
            sum(row.ideal for row in counts),
            sum(row.ideal_drawn for row in counts),
            sum(row.drawn for row in counts),
            sum(row.drawn_true for row in counts),
        )

    def shares(self) -> tuple[float | None, float | None]:
        return _share(self.ideal_drawn, self.ideal), _share(self.drawn_true, self.drawn)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Compare the networks of a simulated room's views with all edges that are in sight."
    parser.add_argument("--scenario", choices=sorted(VIEWS), default="lab", help="the room (default lab)")
    parser.add_argument(
        "--frames", type=whole_number_in(1, 100), default=3, help="of each view, which differ by noise only (3)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    rows = measure_drawing(args.scenario, args.frames)
    if args.json:
        print(json.dumps({"views": [asdict(row) for row in rows[:-1]], "overall": asdict(rows[-1])}))
        return 0
    print(f"{'view':24s}{'ideal nodes':>12s}{'conn.':>7s}{'nodes':>7s}{'conn.':>7s}{'ideal drawn':>13s}{'true':>7s}")
    for row in rows:
        shares = ["-" if share is None else f"{100 * share:.0f} %" for share in (row.ideal_drawn, row.drawn_true)]
        counts = f"{row.ideal_nodes:12d}{row.ideal_connections:7d}{row.nodes:7d}{row.connections:7d}"
        print(f"{row.view:24s}{counts}{shares[0]:>13s}{shares[1]:>7s}")
    return 0


def measure_drawing(scenario_name: str, frames: int) -> list[Figures]:
    """A row for each view, and one overall: medians of the counts, shares over all lengths."""
    scenario = find_scenario(scenario_name)
    intrinsics, mount = lab_camera(scenario_name)
    extractor = ObjectExtractor(PerceptionConfig(), intrinsics, mount)
    solids = solids_of(scenario)
    rows, all_counts = [], []
    images = zip(*(lab_frames(seed, scenario_name) for seed in range(1, frames + 1)), strict=True)
    for k, ((x_m, y_m, heading_deg), view_images) in enumerate(zip(VIEWS[scenario_name], images, strict=True)):
        pose = Pose2(x_m, y_m, math.radians(heading_deg))
        ideal = ideal_drawing(View.of(pose, mount, intrinsics), solids)
        networks = [extractor.extract(image) for image in view_images]
        counts = Counts.total([_compare(ideal, network, pose) for network in networks])
        all_counts.append(counts)
        rows.append(_row(f"{scenario_name} view {k}", ideal, networks, counts))
    return [*rows, _overall(rows, Counts.total(all_counts))]


def _compare(ideal: Drawing, network: ObjectNetwork, room_from_robot: Pose2) -> Counts:
    nodes_m = room_from_robot.apply_3d(network.nodes_m.astype(np.float64))
    return Counts.of(ideal, nodes_m, network.edges.astype(np.int64))


def _row(name: str, ideal: Drawing, networks: list[ObjectNetwork], counts: Counts) -> Figures:
    nodes = _median(len(network.nodes_m) for network in networks)
    connections = _median(len(network.edges) for network in networks)
    return Figures(name, ideal.nodes, ideal.connections, nodes, connections, *counts.shares())


def _overall(rows: list[Figures], counts: Counts) -> Figures:
    return Figures(
        "overall",
        _median(row.ideal_nodes for row in rows),
        _median(row.ideal_connections for row in rows),
        _median(row.nodes for row in rows),
        _median(row.connections for row in rows),
        *counts.shares(),
    )


def _median(values: Iterable[int]) -> int:
    return round(statistics.median(values))


def _share(part: int, whole: int) -> float | None:
    return round(part / whole, 4) if whole else None


def _count_near(points_m: NDArray[np.float64], others_m: NDArray[np.float64], reach_m: float) -> int:
    if not len(points_m) or not len(others_m):
        return 0
    distance_m = cKDTree(others_m).query(points_m, distance_upper_bound=reach_m)[0]
    return int(np.count_nonzero(distance_m <= reach_m))
