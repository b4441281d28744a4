from __future__ import annotations

from dataclasses import replace

import numpy as np

from tools.evaluate.mapping.edges import STEP_M, SeenThings, seen_things
from tools.evaluate.mapping.world import camera_places, true_world
from tools.simulator.scenario import Item, Scenario


def edges_of(things: SeenThings, scenario: Scenario, name: str) -> list[float]:
    """How much can be seen of each edge of the item, in m."""
    number = [item.name for item in scenario.items].index(name)
    return [round(len(edge.seen_m) * STEP_M, 2) for edge in things.edges if edge.item == number]


def looking_along_x(scenario: Scenario) -> SeenThings:
    """From (1, 3) only."""
    return seen_things(true_world(scenario), camera_places(scenario, np.array([[0.0, 1.0, 3.0, 0.0]])))


def test_who_drives_round_a_box_can_see_all_of_its_edges(things: SeenThings, scenario: Scenario) -> None:
    assert edges_of(things, scenario, "box") == [0.5] * 4
    assert edges_of(things, scenario, "small") == [0.3] * 4


def test_each_leg_of_a_table_has_edges_and_its_top_has_none(things: SeenThings, scenario: Scenario) -> None:
    seen = edges_of(things, scenario, "table")
    assert 12 <= len(seen) <= 16
    assert max(seen) == 0.66


def test_who_stands_before_a_box_can_see_the_two_edges_of_its_front(scenario: Scenario) -> None:
    assert edges_of(looking_along_x(scenario), scenario, "box") == [0.5] * 2


def test_what_stands_before_a_thing_hides_it(scenario: Scenario) -> None:
    screen = Item("screen", (2.2, 3.0), (0.1, 2.0, 0.9))
    hidden = looking_along_x(replace(scenario, items=(*scenario.items, screen)))
    assert edges_of(hidden, scenario, "box") == []
    assert 0 not in hidden.items


def test_where_boxes_stand_flush_there_is_no_edge_up_to_the_lower_one(scenario: Scenario) -> None:
    beside = Item("beside", (3.0, 3.45), (0.4, 0.3, 0.2))
    crowded = replace(scenario, items=(*scenario.items, beside))
    assert sorted(edges_of(looking_along_x(crowded), crowded, "box")) == [0.3, 0.5]
    assert edges_of(looking_along_x(crowded), crowded, "beside") == [0.2]


def test_a_box_at_a_wall_has_no_edge_there(scenario: Scenario) -> None:
    at_wall = replace(scenario, items=(Item("at_wall", (5.8, 3.0), (0.4, 0.6, 0.5)),))
    assert edges_of(looking_along_x(at_wall), at_wall, "at_wall") == [0.5] * 2


def test_a_top_above_the_cameras_field_is_not_asked_for(scenario: Scenario) -> None:
    tall = replace(
        scenario, items=(Item("near", (2.3, 2.7), (0.4, 0.2, 1.2)), Item("far", (5.0, 3.4), (0.4, 0.4, 1.2)))
    )
    assert looking_along_x(tall).tops_m == {1: 1.2}


def test_inner_walls_hide_things_and_are_none(scenario: Scenario) -> None:
    wall = Item("inner", (2.2, 3.0), (0.1, 2.0, 1.5), "wall")
    parted = looking_along_x(replace(scenario, items=(wall, *scenario.items)))
    assert 0 not in parted.items
    assert 1 not in parted.items
