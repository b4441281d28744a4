from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.control.omni.homing import Homing, HomingConfig, HomingState, Trail
from robot_app.control.omni.path_follower import OmniPathConfig
from shared.geometry.se2 import Pose2

STEP_S, RADIUS_M = 0.04, 0.17
NOTHING = np.zeros((0, 2))
HOME = Pose2(0.0, 0.0, 0.3)


def trail_of(*corners_m: tuple[float, float], config: HomingConfig | None = None) -> Trail:
    """Of a robot that went straight from each corner to the next, in steps of a centimetre."""
    trail = Trail(config or HomingConfig())
    for (x0, y0), (x1, y1) in pairwise(corners_m):
        for share in np.linspace(0.0, 1.0, round(math.dist((x0, y0), (x1, y1)) / 0.01) + 1).tolist():
            trail.add(Pose2(x0 + share * (x1 - x0), y0 + share * (y1 - y0), 0.0))
    return trail


def length_m(trail: Trail) -> float:
    return float(np.hypot(*np.diff(trail.places_m, axis=0).T).sum())


def drive_home(
    trail: Trail, pose: Pose2, points_m: NDArray[np.float64] = NOTHING, stuck: bool = False, home: Pose2 = HOME
) -> tuple[HomingState, Pose2, float]:
    """How it ends, where, and how far it went."""
    homing, gone_m = Homing(HomingConfig(), OmniPathConfig(), RADIUS_M, home), 0.0
    for k in range(3000):
        step = homing.step(k * STEP_S, pose, trail, points_m, blocked=stuck)
        if step.state is not HomingState.UNDER_WAY:
            return step.state, pose, gone_m
        twist = step.twist
        if not stuck:
            pose = pose @ Pose2(twist.x_mps * STEP_S, twist.y_mps * STEP_S, twist.turn_radps * STEP_S)
            gone_m += twist.speed_mps * STEP_S
            trail.add(pose)
    return HomingState.UNDER_WAY, pose, gone_m


def test_a_trail_leaves_out_what_lies_between_two_visits_of_a_place() -> None:
    trail = trail_of((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 2.0), (1.0, 0.0), (1.0, -1.0))
    assert length_m(trail) == pytest.approx(2.0, abs=0.2)


def test_a_trail_that_grows_long_is_kept_more_coarsely() -> None:
    trail = trail_of((0.0, 0.0), (30.0, 0.0), config=HomingConfig(places=100))
    assert len(trail.places_m) <= 100
    assert tuple(trail.places_m[0]) == (0.0, 0.0)
    assert length_m(trail) == pytest.approx(30.0, abs=0.2)


def test_it_goes_back_round_the_corner_that_it_came_round_to_where_it_stood_at_first() -> None:
    wall = np.column_stack((np.arange(-0.5, 1.5, 0.02), np.full(100, 0.6)))
    trail = trail_of((0.0, 0.0), (2.0, 0.0), (2.0, 1.2), (0.5, 1.2))
    state, at, gone_m = drive_home(trail, Pose2(0.5, 1.2, math.pi), wall)
    assert state is HomingState.HOME
    assert at.distance_m(HOME) < 0.015
    assert at.theta_rad == pytest.approx(HOME.theta_rad, abs=0.06)
    assert gone_m > 3.5


def test_it_goes_straight_across_where_nothing_stands_between() -> None:
    trail = trail_of((0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (0.5, 1.0))
    state, at, gone_m = drive_home(trail, Pose2(0.5, 1.0, math.pi))
    assert (state, at.distance_m(HOME) < 0.015) == (HomingState.HOME, True)
    assert gone_m < 1.5


def test_one_that_is_blocked_for_good_gives_up_but_is_home_where_it_is_near_it() -> None:
    trail = trail_of((0.0, 0.0), (2.0, 0.0))
    assert drive_home(trail, Pose2(2.0, 0.0, 0.0), stuck=True)[0] is HomingState.NO_WAY
    assert drive_home(trail, Pose2(0.2, 0.0, 0.0), stuck=True)[0] is HomingState.HOME


def test_one_that_was_started_again_on_its_way_knows_no_way_home() -> None:
    assert drive_home(trail_of((2.0, 0.0), (3.0, 0.0)), Pose2(3.0, 0.0, 0.0))[0] is HomingState.NO_WAY
    assert drive_home(Trail(HomingConfig()), Pose2(3.0, 0.0, 0.0))[0] is HomingState.NO_WAY
