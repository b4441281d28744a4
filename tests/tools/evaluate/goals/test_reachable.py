from __future__ import annotations

from dataclasses import replace

import pytest

from shared.geometry.se2 import Pose2
from station_gui.config import load_config
from tools.evaluate.goals.command import random_places
from tools.evaluate.goals.reachable import Reachable
from tools.simulator.scenario import Item, Room, Scenario, Start

CAR = load_config(None).car
START = Pose2(0.5, 0.5, 0.0)


def _room(*items: Item) -> Scenario:
    return Scenario("room", Start((0.5, 0.5)), Room(3.0, 2.0), items)


def _wall(gap_m: float) -> tuple[Item, ...]:
    """Across the room at x = 1.5, a gap in its middle."""
    length = (2.0 - gap_m) / 2
    return tuple(
        Item(name, (1.5, y), (0.1, length, 0.5))
        for name, y in (("south", length / 2), ("north", 2.0 - length / 2))
    )  # fmt: skip


@pytest.mark.parametrize(("gap_m", "margin_m", "through"), [(0.3, 0.0, True), (0.3, 0.06, False), (0.19, 0.0, False)])
def test_the_car_comes_through_a_gap_that_is_wider_than_it_is(gap_m: float, margin_m: float, through: bool) -> None:
    assert ((2.4, 1.0) in Reachable(_room(*_wall(gap_m)), CAR, START, margin_m)) is through


def test_a_place_in_a_box_at_a_wall_or_outside_is_not_reached() -> None:
    reachable = Reachable(_room(Item("box", (2.0, 1.0), (0.4, 0.4, 0.3))), CAR, START, 0.0)
    for place in ((2.0, 1.0), (2.95, 1.9), (-0.1, 1.0), (3.2, 1.0)):
        assert place not in reachable
    assert (2.5, 1.5) in reachable


def test_what_the_car_passes_under_is_no_obstacle() -> None:
    table = Item("table", (2.0, 1.0), (0.9, 0.9, 0.7), kind="table")
    assert (2.0, 1.0) in Reachable(_room(table), CAR, START, 0.0)


def test_every_other_goal_is_one_that_can_be_reached() -> None:
    scenario = _room(*_wall(0.19))
    bare = Reachable(scenario, CAR, START, 0.0)
    places = random_places(scenario, 1, 20, bare)
    assert all(place in bare for place in places[1::2])
    assert places == random_places(replace(scenario, name="again"), 1, 20, bare)
