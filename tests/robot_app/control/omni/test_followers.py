from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.control.omni.path_follower import OmniPathConfig, OmniPathFollower
from robot_app.control.omni.wall_follower import OmniWallConfig, OmniWallFollower, way_ahead
from robot_app.control.path_follower import PathState
from robot_app.control.wall_follower import WallState
from shared.geometry.omni3 import Twist
from shared.geometry.se2 import Pose2

STEP_S = 0.04


def moved(pose: Pose2, twist: Twist) -> Pose2:
    return pose @ Pose2(twist.x_mps * STEP_S, twist.y_mps * STEP_S, twist.turn_radps * STEP_S)


def walls(length_m: float, width_m: float) -> NDArray[np.float64]:
    x, y = np.arange(0.0, length_m, 0.025), np.arange(0.0, width_m, 0.025)
    return np.vstack(
        (
            np.column_stack((x, np.zeros_like(x))),
            np.column_stack((x, np.full_like(x, width_m))),
            np.column_stack((np.zeros_like(y), y)),
            np.column_stack((np.full_like(y, length_m), y)),
        )
    )


def test_it_looks_round_first_and_then_goes_once_round_beside_the_walls() -> None:
    follower, pose, room = OmniWallFollower(OmniWallConfig()), Pose2(1.0, 1.0, 0.0), walls(5.0, 2.0)
    gaps: list[float] = []
    for k in range(3000):
        near = room[np.hypot(room[:, 0] - pose.x_m, room[:, 1] - pose.y_m) < 1.7]
        step = follower.step(near, pose, 0.9)
        if k < 150:
            assert step.twist.speed_mps == 0.0  # turning on the spot
        pose = moved(pose, step.twist)
        gaps.append(float(np.hypot(*(room - (pose.x_m, pose.y_m)).T).min()))
        if step.state is WallState.DONE:
            break
    assert step.state is WallState.DONE
    assert 8.0 < k * STEP_S < 80.0
    assert min(gaps) > 0.3  # no avoidance is at work here
    assert np.median(gaps[300:]) == pytest.approx(0.5, abs=0.06)


def test_an_offset_from_the_way_is_slid_away_and_not_steered_away() -> None:
    follower, room = OmniWallFollower(OmniWallConfig()), walls(12.0, 4.0)
    for k in range(200):  # looks round
        follower.step(room, Pose2(4.0, 0.7, -0.04 * k), 0.9)
    step = follower.step(room[np.hypot(*(room - (4.0, 0.7)).T) < 1.7], Pose2(4.0, 0.7, 0.0), 0.9)
    assert step.offset_m == pytest.approx(0.2, abs=0.07)
    assert step.twist.y_mps < -0.05
    assert abs(step.twist.turn_radps) < 0.5 * OmniWallConfig().turn_radps


def test_the_way_ahead_is_judged_from_the_nearest_point_of_the_way() -> None:
    way = np.column_stack((np.linspace(-0.5, 1.0, 31), np.full(31, -0.2)))
    ahead, offset = way_ahead(way, 0.45)
    assert offset == pytest.approx(0.2)
    assert np.hypot(*ahead) == pytest.approx(0.45, abs=0.06)


def follow(path: NDArray[np.float64], pose: Pose2, seconds: float = 40.0) -> tuple[Pose2, PathState, float, float]:
    """Where it ends, how, how far from the path it came, and its greatest speed."""
    follower, state, farthest, fastest = OmniPathFollower(OmniPathConfig(), path), PathState.FOLLOWING, 0.0, 0.0
    for k in range(round(seconds / STEP_S)):
        step = follower.step(k * STEP_S, pose)
        state = step.state
        if state is not PathState.FOLLOWING:
            break
        pose = moved(pose, step.twist)
        fastest = max(fastest, step.twist.speed_mps)
        farthest = max(farthest, float(np.hypot(*(path[:, :2] - (pose.x_m, pose.y_m)).T).min()))
    return pose, state, farthest, fastest


def bend() -> NDArray[np.float64]:
    along = np.linspace(0.0, 2.0, 51)
    first = np.column_stack((along, np.zeros(51), np.zeros(51)))
    second = np.column_stack((np.full(51, 2.0), along, np.full(51, math.pi / 2)))
    return np.vstack((first, second[1:]))


def test_a_path_with_a_corner_is_followed_to_its_end_and_heading() -> None:
    pose, state, farthest, fastest = follow(bend(), Pose2(0.0, 0.05, 0.3))
    assert state is PathState.DONE
    assert math.hypot(pose.x_m - 2.0, pose.y_m - 2.0) < 0.02
    assert pose.theta_rad == pytest.approx(math.pi / 2, abs=0.06)
    assert farthest < 0.16
    assert 0.3 < fastest <= 0.43


def test_a_path_behind_it_is_turned_to_first() -> None:
    pose, state, _, _ = follow(np.array([(-0.04 * k, 0.0, math.pi) for k in range(30)]), Pose2())
    assert state is PathState.DONE
    assert pose.x_m == pytest.approx(-1.16, abs=0.02)


def test_who_is_carried_off_the_path_is_lost_and_stands() -> None:
    follower = OmniPathFollower(OmniPathConfig(), bend())
    step = follower.step(0.0, Pose2(0.5, 0.9, 0.0))
    assert step.state is PathState.LOST
    assert step.twist.speed_mps == 0.0
    assert follower.step(0.1, Pose2()).state is PathState.LOST


def test_a_path_of_two_points_at_its_feet_ends() -> None:
    pose, state, _, _ = follow(np.array([(0.0, 0.0, 0.0), (0.02, 0.0, 1.0)]), Pose2())
    assert state is PathState.DONE
    assert pose.theta_rad == pytest.approx(1.0, abs=0.06)
