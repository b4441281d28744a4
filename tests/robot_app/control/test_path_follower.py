import math

import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.control.motion import Motion
from robot_app.control.path_follower import PathFollower, PathFollowerConfig, PathState, PathStep, split_stretches
from shared.geometry.se2 import Pose2

BEND = 1.9  # 1/m, a little less than the car can


def _path(*arcs: tuple[float, float]) -> NDArray[np.float64]:
    """Arcs of (length, curvature) one after another, from the origin; a negative length is driven in reverse."""
    rows = [(0.0, 0.0, 0.0)]
    for length, curvature in arcs:
        begin = Pose2(*rows[-1])
        for way in np.linspace(0, length, int(abs(length) / 0.04) + 2)[1:]:
            turn = way * curvature
            chord = way * float(np.sinc(turn / math.tau))
            pose = begin @ Pose2(chord * math.cos(turn / 2), chord * math.sin(turn / 2), turn)
            rows.append((pose.x_m, pose.y_m, pose.theta_rad))
    return np.array(rows)


def _follow(car, simulated_car, rectangle, path, start=Pose2(), seed=0):  # type: ignore[no-untyped-def]  # noqa: B008, ANN
    """Drive until the follower stands; returns the simulated car and all steps."""
    robot = simulated_car(rectangle(0, 0, 20, 20), start, np.random.default_rng(seed), odom=start)
    follower = PathFollower(car, PathFollowerConfig(), path)
    steps: list[PathStep] = []
    while robot.now_s < 90 and (not steps or steps[-1].state in {PathState.FOLLOWING, PathState.CUSP}):
        steps.append(follower.step(robot.now_s, robot.odom, robot.speed_mps))
        robot.drive(steps[-1].motion, 0.04)
    robot.drive(Motion(0.0, 0.0), 0.5)
    return robot, steps


PATHS = {
    "round a bend": _path((1.0, 0.0), (0.8, BEND), (0.8, -BEND)),
    "with two cusps": _path((1.0, BEND), (-0.8, -BEND), (0.7, 0.0)),
    "in reverse": _path((-0.6, 0.0), (-0.9, BEND)),
    "turning round on the spot": _path(*[(0.3, BEND), (-0.3, -BEND)] * 5),
}


@pytest.mark.parametrize("name", PATHS)
def test_the_car_ends_within_3_cm_of_the_goal(name, car, simulated_car, rectangle) -> None:  # type: ignore[no-untyped-def]
    robot, steps = _follow(car, simulated_car, rectangle, PATHS[name])
    goal = Pose2(*PATHS[name][-1])
    assert steps[-1].state is PathState.DONE
    assert robot.odom.distance_m(goal) < 0.03
    assert max(abs(s.cross_track_m) for s in steps) < 0.03


def test_a_car_beside_the_path_comes_back_to_it(car, simulated_car, rectangle) -> None:  # type: ignore[no-untyped-def]
    path = _path((2.0, 0.0))
    robot, _ = _follow(car, simulated_car, rectangle, path, Pose2(0.0, 0.1, -0.2))
    assert robot.odom.distance_m(Pose2(*path[-1])) < 0.03


def test_a_car_far_from_its_path_stands_and_says_so(car, simulated_car, rectangle) -> None:  # type: ignore[no-untyped-def]
    _, steps = _follow(car, simulated_car, rectangle, _path((2.0, 0.0)), Pose2(0.5, 0.6, 0.0))
    assert steps[-1].state is PathState.LOST
    assert steps[-1].motion == Motion(0.0, 0.0)


def test_a_path_is_split_where_the_car_changes_direction() -> None:
    stretches = split_stretches(PATHS["with two cusps"])
    assert [s.forward for s in stretches] == [True, False, True]
    assert [s.length_m for s in stretches] == pytest.approx([1.0, 0.8, 0.7], abs=0.01)


@pytest.mark.parametrize("path", [np.zeros((0, 3)), np.zeros((1, 3)), np.zeros((5, 3))])
def test_a_path_that_leads_nowhere_is_done_at_once(path, car) -> None:  # type: ignore[no-untyped-def]
    step = PathFollower(car, PathFollowerConfig(), path).step(0.0, Pose2(), 0.0)
    assert step.state is PathState.DONE
    assert step.motion == Motion(0.0, 0.0)
