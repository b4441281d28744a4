"""What really was: poses, collisions, surfaces. For evaluation only; nothing of the product reads it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.config import parse
from shared.geometry.se2 import Pose2
from station_gui.export.tum import write_tum
from tools.simulator.scenario import Scenario
from tools.simulator.solids import Solid, solids_of
from tools.simulator.world import World

_TOUCHING_M = 0.001  # faces closer together than this are no surface
TRUTH_FILE, SIMULATION_FILE = "truth.tum", "simulation.json"


@dataclass(frozen=True, slots=True, eq=False)
class TrueSurfaces:
    """What a perfect scanner at `height_m` would map.

    `segments_m`: (S, 2, 2), room frame; free space is on the left of the way from the first to the second point.
    """

    segments_m: NDArray[np.float64]
    start: Pose2  # room_from_robot at the start, where a map's frame begins
    height_m: float


def true_surfaces(scenario: Scenario, height_m: float | None = None) -> TrueSurfaces:
    """The outlines of everything at that height, by default the scanner's, without what lies inside other things."""
    height = scenario.body.scanner_z_m if height_m is None else height_m
    solids = [solid for solid in solids_of(scenario) if solid.reaches(height)]
    pieces: list[NDArray[np.float64]] = []
    for solid in solids:
        corners = solid.corners_m()
        others = [other for other in solids if other is not solid]
        for i in range(4):
            # Clockwise round a solid its inside is on the right, so free space is on the left.
            edge = np.array([corners[(i + 1) % 4], corners[i]])
            pieces += [p for p in _outside(edge, others) if _in_room(p, scenario)]
    return TrueSurfaces(np.array(pieces).reshape(-1, 2, 2), scenario.start.room_from_robot, height)


def _outside(edge_m: NDArray[np.float64], solids: list[Solid]) -> list[NDArray[np.float64]]:
    """The parts of a segment that lie in none of the solids."""
    hidden = sorted(span for solid in solids if (span := _span_inside(edge_m, solid)) is not None)
    pieces, at = [], 0.0
    length_m = float(np.hypot(*(edge_m[1] - edge_m[0])))
    for low, high in [*hidden, (1.0, 1.0)]:
        if (low - at) * length_m > _TOUCHING_M:
            pieces.append(np.array([edge_m[0] + t * (edge_m[1] - edge_m[0]) for t in (at, low)]))
        at = max(at, high)
    return pieces


def _span_inside(edge_m: NDArray[np.float64], solid: Solid) -> tuple[float, float] | None:
    """Where, from 0 to 1 along a segment, it lies in the solid (Liang and Barsky)."""
    local = Pose2(solid.center_m[0], solid.center_m[1], solid.yaw_rad).inverse().apply(edge_m)
    low, high = 0.0, 1.0
    for axis in range(2):
        limit = solid.half_m[axis] + _TOUCHING_M
        start, step = local[0, axis], local[1, axis] - local[0, axis]
        if abs(step) < 1e-12:
            if abs(start) > limit:
                return None
            continue
        near, far = sorted(((-limit - start) / step, (limit - start) / step))
        low, high = max(low, near), min(high, far)
    return (low, high) if high > low else None


def _in_room(piece_m: NDArray[np.float64], scenario: Scenario) -> bool:
    x, y = piece_m.mean(axis=0).tolist()
    slack = _TOUCHING_M
    return bool(-slack <= x <= scenario.room.length_x_m + slack and -slack <= y <= scenario.room.width_y_m + slack)


def write_truth(world: World, folder: Path) -> None:
    """`truth.tum` (time x y z qx qy qz qw) and `simulation.json`."""
    folder.mkdir(parents=True, exist_ok=True)
    with world.moved:
        poses, report = world.truth.poses(), _report(world)
    write_tum(folder / TRUTH_FILE, poses)
    (folder / SIMULATION_FILE).write_text(json.dumps(report, indent=1) + "\n", "utf-8")


def _report(world: World) -> dict[str, Any]:
    scenario = world.scenario
    return {
        "scenario": scenario.name,
        "seed": world.seed,
        "simulated_s": world.elapsed_s,
        "slipped_s": world.slipped_s,
        "distance_m": world.truth.distance_m,
        "collisions": world.collisions.count,
        "collision_list": [asdict(collision) for collision in world.collisions.recorded],
        "boxes": [asdict(solid) for solid in solids_of(scenario)],
        "layout": asdict(scenario),
    }


@dataclass(frozen=True, slots=True, eq=False)
class RecordedTruth:
    """What `write_truth` left: `poses` (N, 4) as of `Track.poses`."""

    scenario: Scenario
    poses: NDArray[np.float64]
    surfaces: TrueSurfaces
    collisions: int
    distance_m: float
    slipped_s: float


def read_truth(folder: Path) -> RecordedTruth:
    report = json.loads((folder / SIMULATION_FILE).read_text("utf-8"))
    scenario = parse(report["layout"], Scenario)
    rows = np.loadtxt(folder / TRUTH_FILE, ndmin=2)
    theta = 2 * np.arctan2(rows[:, 6], rows[:, 7])
    poses = np.column_stack((rows[:, :3], (theta + np.pi) % (2 * np.pi) - np.pi))
    surfaces = true_surfaces(scenario)
    return RecordedTruth(scenario, poses, surfaces, report["collisions"], report["distance_m"], report["slipped_s"])
