"""A mission that goes to one goal after the other, in lock-step."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from robot_app.config import RobotConfig
from shared.messages import MissionState
from station_gui.config import StationConfig
from station_gui.mapping.snapshot import MapSnapshot
from station_gui.model.goal_figures import GoalFigures, GoalState
from station_gui.planning.path_planner import PathPlanner, PlanningError
from tools.director import Director
from tools.simulator.lockstep import Lockstep, Orders
from tools.simulator.scenario import Scenario

_OBSERVE_S = 1500.0
_GOAL_S = 240.0
_SLICE_S = 0.2


@dataclass(frozen=True, slots=True)
class Visit:
    """What became of one goal. `error_m`: of where the car truly stands in the end; `contacts`: on the way.

    `planning_s`: of the processor, for the first plan made once more with the time-out on that time, as on a machine
    that has nothing else to do; the better of two, NaN without a plan.
    """

    figures: GoalFigures
    error_m: float
    contacts: int
    seconds: float
    planning_s: float

    @property
    def planned(self) -> bool:
        return self.figures.plans > 0


class Tour:
    """Observes the room once; then `visit` as often as there are goals."""

    def __init__(self, scenario: Scenario, number: int, robot: RobotConfig, station: StationConfig) -> None:
        self.system = Lockstep(scenario, number, robot, station)
        self.car = station.car
        self._planner = PathPlanner(station.car, station.planning, time.thread_time)
        self._scenario = scenario

    def close(self) -> None:
        self.system.close()

    def observe(self, progress: Callable[[float], None]) -> None:
        """Raises `RuntimeError` where the mission ends before the room was seen."""
        system = self.system
        director = Director(Orders(system.station), (), lambda _: None)
        system.use_operator(lambda: None if self._in_command() else director.step(system.station.view()))
        while not self._in_command():
            system.run(_SLICE_S)
            progress(system.clock.now_s())
            if system.failures or director.outcome is not None or system.clock.now_s() > _OBSERVE_S:
                what = system.failures or [director.outcome.failure if director.outcome is not None else "too long"]
                raise RuntimeError(f"the observation did not end: {what[0]}")
        system.use_operator(system.station.view)

    def visit(self, room_m: tuple[float, float]) -> Visit:
        """Go to a place, room frame."""
        system = self.system
        began_s, contacts = system.clock.now_s(), system.world.collisions.count
        view = system.station.view()
        before = view.going.number if view.going is not None else 0
        goal = _in_start_frame(self._scenario, room_m)
        planning_s = self._planning_s(view.snapshot, goal)
        system.station.go_to(*goal)
        while (taken_s := system.clock.now_s() - began_s) < _GOAL_S:
            system.run(_SLICE_S)
            going = system.station.view().going
            if going is not None and going.number > before and going.state is not GoalState.GOING:
                break
        else:
            going = system.station.view().going
        if going is None:
            raise RuntimeError(f"the goal {room_m} was not taken")
        pose = system.world.room_from_robot()
        error_m = math.hypot(pose.x_m - room_m[0], pose.y_m - room_m[1])
        return Visit(going, error_m, system.world.collisions.count - contacts, taken_s, planning_s)

    def _planning_s(self, snapshot: MapSnapshot | None, goal_m: tuple[float, float]) -> float:
        if snapshot is None:
            return math.nan
        taken_s = math.nan
        for _ in range(2):
            began_s = time.thread_time()
            try:
                self._planner.plan(snapshot.grid, snapshot.map_from_robot, goal_m)
            except PlanningError:
                return math.nan
            taken_s = min(time.thread_time() - began_s, taken_s if taken_s > 0 else math.inf)
        return taken_s

    @property
    def commands(self) -> bool:
        """Whether the robot still takes goals."""
        return self._in_command() and not self.system.failures

    def _in_command(self) -> bool:
        telemetry = self.system.station.view().telemetry
        return telemetry is not None and telemetry.state is MissionState.COMMAND


def _in_start_frame(scenario: Scenario, room_m: tuple[float, float]) -> tuple[float, float]:
    """The map's frame, which begins where the robot did."""
    x, y = scenario.start.room_from_robot.inverse().apply(np.array([room_m]))[0].tolist()
    return x, y
