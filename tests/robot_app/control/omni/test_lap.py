from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest

from robot_app.control.omni.lap import Lap, LapConfig
from shared.geometry.se2 import Pose2

STEP_M = 0.02


def corridor(length_m: float, laps: float, drift_rad_per_m: float = 0.0, swerve_rad: float = 0.0) -> Iterable[Pose2]:
    """Round and round a loop of two straights 1 m apart, as an odometry that turns too far sees it; left-handed.

    `swerve_rad`: how far the heading swings to and fro every 2 m.
    """
    x = y = theta = 0.0
    corners = (length_m, 1.0, length_m, 1.0)
    for k in range(math.ceil(4 * laps)):
        for i in range(round(corners[k % 4] / STEP_M)):
            theta += drift_rad_per_m * STEP_M
            swing = swerve_rad * math.sin(math.pi * i * STEP_M)
            x, y = x + STEP_M * math.cos(theta + swing), y + STEP_M * math.sin(theta + swing)
            yield Pose2(x, y, theta + swing)
        for _ in range(10):
            theta += math.pi / 20
            yield Pose2(x, y, theta)


def closed_after_m(poses: Iterable[Pose2], side: int = -1) -> tuple[float, float]:
    """The way until the lap is closed, infinite if it is not, and how often it turned away from the wall."""
    lap = Lap(LapConfig(), side)
    for pose in poses:
        lap.travel(pose)
        turns = lap.turns_round()
        if turns:
            return lap.distance_m, turns
    return math.inf, 0.0


def test_a_lap_of_a_room_ends_where_it_began() -> None:
    way_m, turns = closed_after_m(corridor(4.0, 1.6))
    assert 9.0 < way_m < 12.5
    assert turns > 0.7


def test_a_long_corridor_is_closed_though_the_odometry_has_drifted_by_a_metre() -> None:
    drift = math.radians(3.0) / 60
    ends = np.array([(p.x_m, p.y_m) for p in corridor(29.0, 1.0, drift)])[-1]
    assert np.hypot(*ends) > 0.7
    way_m, turns = closed_after_m(corridor(29.0, 1.4, drift))
    assert 55.0 < way_m < 64.0
    assert turns > 0.7


def test_bends_round_things_on_the_way_back_do_not_close_it_before() -> None:
    way_m, _ = closed_after_m(corridor(29.0, 1.4, swerve_rad=1.2))
    assert way_m > 50.0


def mirrored(poses: Iterable[Pose2]) -> Iterable[Pose2]:
    return (Pose2(p.x_m, -p.y_m, -p.theta_rad) for p in poses)


def test_round_an_island_it_turns_towards_the_wall() -> None:
    assert closed_after_m(mirrored(corridor(2.0, 2.0)))[1] < -0.7
    assert closed_after_m(corridor(2.0, 2.0), side=1)[1] < -0.7


def test_with_the_wall_at_the_left_a_room_is_gone_round_the_other_way() -> None:
    assert closed_after_m(mirrored(corridor(4.0, 1.6)), side=1)[1] > 0.7


def with_dead_end(turn_rad: float) -> Iterable[Pose2]:
    """A lap of the corridor, left-handed, into a slot of 1 m and straight back on the way, turning round there by
    `turn_rad`; and where it leaves the slot, by a right angle to the left again."""
    x = y = theta = 0.0
    for leg_m, corner_rad in ((4.0, -math.pi / 2), (1.0, turn_rad), (1.0, -math.pi / 2), (4.0, math.pi / 2),
                              (2.0, math.pi / 2), (8.0, math.pi / 2), (2.0, math.pi / 2), (8.0, 0.0)):  # fmt: skip
        for _ in range(round(leg_m / STEP_M)):
            x, y = x + STEP_M * math.cos(theta), y + STEP_M * math.sin(theta)
            yield Pose2(x, y, theta)
        for _ in range(10):
            theta += corner_rad / 10
            yield Pose2(x, y, theta)


@pytest.mark.parametrize("turn_rad", [math.pi, 0.98 * math.pi, -0.98 * math.pi, -math.pi])
def test_to_which_side_it_turns_round_in_a_dead_end_does_not_matter(turn_rad: float) -> None:
    way_m, turns = closed_after_m(with_dead_end(turn_rad))
    assert 21.0 < way_m < 27.0
    assert turns == pytest.approx(1.0, abs=0.15)


def straight_m(start: Pose2, length_m: float) -> Iterable[Pose2]:
    for i in range(1, round(length_m / STEP_M) + 1):
        yield start @ Pose2(i * STEP_M, 0.0, 0.0)


def round_thing(start: Pose2, radius_m: float, turns: float) -> Iterable[Pose2]:
    """Round what stands at the right."""
    for i in range(1, round(math.tau * radius_m * turns / STEP_M) + 1):
        angle = i * STEP_M / radius_m
        yield start @ Pose2(radius_m * math.sin(angle), radius_m * (math.cos(angle) - 1), -angle)


def test_a_lap_of_an_island_is_left_out_of_that_of_the_room() -> None:
    """From a wall to an island, once round it and some more, across to the wall, and on to where the lap began."""
    lap = Lap(LapConfig(), -1)
    island = Pose2(4.0, 0.0, 0.0)
    turns = 0.0
    for pose in (*straight_m(Pose2(), 4.0), *round_thing(island, 0.45, 1.6)):
        lap.travel(pose)
        turns = lap.turns_round()
        if turns:
            break
    assert turns < -0.7
    assert lap.distance_m < 4.0 + 1.6 * math.tau * 0.45
    assert lap.leave_out() == pytest.approx(0.0, abs=0.2)
    legs = ((pose, 2.0), (Pose2(6.0, 0.0, math.pi / 2), 2.0), (Pose2(6.0, 2.0, math.pi), 6.0),
            (Pose2(0.0, 2.0, -math.pi / 2), 2.0), (Pose2(), 4.0))  # fmt: skip
    for pose in (pose for leg in legs for pose in straight_m(*leg)):
        lap.travel(pose)
        turns = lap.turns_round()
        if turns:
            break
    assert turns == pytest.approx(1.0, abs=0.15)
    assert pose.x_m < 3.5


def test_steps_to_an_island_near_the_start_close_no_lap_of_the_room() -> None:
    """It comes back beside the start, in the same direction, having gone round no more than the half of the room."""
    lap = Lap(LapConfig(), -1)
    turns = 0.0
    for pose in (*straight_m(Pose2(), 1.5), *round_thing(Pose2(1.5, 0.0, 0.0), 0.45, 2.0)):
        lap.travel(pose)
        turns = lap.turns_round()
        if turns:
            break
    assert turns < -0.7
    assert lap.leave_out() is None
    legs = ((pose, 1.0), (Pose2(3.0, 0.5, math.pi / 2), 1.5), (Pose2(3.0, 2.0, math.pi), 20.0),
            (Pose2(-17.0, 2.0, -math.pi / 2), 1.0), (Pose2(-17.0, 1.0), 17.0))  # fmt: skip
    for pose in (pose for leg in legs for pose in straight_m(*leg)):
        lap.travel(pose)
        assert lap.turns_round() == 0.0


def test_standing_and_turning_on_the_spot_closes_nothing() -> None:
    assert closed_after_m(Pose2(0.0, 0.0, 0.05 * k) for k in range(1000))[0] == math.inf
