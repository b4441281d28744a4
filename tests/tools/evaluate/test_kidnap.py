from __future__ import annotations

import math

import numpy as np
import pytest

from shared.geometry.se2 import Pose2
from tools.evaluate.kidnap import Trial, as_json, succeeded, summarise
from tools.simulator.rooms import free_pose, random_room
from tools.simulator.scenario import Scenario, find_scenario
from tools.simulator.solids import solids_of
from tools.simulator.world import World


@pytest.fixture(scope="module")
def lab() -> Scenario:
    return find_scenario("lab")


def _stands_in(scenario: Scenario, pose: Pose2) -> list[str]:
    """Names of the solids that a point of a fine grid over the car lies in."""
    car = scenario.car
    x, y = np.meshgrid(np.linspace(-car.rear_m, car.front_m, 36), np.linspace(-car.width_m / 2, car.width_m / 2, 21))
    points = pose.apply(np.column_stack((x.ravel(), y.ravel())))
    hit = []
    for solid in solids_of(scenario):
        local = Pose2(solid.center_m[0], solid.center_m[1], solid.yaw_rad).inverse().apply(points)
        low = solid.center_m[2] - solid.half_m[2] < car.height_m
        if low and (np.abs(local) <= solid.half_m[:2]).all(axis=1).any():
            hit.append(solid.name)
    return hit


def test_a_robot_is_put_down_where_it_touches_nothing(lab: Scenario) -> None:
    rng = np.random.default_rng(0)
    poses = [free_pose(lab, rng) for _ in range(60)]
    assert all(_stands_in(lab, pose) == [] for pose in poses)
    assert np.ptp([pose.x_m for pose in poses]) > 2.0
    assert np.ptp([pose.theta_rad for pose in poses]) > 5.0


def test_the_same_seed_puts_it_down_at_the_same_place(lab: Scenario) -> None:
    assert free_pose(lab, np.random.default_rng(4)) == free_pose(lab, np.random.default_rng(4))


def test_other_rooms_differ_and_leave_room_for_the_robot(lab: Scenario) -> None:
    rooms = [random_room(lab, np.random.default_rng(k)) for k in range(8)]
    assert len({room.room.length_x_m for room in rooms}) == 8
    for room in rooms:
        assert _stands_in(room, room.start.room_from_robot) == []


def test_a_robot_that_is_carried_feels_nothing_of_it(lab: Scenario) -> None:
    world = World(lab, 1)
    world.advance_to(0.1)
    wheels = world.wheel_angles_rad()
    there = Pose2(2.9, 3.0, 2.0)
    world.place(there)
    assert world.wheel_angles_rad() == wheels
    world.advance_to(0.2)
    assert world.room_from_robot().distance_m(there) < 0.01


def test_figures_count_what_was_found_rightly() -> None:
    here = [
        Trial(0, "found", 1.0, 0.004, 0.1),
        Trial(1, "found", 3.0, 0.006, 0.3),
        Trial(2, "wrong", 2.0, 1.0, 90.0),
        Trial(3, "lost", math.nan, math.nan, math.nan),
    ]
    figures = summarise(here, [Trial(0, "lost", math.nan, math.nan, math.nan)], 1234)
    assert (figures.trials, figures.found, figures.wrong, figures.lost) == (4, 2, 1, 1)
    assert figures.seconds_to_find_p50 == 2.0
    assert figures.error_m_p50 == 0.006
    assert (figures.elsewhere, figures.elsewhere_lost, figures.elsewhere_wrong) == (1, 1, 0)


@pytest.mark.parametrize(
    ("found", "wrong", "lost", "elsewhere_wrong", "succeeds"),
    [(95, 0, 5, 0, True), (94, 0, 6, 0, False), (99, 1, 0, 0, False), (100, 0, 0, 1, False), (0, 0, 3, 0, False)],
)
def test_it_fails_where_too_few_are_found_or_one_place_is_wrong(
    found: int, wrong: int, lost: int, elsewhere_wrong: int, succeeds: bool
) -> None:
    outcomes = ["found"] * found + ["wrong"] * wrong + ["lost"] * lost
    here = [Trial(k, outcome, 1.0, 0.0, 0.0) for k, outcome in enumerate(outcomes)]
    there = [Trial(k, "wrong", 1.0, math.nan, math.nan) for k in range(elsewhere_wrong)]
    assert succeeded(summarise(here, there, 1)) is succeeds


def test_a_trial_is_a_row_in_which_what_is_no_number_is_null() -> None:
    assert as_json(Trial(3, "found", 1.23456, 0.01, 0.5)) == {
        "number": 3, "outcome": "found", "seconds": 1.2346, "error_m": 0.01, "error_deg": 0.5,
    }  # fmt: skip
    assert as_json(Trial(4, "lost", math.nan, math.nan, math.nan))["seconds"] is None


def test_figures_of_no_trials_are_empty() -> None:
    figures = summarise([], [], 0)
    assert figures.seconds_to_find_p50 is None
    assert figures.error_deg_p95 is None
