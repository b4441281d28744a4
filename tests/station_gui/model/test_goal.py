"""The goal keeper with a planner and a robot that do as they are told."""

from __future__ import annotations

import numpy as np
import pytest

from shared.geometry.se2 import Pose2
from shared.messages import Command, Drive, GoTo, MissionState
from shared.runtime.clock import ManualClock
from station_gui.config import load_config
from station_gui.mapping.snapshot import NO_OBJECTS, GridMap, MapSnapshot
from station_gui.model.goal import GoalKeeper
from station_gui.model.goal_figures import GoalFigures, GoalState
from station_gui.model.journal import Journal
from station_gui.planning.path_planner import PathPlanner
from tests.shared import samples

_CELL_M = 0.02


def _snapshot(revision: int, *boxes: tuple[float, float, float, float]) -> MapSnapshot:
    """4 x 3 m, free within its walls; the robot stands at (0.7, 1.5) and looks along x."""
    probability = np.full((150, 200), 0.05, np.float32)
    probability[[0, -1]] = 0.95
    probability[:, [0, -1]] = 0.95
    for box in boxes:
        x0, y0, x1, y1 = (round(v / _CELL_M) for v in box)
        probability[y0:y1, x0:x1] = 0.95
    grid, pose = GridMap(probability, (0.0, 0.0), _CELL_M), Pose2(0.7, 1.5, 0.0)
    nothing = np.zeros((0, 4))
    return MapSnapshot(revision, 1.0, pose, Pose2(), grid, NO_OBJECTS, nothing, np.zeros((0, 2), np.int32), 1, 0.0, 0.0)


class Scene:
    def __init__(self) -> None:
        config = load_config(None)
        self.sent: list[Command] = []
        self.journal = Journal(ManualClock())
        planner = PathPlanner(config.car, config.planning, ManualClock().now_s)
        self.keeper = GoalKeeper(planner, self._send, self.journal)

    def _send(self, command: Command) -> bool:
        self.sent.append(command)
        return True

    def step(self, snapshot: MapSnapshot, stamp_s: float, following: int = 1) -> None:
        state = samples.telemetry(state=MissionState.COMMAND, stamp_s=stamp_s, following_goal=following, faults=())
        self.keeper.step(snapshot, state)

    @property
    def figures(self) -> GoalFigures:
        assert self.keeper.figures is not None
        return self.keeper.figures


@pytest.fixture
def scene() -> Scene:
    scene = Scene()
    scene.keeper.ask(3.2, 1.5)
    scene.step(_snapshot(1), 10.0, following=0)
    return scene


def test_the_figures_are_those_of_the_path_that_was_sent(scene: Scene) -> None:
    figures = scene.figures
    assert figures.state is GoalState.GOING
    assert figures.length_m == pytest.approx(2.5, abs=0.01)
    assert figures.clearance_m == pytest.approx(0.2, abs=0.01)
    assert figures.plans == 1
    assert figures.planning_s > 0
    assert [type(command) for command in scene.sent] == [GoTo]


def test_something_new_in_the_way_is_planned_around(scene: Scene) -> None:
    scene.step(_snapshot(2), 12.0)
    assert scene.figures.plans == 1
    scene.step(_snapshot(3, (1.9, 1.3, 2.1, 1.7)), 14.0)
    assert scene.figures.plans == 2
    assert scene.figures.length_m > 2.55
    assert [type(command) for command in scene.sent] == [GoTo, GoTo]


def test_something_new_beside_the_way_changes_nothing(scene: Scene) -> None:
    scene.step(_snapshot(2, (1.9, 2.5, 2.1, 2.9)), 12.0)
    assert scene.figures.plans == 1
    assert len(scene.sent) == 1


def test_a_way_that_closes_stops_the_robot_and_is_told(scene: Scene) -> None:
    scene.step(_snapshot(2, (1.9, 0.0, 2.1, 3.0)), 12.0)
    assert scene.figures.state is GoalState.GIVEN_UP
    assert "no way" in scene.figures.reason
    assert scene.sent[-1] == Drive(0.0, 0.0)
    assert scene.keeper.goal_m is None


def test_a_goal_in_a_wall_is_refused_and_nothing_is_sent() -> None:
    scene = Scene()
    scene.keeper.ask(0.01, 1.5)
    scene.step(_snapshot(1), 10.0, following=0)
    assert scene.figures.state is GoalState.REFUSED
    assert scene.figures.reason == "the goal is inside an obstacle"
    assert scene.sent == []


def test_another_order_takes_the_place_of_a_goal_and_the_next_one_has_the_next_number(scene: Scene) -> None:
    scene.keeper.forget()
    assert scene.figures.state is GoalState.FORGOTTEN
    scene.keeper.ask(2.0, 1.5)
    scene.step(_snapshot(1), 12.0, following=0)
    assert (scene.figures.number, scene.figures.goal_m) == (2, (2.0, 1.5))


def test_a_robot_that_stands_at_the_goal_has_reached_it() -> None:
    scene = Scene()
    scene.keeper.ask(0.75, 1.5)
    scene.step(_snapshot(1), 10.0, following=0)
    scene.step(_snapshot(2), 12.0, following=0)
    assert scene.figures.state is GoalState.REACHED
