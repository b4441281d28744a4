"""One mission in a room that was re-arranged: the robot observes until it says itself that it has finished."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.config import AnyRobotConfig
from shared.messages import MissionState
from station_gui.config import StationConfig
from station_gui.model.view import OperatorView
from tools.director import Director
from tools.evaluate.missions.floor import Floor
from tools.evaluate.missions.rearranged import rearranged
from tools.simulator.links import LinkName
from tools.simulator.lockstep import MAPPING_AND_DEPTH, Lockstep, Orders
from tools.simulator.scenario import Scenario

_LONGEST_S = 600.0
_SLICE_S = 1.0
_STANDS_MPS = 0.02
_STUCK_S = 3.0  # a pause to turn the wheels is shorter
_POSE_HZ = 50.0
_SMOOTHED_S = 0.2  # over which the greatest speed is taken

Poses = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrialFigures:
    """Speeds, times and the way are those of the observation, from its start to its end."""

    trial: int
    contacts: int
    floor_seen: float
    ended: bool
    failure: str
    seconds: float
    distance_m: float
    mean_mps: float
    max_mps: float
    stuck_s: float  # stood for 3 s or longer at a time

    @property
    def good(self) -> bool:
        """Whether it fulfils what is asked of each mission."""
        return self.contacts == 0 and self.ended and self.floor_seen >= 0.95 and self.max_mps <= 0.46


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    figures: TrialFigures
    room: Scenario
    floor: Floor
    poses: Poses  # (N, 4) as of `Track.poses`, of the observation


class _Watch:
    """Notes when the observation began and ended."""

    def __init__(self) -> None:
        self.began_s = self.ended_s = math.nan

    def look(self, view: OperatorView) -> None:
        state = view.telemetry.state if view.telemetry is not None else None
        if state is MissionState.OBSERVE and math.isnan(self.began_s):
            self.began_s = view.time_s
        if state is MissionState.COMMAND and math.isnan(self.ended_s):
            self.ended_s = view.time_s


def run_trial(
    number: int,
    like: Scenario,
    robot: AnyRobotConfig,
    station: StationConfig,
    link: LinkName,
    *,
    at_random: bool,
    mapped: bool,
    progress: Callable[[float], None],
) -> Trial:
    """`number` is the seed of the room, of the start and of all noise; `mapped`: the station draws its map as well."""
    room = rearranged(like, robot.body, np.random.default_rng([number, 77])) if at_random else like
    without = frozenset() if mapped else MAPPING_AND_DEPTH
    system = Lockstep(room, number, robot, station, link=link, without=without)
    director = Director(Orders(system.station), (), lambda _: None)
    watch = _Watch()

    def operate() -> None:
        view = system.station.view()
        watch.look(view)
        director.step(view)

    system.use_operator(operate)
    try:
        while director.outcome is None and system.clock.now_s() < _LONGEST_S and not system.failures:
            system.run(_SLICE_S)
            progress(system.clock.now_s())
    finally:
        system.close()
    failure = system.failures[0] if system.failures else director.outcome.failure if director.outcome else "too long"
    ended_s = watch.ended_s if math.isfinite(watch.ended_s) else system.clock.now_s()
    poses = system.world.truth.poses()
    poses = poses[(poses[:, 0] >= watch.began_s) & (poses[:, 0] <= ended_s)]
    floor = Floor(room, robot.body)
    figures = _figures(number, poses, floor, system.world.collisions.count, math.isfinite(watch.ended_s), failure)
    return Trial(figures, room, floor, poses)


def _figures(number: int, poses: Poses, floor: Floor, contacts: int, ended: bool, failure: str) -> TrialFigures:
    if len(poses) < 2:
        return TrialFigures(number, contacts, 0.0, ended, failure or "it never began", 0.0, 0.0, 0.0, 0.0, 0.0)
    steps_m = np.hypot(*np.diff(poses[:, 1:3], axis=0).T)
    seconds = float(poses[-1, 0] - poses[0, 0])
    window = round(_SMOOTHED_S * _POSE_HZ)
    speeds = np.convolve(steps_m, np.ones(window) / window, "valid") * _POSE_HZ
    return TrialFigures(
        trial=number,
        contacts=contacts,
        floor_seen=round(floor.share_seen(poses), 4),
        ended=ended,
        failure=failure,
        seconds=round(seconds, 1),
        distance_m=round(float(steps_m.sum()), 2),
        mean_mps=round(float(steps_m.sum()) / seconds, 4),
        max_mps=round(float(speeds.max()), 4) if len(speeds) else 0.0,
        stuck_s=round(_stuck_s(speeds), 1),
    )


def _stuck_s(speeds_mps: NDArray[np.float64]) -> float:
    stands = np.concatenate(([False], speeds_mps < _STANDS_MPS, [False])).astype(np.int8)
    begins, ends = np.flatnonzero(np.diff(stands) == 1), np.flatnonzero(np.diff(stands) == -1)
    spans = (ends - begins) / _POSE_HZ
    return float(spans[spans >= _STUCK_S].sum())
