"""`evaluate kidnap`: is a robot that was put down anywhere in a saved map found, and found rightly?

The lab's mission makes the map, which is saved and opened again by the station's own commands. In every trial a robot
stands somewhere, and goes along the walls when it has not been found by then. The first place in the map that the
station claims is compared with the truth. In a room that is not in the map none may be claimed: the robot stays lost,
or begins a piece of map that is apart. The command fails where a place
is claimed wrongly, or where fewer than 95 of 100 robots are found.
"""

from __future__ import annotations

import argparse
import gc
import json
import logging
import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from robot_app.config import RobotConfig
from robot_app.config import load_config as load_robot
from shared.command_line import EXIT_FAILED, EXIT_OK, Refused, seed
from shared.geometry.se2 import Pose2, interpolate, wrap_angle
from station_gui.config import StationConfig
from station_gui.config import load_config as load_station
from station_gui.mapping.snapshot import MapSnapshot, Tracking
from tools.director import Director
from tools.evaluate.map_error import align
from tools.simulator.lockstep import Lockstep, Orders
from tools.simulator.rooms import free_pose, random_room
from tools.simulator.scenario import Scenario, find_scenario
from tools.simulator.truth import true_surfaces
from tools.simulator.world import World

_LONGEST_MISSION_S = 900.0
_SLICE_S = 0.2
_BEGIN_S = 0.4  # until the link stands and observations come
_STAND_S = 4.0  # then the robot begins to drive
_NOTICE_S = 2.0  # within this a robot that was carried off has to be missed
_FIND_AT_HOME_S = 15.0
_RIGHT_M, _RIGHT_DEG = 0.05, 2.0
_FOUND_SHARE = 0.95


@dataclass(frozen=True, slots=True)
class Setup:
    """`room_from_map` as of the aligned map."""

    scenario: Scenario
    robot: RobotConfig
    station: StationConfig
    map_path: Path
    room_from_map: Pose2
    localise: bool
    carried: bool
    time_s: float


@dataclass(frozen=True, slots=True)
class Trial:
    """`error_m` is not a number where nothing was claimed, or nothing can be right."""

    number: int
    outcome: str  # found, wrong, lost
    seconds: float
    error_m: float
    error_deg: float


@dataclass(frozen=True, slots=True)
class KidnapFigures:
    """What `evaluate kidnap` prints; errors are those of all claims in the map."""

    trials: int
    found: int
    wrong: int
    lost: int
    seconds_to_find_p50: float | None
    seconds_to_find_p95: float | None
    error_m_p50: float | None
    error_m_p95: float | None
    error_deg_p50: float | None
    error_deg_p95: float | None
    elsewhere: int
    elsewhere_lost: int
    elsewhere_wrong: int
    map_bytes: int


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenario", default="lab", help="a scenario's name or TOML file (default: lab)")
    parser.add_argument("--trials", type=trial_count, default=100, help="in the map (default: 100)")
    parser.add_argument("--elsewhere", type=trial_count, default=0, help="more trials in rooms that are not in the map")
    parser.add_argument("--seed", type=seed, default=1, help="of everything (default: 1)")
    parser.add_argument("--method", choices=("graph", "particle"), help="of SLAM, instead of what the station says")
    parser.add_argument("--localise", action="store_true", help="in a map that is not changed, instead of going on")
    parser.add_argument("--carried", action="store_true", help="carried off while its place is known, not put down")
    parser.add_argument("--time", type=_seconds, default=60.0, help="for each trial, simulated (default: 60 s)")
    parser.add_argument("--robot", metavar="FILE", type=Path, help="robot.toml instead of the one that comes along")
    parser.add_argument("--station", metavar="FILE", type=Path, help="station.toml instead of the one that comes along")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    logging.getLogger("station").setLevel(logging.ERROR)
    logging.getLogger("robot_app").setLevel(logging.ERROR)
    station = load_station(args.station)
    if args.method is not None:
        station = replace(station, method=args.method)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.labmap"
        scenario, robot = find_scenario(args.scenario), load_robot(args.robot)
        room_from_map = make_map(scenario, args.seed, robot, station, path)
        setup = Setup(scenario, robot, station, path, room_from_map, args.localise, args.carried, args.time)
        here = [_told(trial) for trial in trials(setup, args.seed, args.trials)]
        there = [_told(trial) for trial in trials_elsewhere(setup, args.seed, args.elsewhere)]
        figures = summarise(here, there, path.stat().st_size)
    if args.json:
        rows = {"runs": [as_json(t) for t in here], "elsewhere_runs": [as_json(t) for t in there]}
        print(json.dumps(asdict(figures) | rows))
    else:
        for key, value in asdict(figures).items():
            print(f"{key:24} {value}")
    return EXIT_OK if succeeded(figures) else EXIT_FAILED


def succeeded(figures: KidnapFigures) -> bool:
    return figures.wrong + figures.elsewhere_wrong == 0 and figures.found >= _FOUND_SHARE * figures.trials


def as_json(trial: Trial) -> dict[str, int | float | str | None]:
    """Rounded; what is no number becomes null."""
    return {key: _rounded(value) for key, value in asdict(trial).items()}


def _rounded(value: float | str) -> int | float | str | None:
    if not isinstance(value, float):
        return value
    return round(value, 4) if math.isfinite(value) else None


def make_map(scenario: Scenario, number: int, robot: RobotConfig, station: StationConfig, path: Path) -> Pose2:
    """The demo's mission, saved by the station; returns `room_from_map`."""
    system = Lockstep(scenario, number, robot, station)
    director = Director(Orders(system.station), scenario.goals_in_start_frame_m(), lambda _: None)
    system.use_operator(lambda: director.step(system.station.view()))
    try:
        while director.outcome is None and system.clock.now_s() < _LONGEST_MISSION_S and not system.failures:
            system.run(1.0)
        system.station.save_map(path)
        system.station.step_mapping()
        snapshot = system.station.view().snapshot
    finally:
        system.close()
    if snapshot is None or not path.is_file():
        raise Refused("the mission left no map")
    return align(snapshot.grid.occupied_m(), true_surfaces(scenario))


def trials(setup: Setup, number: int, count: int) -> Iterator[Trial]:
    for k in range(count):
        rng = np.random.default_rng([number, k])
        pose = free_pose(setup.scenario, rng)
        yield _trial(setup, setup.scenario, k, pose, in_map=True)


def trials_elsewhere(setup: Setup, number: int, count: int) -> Iterator[Trial]:
    for k in range(count):
        rng = np.random.default_rng([number, k, 1])
        scenario = random_room(setup.scenario, rng)
        yield _trial(replace(setup, carried=False), scenario, k, free_pose(scenario, rng), in_map=False)


def _trial(setup: Setup, scenario: Scenario, number: int, pose: Pose2, *, in_map: bool) -> Trial:
    system = Lockstep(scenario, 1000 + number, setup.robot, setup.station)
    try:
        system.station.open_map(setup.map_path, localise=setup.localise)
        system.station.connect("loopback", 0)
        if not setup.carried:
            system.carry_robot(pose)
            system.run(_BEGIN_S)
        elif not _settle_at_home(system):
            return Trial(number, "lost", math.nan, math.nan, math.nan)
        else:
            system.carry_robot(pose)
        return _look_for_it(system, setup, number, in_map=in_map)
    finally:
        system.close()
        gc.collect()  # a world and a station hold much, and one another


def _settle_at_home(system: Lockstep) -> bool:
    until_s = system.clock.now_s() + _FIND_AT_HOME_S
    while system.clock.now_s() < until_s:
        system.run(_SLICE_S)
        snapshot = system.station.view().snapshot
        if snapshot is not None and snapshot.tracking is Tracking.LOCATED:
            return True
    return False


def _look_for_it(system: Lockstep, setup: Setup, number: int, *, in_map: bool) -> Trial:
    """Stand, then go along the walls, until the station claims a place or the time is up."""
    began_s = system.clock.now_s()
    if setup.carried:
        system.run(_NOTICE_S)
    started = False
    while (waited_s := system.clock.now_s() - began_s) < setup.time_s and not system.failures:
        system.run(_SLICE_S)
        snapshot = system.station.view().snapshot
        if snapshot is not None and snapshot.tracking is Tracking.LOCATED:
            return _judged(system.world, setup, number, snapshot, waited_s + _SLICE_S, in_map=in_map)
        if waited_s > _STAND_S and not started:
            started = True
            system.station.start()
    return Trial(number, "lost", math.nan, math.nan, math.nan)


def _judged(world: World, setup: Setup, number: int, snapshot: MapSnapshot, waited_s: float, *, in_map: bool) -> Trial:
    if not in_map:
        return Trial(number, "wrong", waited_s, math.nan, math.nan)
    truth = _true_pose(world, snapshot.stamp_s)
    claimed = setup.room_from_map @ snapshot.map_from_robot
    error_m = claimed.distance_m(truth)
    error_deg = abs(math.degrees(wrap_angle(claimed.theta_rad - truth.theta_rad)))
    right = error_m <= _RIGHT_M and error_deg <= _RIGHT_DEG
    return Trial(number, "found" if right else "wrong", waited_s, error_m, error_deg)


def _true_pose(world: World, stamp_s: float) -> Pose2:
    rows = world.truth.poses()
    after = min(max(int(np.searchsorted(rows[:, 0], stamp_s)), 1), len(rows) - 1)
    before = rows[after - 1]
    share = (stamp_s - before[0]) / (rows[after, 0] - before[0])
    return interpolate(Pose2.from_array(before[1:]), Pose2.from_array(rows[after, 1:]), float(share))


def summarise(here: list[Trial], there: list[Trial], map_bytes: int) -> KidnapFigures:
    claims = [trial for trial in here if trial.outcome != "lost"]
    seconds = [trial.seconds for trial in here if trial.outcome == "found"]
    return KidnapFigures(
        trials=len(here),
        found=_number(here, "found"),
        wrong=_number(here, "wrong"),
        lost=_number(here, "lost"),
        seconds_to_find_p50=_percentile(seconds, 50),
        seconds_to_find_p95=_percentile(seconds, 95),
        error_m_p50=_percentile([trial.error_m for trial in claims], 50),
        error_m_p95=_percentile([trial.error_m for trial in claims], 95),
        error_deg_p50=_percentile([trial.error_deg for trial in claims], 50),
        error_deg_p95=_percentile([trial.error_deg for trial in claims], 95),
        elsewhere=len(there),
        elsewhere_lost=_number(there, "lost"),
        elsewhere_wrong=_number(there, "wrong"),
        map_bytes=map_bytes,
    )


def _number(all_trials: list[Trial], outcome: str) -> int:
    return sum(trial.outcome == outcome for trial in all_trials)


def _percentile(values: list[float], percent: float) -> float | None:
    return round(float(np.percentile(values, percent)), 4) if values else None


def _told(trial: Trial) -> Trial:
    claim = ""
    if math.isfinite(trial.seconds):
        claim = f" after {trial.seconds:.1f} s"
    if math.isfinite(trial.error_m):
        claim += f", {100 * trial.error_m:.1f} cm and {trial.error_deg:.2f} degrees off"
    print(f"trial {trial.number}: {trial.outcome}{claim}", file=sys.stderr, flush=True)
    return trial


def trial_count(text: str) -> int:
    try:
        value = int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from error
    if not 0 <= value <= 10_000:
        raise argparse.ArgumentTypeError(f"{text!r} is not from 0 to 10000")
    return value


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from error
    if not 1 <= value <= 3600:
        raise argparse.ArgumentTypeError(f"{text!r} is not from 1 to 3600")
    return value
