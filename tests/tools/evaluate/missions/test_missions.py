from __future__ import annotations

import numpy as np
import pytest

from robot_app.config import load_config
from tools.evaluate.goals.reachable import Reachable
from tools.evaluate.missions.command import summarise
from tools.evaluate.missions.floor import CELL_M, Floor
from tools.evaluate.missions.rearranged import rearranged
from tools.evaluate.missions.trial import TrialFigures
from tools.simulator.scenario import Item, Room, Scenario, Start, find_scenario

CAR = load_config(None).car


def scenario(*items: Item) -> Scenario:
    return Scenario("yard", Start((0.6, 1.0)), Room(3.0, 2.0), items)


def test_all_floor_of_an_empty_room_is_reachable_and_seen_from_one_end_of_it() -> None:
    floor = Floor(scenario(), CAR)
    assert floor.reachable.all()
    looks = np.array([(0.1 * k, 0.6, 1.0, 0.0) for k in range(5)])
    assert floor.share_seen(looks) == pytest.approx(floor.seen(looks).mean())
    assert 0.7 < floor.share_seen(looks) < 1.0


def test_floor_behind_a_wall_across_the_room_does_not_count() -> None:
    floor = Floor(scenario(Item("wall", (2.0, 1.0), (0.1, 2.0, 0.5))), CAR)
    assert floor.reachable[:, : int(1.9 / CELL_M)].all()
    assert not floor.reachable[:, int(2.1 / CELL_M) :].any()


@pytest.mark.parametrize("gap_m", [0.0, 0.0005])
def test_the_inside_of_boxes_that_touch_is_no_floor(gap_m: float) -> None:
    left, right = Item("left", (1.5 - gap_m, 1.0), (0.4, 0.6, 0.5)), Item("right", (1.9, 0.9), (0.4, 0.6, 0.5))
    reachable = Floor(scenario(left, right), CAR).reachable
    inside = (slice(round(0.75 / CELL_M), round(1.2 / CELL_M) - 1), slice(round(1.35 / CELL_M), round(2.05 / CELL_M)))
    assert not reachable[inside].any()


def test_a_rearranged_lab_has_all_its_things_elsewhere_and_room_for_the_car() -> None:
    lab = find_scenario("lab")
    room = rearranged(lab, CAR, np.random.default_rng(7))
    assert {item.name for item in room.items} == {item.name for item in lab.items}
    assert sum(a.position_m == b.position_m for a, b in zip(room.items, lab.items, strict=False)) == 0
    reach = Reachable(room, CAR, room.start.room_from_robot, 0.10)
    assert reach.places() >= 0.97 * reach.places_that_fit()


def test_the_same_seed_gives_the_same_room() -> None:
    lab = find_scenario("lab")
    first, second = (rearranged(lab, CAR, np.random.default_rng(3)) for _ in range(2))
    assert first == second


def test_the_summary_tells_the_mean_over_the_whole_way_and_the_worst_of_the_rest() -> None:
    rows = [
        TrialFigures(1, 0, 0.99, True, "", 100.0, 20.0, 0.2, 0.3, 0.0),
        TrialFigures(2, 1, 0.90, True, "", 300.0, 30.0, 0.1, 0.4, 5.0),
    ]
    summary = summarise(rows)
    assert (summary["good"], summary["contacts"], summary["floor_seen_min"]) == (1, 1, 0.90)
    assert summary["mean_mps"] == pytest.approx(0.125)
    assert (summary["max_mps"], summary["stuck_s_max"]) == (0.4, 5.0)
