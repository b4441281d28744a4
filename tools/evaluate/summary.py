"""What a mission achieved, against the truth."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from station_gui.mapping.snapshot import MapSnapshot
from station_gui.model.figures import MissionFigures
from tools.director import Outcome
from tools.evaluate.map_error import map_error, pose_error
from tools.simulator.truth import RecordedTruth


@dataclass(frozen=True, slots=True)
class MissionSummary:
    """The keys of `summary.json`."""

    map_rmse_m: float
    map_completeness: float
    pose_rmse_m: float
    refresh_hz: float
    bytes_per_observation: float
    collisions: float
    goal_error_m: float  # between the true place of the robot at the end and the last goal
    duration_s: float
    distance_m: float
    observations: int
    observations_dropped: int
    loop_closures: int
    finished: bool
    failure: str

    def as_json(self) -> dict[str, float | int | str | bool | None]:
        """Rounded; what is no number becomes null."""
        return {key: _rounded(value) for key, value in asdict(self).items()}


def summarise(
    truth: RecordedTruth | None,
    snapshot: MapSnapshot | None,
    figures: MissionFigures,
    outcome: Outcome,
    goal_m: tuple[float, float] | None,
) -> MissionSummary:
    """`goal_m`: the last goal, room frame. Without a truth, what needs one is not a number."""
    error = map_error(snapshot.grid, truth.surfaces) if snapshot is not None and truth is not None else None
    pose_rmse_m = pose_error(snapshot.trajectory, truth.poses) if snapshot is not None and truth is not None else None
    return MissionSummary(
        map_rmse_m=error.map_rmse_m if error is not None else math.nan,
        map_completeness=error.map_completeness if error is not None else math.nan,
        pose_rmse_m=pose_rmse_m if pose_rmse_m is not None else math.nan,
        refresh_hz=figures.refresh_hz,
        bytes_per_observation=figures.bytes_per_observation,
        collisions=truth.collisions if truth is not None else math.nan,
        goal_error_m=math.dist(truth.poses[-1, 1:3], goal_m) if truth is not None and goal_m is not None else math.nan,
        duration_s=outcome.ended_s - outcome.began_s,
        distance_m=truth.distance_m if truth is not None else math.nan,
        observations=figures.observations,
        observations_dropped=figures.observations_dropped,
        loop_closures=len(snapshot.closures) if snapshot is not None else 0,
        finished=outcome.failure == "",
        failure=outcome.failure,
    )


def _rounded(value: float | str | bool) -> float | int | str | bool | None:
    if not isinstance(value, float):
        return value
    return None if math.isnan(value) else round(value, 4)
