from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from robot_app.config import OMNI_PATH, load_any_config
from robot_app.platform import hello_of
from shared.geometry.se2 import Pose2
from shared.messages import Hello
from station_gui.mapping.snapshot import GridMap
from station_gui.planning.config import PlannerConfig
from station_gui.planning.on_the_spot import body_on_the_spot
from station_gui.planning.path_planner import PathPlanner

OMNI = hello_of(load_any_config(OMNI_PATH), "0")
CAR = hello_of(load_any_config(None), "0")
CELL_M = 0.02


def test_a_robot_that_turns_on_the_spot_is_planned_for_by_its_own_size() -> None:
    body = body_on_the_spot(OMNI)
    assert body is not None
    assert (body.front_m, body.rear_m, body.width_m / 2) == pytest.approx((0.17, 0.17, 0.17), abs=0.004)
    assert body.min_turning_radius_m == pytest.approx(0.10)


@pytest.mark.parametrize(
    "hello",
    [
        CAR,
        replace(OMNI, footprint_m=()),
        replace(OMNI, footprint_m=((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))),
        replace(OMNI, footprint_m=((-1e9, 0.0), (1e9, 0.0), (0.0, 1e9))),
        replace(OMNI, footprint_m=((math.nan, 0.0), (0.2, 0.2), (-0.2, 0.2))),
        replace(OMNI, footprint_m=((0.5, 0.1), (0.6, 0.2), (0.5, 0.2))),
    ],
)
def test_any_other_robot_is_left_to_the_stations_own_table(hello: Hello) -> None:
    assert body_on_the_spot(hello) is None


def test_a_way_is_found_out_of_a_niche_in_which_no_car_could_turn() -> None:
    """0.5 m wide and closed at its end; the robot faces the end and needs no more room than itself to turn."""
    probability = np.full((150, 150), 0.05, np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 0.95
    probability[:, 100:] = 0.95
    probability[60:86, 75:100] = 0.05  # 0.52 m
    body = body_on_the_spot(OMNI)
    assert body is not None
    planner = PathPlanner(body, PlannerConfig(), lambda: 0.0)
    start = Pose2(1.75, 1.46, 0.0)
    plan = planner.plan(GridMap(probability, (0.0, 0.0), CELL_M), start, (0.5, 0.6))
    np.testing.assert_allclose(plan.path[-1, :2], [0.5, 0.6], atol=1e-6)
    assert plan.clearance_m >= 0.04
