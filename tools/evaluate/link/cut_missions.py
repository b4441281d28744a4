"""`evaluate cuts`: missions in lock-step during which Wi-Fi is cut again and again, against one without a cut."""

from __future__ import annotations

import argparse
import json
import math
from collections import defaultdict
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.config import load_config as load_robot
from shared.command_line import EXIT_FAILED, EXIT_OK, seed, whole_number_in
from station_gui.config import load_config as load_station
from station_gui.mapping.snapshot import GridMap
from tools.evaluate._kernels import nearest_on_segments
from tools.evaluate.link.on_missions import MissionLink, link_figures
from tools.evaluate.link.quiet import quiet
from tools.evaluate.map_error import align, map_error
from tools.simulator.links import LinkName
from tools.simulator.lockstep import MissionResult, run_mission
from tools.simulator.scenario import find_scenario
from tools.simulator.truth import TrueSurfaces
from tools.simulator.witness import Witness

_MOST_MISSIONS = 40
_PIECE_M = 0.2
_OF_THE_WALL_M = 0.1
_LEAST_CELLS = 5
_HEADER = (
    "mission",
    "cuts",
    "finished",
    "lost",
    "doubled",
    "gap ms",
    "order ms",
    "map rmse",
    "map apart",
    "collisions",
)


@dataclass(frozen=True, slots=True)
class CutMission:
    """`walls_apart_m`: root mean square of how far the walls of this map stand from those of the reference, piece by
    piece, after one rigid alignment of each; a piece is what lies within 20 cm, and stands where its cells do on
    average."""

    seed: int
    finished: bool
    failure: str
    collisions: int
    map_rmse_m: float
    walls_apart_m: float
    link: MissionLink


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenario", default="lab", help="a scenario's name or TOML file (default: lab)")
    parser.add_argument("--seed", type=seed, default=1, help="of the missions; the cuts differ (default: 1)")
    parser.add_argument("--cuts", type=whole_number_in(1, 1_000), default=100, help="at least (default: 100)")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    """Exit code 1 when a mission did not finish or something was lost or doubled."""
    with quiet(args.verbose):
        return _compare(args)


def _compare(args: argparse.Namespace) -> int:
    reference, _ = _drive(args.scenario, args.seed, "tcp", args.seed)
    if reference.snapshot is None:
        print("the mission without cuts has no map")
        return EXIT_FAILED
    print(
        f"without cuts: map rmse {1e3 * map_error(reference.snapshot.grid, reference.truth.surfaces).map_rmse_m:.1f} mm"
    )
    print("".join(f"{name:>11}" for name in _HEADER), flush=True)
    missions: list[CutMission] = []
    while sum(m.link.cuts for m in missions) < args.cuts and len(missions) < _MOST_MISSIONS:
        missions.append(_judge(args, len(missions) + 1, reference.snapshot.grid))
        print(_row(missions[-1]), flush=True)
    summary = _summary(missions)
    for key, value in summary.items():
        print(f"{key:24} {value}")
    if args.json:
        print(json.dumps({"summary": summary, "missions": [asdict(m) for m in missions]}))
    clean = all(m.finished and m.link.lost == m.link.duplicated == m.link.out_of_order == 0 for m in missions)
    return EXIT_OK if clean else EXIT_FAILED


def _drive(scenario: str, number: int, link: LinkName, link_seed: int) -> tuple[MissionResult, Witness]:
    witness = Witness()
    result = run_mission(
        find_scenario(scenario), number, load_robot(None), load_station(None),
        say=lambda _: None, progress=lambda _: None,
        link=link, witness=witness, link_seed=link_seed,
    )  # fmt: skip
    return result, witness


def _judge(args: argparse.Namespace, link_seed: int, reference: GridMap) -> CutMission:
    result, witness = _drive(args.scenario, args.seed, "switch", link_seed)
    grid = result.snapshot.grid if result.snapshot is not None else None
    return CutMission(
        seed=link_seed,
        finished=result.outcome.failure == "",
        failure=result.outcome.failure,
        collisions=int(result.truth.collisions),
        map_rmse_m=map_error(grid, result.truth.surfaces).map_rmse_m if grid is not None else math.nan,
        walls_apart_m=_walls_apart_m(grid, reference, result.truth.surfaces) if grid is not None else math.nan,
        link=link_figures(witness, result.cuts, result.outcome.ended_s),
    )


def _walls_apart_m(one: GridMap, other: GridMap, truth: TrueSurfaces) -> float:
    """A map's frame is where the first observation was, and the gyro's bias was not known yet: each is aligned."""
    here, there = _pieces(one, truth), _pieces(other, truth)
    apart_m = [math.dist(here[place], there[place]) for place in here.keys() & there.keys()]
    return math.sqrt(float(np.mean(np.square(apart_m)))) if apart_m else math.nan


def _pieces(grid: GridMap, truth: TrueSurfaces) -> dict[tuple[int, int], tuple[float, float]]:
    """By how much the cells round each place on the true surfaces are off, on average."""
    cells_m = grid.occupied_m()
    cells_m = np.ascontiguousarray(align(cells_m, truth).apply(cells_m))
    foot_m, distance_m = np.empty_like(cells_m), np.empty(len(cells_m))
    nearest_on_segments(cells_m, np.ascontiguousarray(truth.segments_m), foot_m, distance_m)
    offsets: defaultdict[tuple[int, int], list[NDArray[np.float64]]] = defaultdict(list)
    for place, off_m in zip(np.floor(foot_m / _PIECE_M).astype(int), cells_m - foot_m, strict=True):
        if math.hypot(*off_m) < _OF_THE_WALL_M:
            offsets[int(place[0]), int(place[1])].append(off_m)
    means = {place: np.mean(many, axis=0) for place, many in offsets.items() if len(many) >= _LEAST_CELLS}
    return {place: (float(mean[0]), float(mean[1])) for place, mean in means.items()}


def _row(mission: CutMission) -> str:
    link = mission.link
    values = (
        mission.seed, link.cuts, "yes" if mission.finished else "NO", link.lost, link.duplicated,
        f"{link.gap_ms_max:.0f}", f"{link.command_latency_ms_max:.0f}", f"{1e3 * mission.map_rmse_m:.1f} mm",
        f"{1e3 * mission.walls_apart_m:.1f} mm", mission.collisions,
    )  # fmt: skip
    return "".join(f"{value:>11}" for value in values)


def _summary(missions: list[CutMission]) -> dict[str, float | int]:
    links = [m.link for m in missions]
    return {
        "missions": len(missions),
        "finished": sum(m.finished for m in missions),
        "cuts": sum(link.cuts for link in links),
        "observations": sum(link.observations for link in links),
        "observations_over_lora": sum(link.over_lora for link in links),
        "lost": sum(link.lost for link in links),
        "duplicated": sum(link.duplicated for link in links),
        "out_of_order": sum(link.out_of_order for link in links),
        "gap_ms_max": round(max(link.gap_ms_max for link in links), 1),
        "command_latency_ms_max": round(max(link.command_latency_ms_max for link in links), 1),
        "map_rmse_m_worst": round(max(m.map_rmse_m for m in missions), 4),
        "walls_apart_m_worst": round(max(m.walls_apart_m for m in missions), 4),
        "collisions": sum(m.collisions for m in missions),
    }
