from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from robot_app.drivers.base import DriveSetting
from tools.simulator.scenario import Item, Scenario, Start
from tools.simulator.truth import read_truth, true_surfaces, write_truth
from tools.simulator.world import World

MakeRoom = Callable[..., Scenario]


def length_m(scenario: Scenario) -> float:
    segments = true_surfaces(scenario).segments_m
    return float(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum())


def test_an_empty_room_has_its_circumference(room: MakeRoom) -> None:
    assert length_m(room()) == pytest.approx(2 * (3.95 + 4.2), abs=0.01)


def test_a_free_box_adds_its_outline(room: MakeRoom) -> None:
    box = Item("box", (2.5, 2.0), (0.4, 0.6, 0.3), yaw_deg=20.0)
    assert length_m(room(box)) == pytest.approx(2 * (3.95 + 4.2) + 2.0, abs=0.01)


def test_what_touches_or_lies_inside_something_is_no_surface(room: MakeRoom) -> None:
    at_wall = Item("at_wall", (3.75, 2.0), (0.4, 0.6, 0.3))
    assert length_m(room(at_wall)) == pytest.approx(2 * (3.95 + 4.2) + 2 * 0.4, abs=0.02)
    inside = Item("inside", (3.75, 2.0), (0.2, 0.2, 0.3))
    assert length_m(room(at_wall, inside)) == pytest.approx(length_m(room(at_wall)), abs=1e-6)


def test_a_table_shows_its_legs_only(room: MakeRoom) -> None:
    table = Item("table", (2.5, 2.0), (0.8, 0.6, 0.7), "table")
    assert length_m(room(table)) == pytest.approx(2 * (3.95 + 4.2) + 4 * 0.16, abs=0.02)


def test_free_space_is_on_the_left_of_every_surface(room: MakeRoom) -> None:
    surfaces = true_surfaces(room(Item("box", (2.5, 2.0), (0.4, 0.6, 0.3))))
    for start, end in surfaces.segments_m:
        along = end - start
        beside = (start + end) / 2 + 0.01 * np.array([-along[1], along[0]]) / np.linalg.norm(along)
        assert 0 < beside[0] < 3.95
        assert 0 < beside[1] < 4.2
        assert not (2.3 < beside[0] < 2.7 and 1.7 < beside[1] < 2.3)


def test_what_is_written_is_read_back(room: MakeRoom, tmp_path: Path) -> None:
    scenario = room(Item("box", (2.5, 3.0), (0.4, 0.6, 0.3)), start=Start((3.3, 2.0), -120.0))
    world = World(scenario, seed=4)
    world.set_drive(DriveSetting(-0.6, 0.3))
    world.advance_to(3.0)
    write_truth(world, tmp_path)
    truth = read_truth(tmp_path)
    assert truth.poses == pytest.approx(world.truth.poses(), abs=1e-4)
    assert truth.collisions == world.collisions.count > 0
    assert truth.surfaces.segments_m == pytest.approx(true_surfaces(scenario).segments_m, abs=1e-6)
    assert truth.surfaces.start == scenario.start.room_from_robot
    assert (tmp_path / "truth.tum").read_text().splitlines()[0].split()[3:6] == ["0", "0", "0"]
