"""A mission that was simulated once and can be mapped many times: a folder with its recording and its truth."""

from __future__ import annotations

import itertools
import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robot_app.config import RobotConfig
from shared.command_line import Refused
from shared.config import ConfigError, parse
from shared.geometry.se2 import Pose2
from station_gui.config import StationConfig
from station_gui.mapping.snapshot import MapSnapshot, ObjectMap
from tools.evaluate._kernels import nearest_on_segments
from tools.evaluate.map_error import MapError, align, map_error, standing_places_m
from tools.evaluate.mapping.edges import seen_things
from tools.evaluate.mapping.score import ObjectError, object_error
from tools.evaluate.mapping.timing import Costs, TimedPipeline
from tools.evaluate.mapping.world import camera_places, true_world
from tools.replay import MissionSource
from tools.simulator.links import LinkName
from tools.simulator.lockstep import run_mission
from tools.simulator.scenario import Goal, Scenario
from tools.simulator.truth import RecordedTruth, read_truth, true_surfaces

FloatArray = NDArray[np.float64]

_SHORTEST_DRIVE_S = 3.0  # to a random goal, at least
_GOAL_CLEAR_M = 0.35
_WARM_UP = 100  # observations
_RECORDING, _TRUTH, _FIGURES = "mission.mcap", "truth", "trial.json"


@dataclass(frozen=True, slots=True)
class Driven:
    """What only the mission itself can tell."""

    scenario: str
    link: str
    seed: int
    finished: bool
    failure: str
    duration_s: float
    refresh_hz: float
    bytes_per_observation: float


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """`objects` and `occupied_m` (N, 2) in the room's frame, after one rigid alignment of the grid with the truth."""

    driven: Driven
    truth: RecordedTruth
    snapshot: MapSnapshot
    room_from_map: Pose2
    objects: ObjectMap
    occupied_m: FloatArray
    map_error: MapError
    object_error: ObjectError
    costs: Costs


def is_recorded(folder: Path) -> bool:
    return (folder / _FIGURES).is_file()


def simulate(
    scenario: Scenario,
    link: LinkName,
    seed: int,
    robot: RobotConfig,
    station: StationConfig,
    folder: Path,
    progress: Callable[[float], None],
    minutes: float | None = None,
) -> None:
    """Drive the mission in lock-step and keep it in `folder`; what an interrupted one left there is thrown away.

    With `minutes` it goes on to places that are drawn at random until so much time has passed.
    """
    ends_s = 60 * minutes if minutes is not None else None
    if ends_s is not None:
        goals = _random_goals(scenario, round(ends_s / _SHORTEST_DRIVE_S), np.random.default_rng(seed))
        scenario = replace(scenario, goals=goals)
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    result = run_mission(scenario, seed, robot, station, _quiet, progress, folder / _RECORDING, link, ends_s=ends_s)
    figures, outcome = result.figures, result.outcome
    driven = Driven(
        scenario.name,
        link,
        seed,
        outcome.failure == "",
        outcome.failure,
        outcome.ended_s - outcome.began_s,
        figures.refresh_hz,
        figures.bytes_per_observation,
    )
    (folder / _FIGURES).write_text(json.dumps(asdict(driven), indent=1) + "\n", "utf-8")


def warm_up(folder: Path, station: StationConfig) -> None:
    """Loads the kernels, so that the first trial is timed like the others."""
    pipeline = TimedPipeline(station)
    for observation in itertools.islice(MissionSource(folder / _RECORDING), _WARM_UP):
        pipeline.add(observation)


def map_again(folder: Path, station: StationConfig) -> Trial:
    """Map what was recorded with this configuration and compare with the truth. Raises `Refused`."""
    driven, truth = _read(folder)
    source = MissionSource(folder / _RECORDING)
    pipeline = TimedPipeline(station)
    for observation in source:
        pipeline.add(observation)
    if not pipeline.costs.slam:
        raise Refused(f"{folder / _RECORDING}: no observation in it")
    snapshot = pipeline.finish()
    cells_m = snapshot.grid.occupied_m()
    room_from_map = align(cells_m, truth.surfaces)
    placed_m = room_from_map.apply_3d(snapshot.objects.segments_m.reshape(-1, 3)).reshape(-1, 2, 3)
    objects = ObjectMap(placed_m.astype(np.float32), snapshot.objects.kind, snapshot.objects.cluster)
    world = true_world(truth.scenario)
    things = seen_things(world, camera_places(truth.scenario, truth.poses))
    return Trial(
        driven,
        truth,
        snapshot,
        room_from_map,
        objects,
        room_from_map.apply(cells_m),
        map_error(snapshot.grid, truth.surfaces),
        object_error(objects, world, things),
        pipeline.costs,
    )


def _read(folder: Path) -> tuple[Driven, RecordedTruth]:
    try:
        driven = parse(json.loads((folder / _FIGURES).read_text("utf-8")), Driven)
        return driven, read_truth(folder / _TRUTH)
    except (ConfigError, KeyError, ValueError, OSError) as error:
        raise Refused(f"{folder}: is no trial that can be read: {error}") from error


def _random_goals(scenario: Scenario, count: int, rng: np.random.Generator) -> tuple[Goal, ...]:
    """Anywhere that the robot can get to from its start and has some room round it."""
    surfaces = true_surfaces(scenario)
    places_m = standing_places_m(surfaces)
    foot_m, clear_m = np.empty_like(places_m), np.empty(len(places_m))
    nearest_on_segments(np.ascontiguousarray(places_m), surfaces.segments_m, foot_m, clear_m)
    drawn = rng.choice(places_m[clear_m >= _GOAL_CLEAR_M], count)
    return tuple(Goal((float(x), float(y))) for x, y in drawn)


def _quiet(_: str) -> None:
    """The director's words are for those who watch one mission."""
