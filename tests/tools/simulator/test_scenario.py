from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from shared.config import ConfigError
from tools.evaluate._kernels import nearest_on_segments
from tools.evaluate.map_error import reachable_surface, standing_places_m
from tools.simulator.plan_view import plan_view
from tools.simulator.scenario import Goal, Item, Scenario, Start, find_scenario, scenario_names
from tools.simulator.solids import Solid, solids_of
from tools.simulator.truth import true_surfaces


def test_the_lab_has_the_size_of_the_papers_lab_and_clutter_that_the_scanner_sees() -> None:
    lab = find_scenario("lab")
    assert (lab.room.length_x_m, lab.room.width_y_m) == (3.95, 4.2)
    assert len(lab.items) >= 20
    assert all(item.size_m[2] >= 0.10 for item in lab.items)


def test_start_and_goals_of_every_scenario_can_be_reached_by_the_car() -> None:
    for name in scenario_names():
        scenario = find_scenario(name)
        places = standing_places_m(true_surfaces(scenario))
        for goal in scenario.goals:
            assert np.hypot(*(places - goal.position_m).T).min() < 0.05


def test_the_way_round_the_lab_is_wide() -> None:
    """A disc of 0.88 m gets from the start to all four sides of the island and round it."""
    surfaces = true_surfaces(find_scenario("lab"))
    xs, ys = np.meshgrid(np.arange(0.01, 3.95, 0.02), np.arange(0.01, 4.2, 0.02))
    points = np.column_stack((xs.ravel(), ys.ravel()))
    foot, distance = np.empty_like(points), np.empty(len(points))
    nearest_on_segments(points, surfaces.segments_m, foot, distance)
    label = ndimage.label((distance > 0.44).reshape(xs.shape))[0].ravel()
    sides = ((2.0, 0.98), (3.0, 2.1), (2.0, 3.2), (0.87, 2.1))
    passages = {_label_near(points, label, side) for side in sides}
    assert len(passages) == 1
    for row_cut in (slice(0, 80), slice(140, None)):  # with either end blocked the other still joins both sides
        blocked = label.reshape(xs.shape).copy()
        blocked[row_cut, 95:100] = 0
        again = ndimage.label(blocked > 0)[0].ravel()
        assert _label_near(points, again, sides[1]) == _label_near(points, again, sides[3])


def _label_near(points: NDArray[np.float64], label: NDArray[np.signedinteger], place: tuple[float, float]) -> int:
    free = np.flatnonzero(label > 0)
    nearest = free[np.hypot(*(points[free] - place).T).argmin()]
    assert np.hypot(*(points[nearest] - place)) < 0.15
    return int(label[nearest])


@pytest.mark.parametrize("name", ["lab", "lab-rearranged", "flat"])
def test_no_two_things_stand_in_the_same_place(name: str) -> None:
    solids = solids_of(find_scenario(name))
    for first, second in itertools.combinations(solids, 2):
        of_one_thing = first.name.split("_")[0] == second.name.split("_")[0]
        assert of_one_thing or _overlap_m(first, second) < 1e-6, (first.name, second.name)


def _overlap_m(first: Solid, second: Solid) -> float:
    """How deep two boxes are in one another along the axis that separates them best."""
    (_, _, z1), (_, _, z2) = first.center_m, second.center_m
    overlaps = [first.half_m[2] + second.half_m[2] - abs(z1 - z2)]
    for yaw in (first.yaw_rad, second.yaw_rad):
        for axis in (yaw, yaw + np.pi / 2):
            a, b = (solid.corners_m() @ np.array([np.cos(axis), np.sin(axis)]) for solid in (first, second))
            overlaps.append(min(a.max(), b.max()) - max(a.min(), b.min()))
    return float(min(overlaps))


def test_the_rearranged_lab_is_the_lab_with_its_things_elsewhere() -> None:
    lab, rearranged = find_scenario("lab"), find_scenario("lab-rearranged")
    assert rearranged.room == lab.room
    places = {item.name: item.position_m for item in lab.items}
    assert len(rearranged.items) >= 25
    assert all(item.name in places for item in rearranged.items)
    assert all(np.hypot(*np.subtract(item.position_m, places[item.name])) > 0.1 for item in rearranged.items)


def test_the_flat_has_four_rooms_that_hang_together_by_doors_for_the_car_and_by_nothing_wider() -> None:
    flat = find_scenario("flat")
    assert flat.room.length_x_m * flat.room.width_y_m == pytest.approx(60.0)
    surfaces = true_surfaces(flat)
    xs, ys = np.meshgrid(np.arange(0.02, 10.0, 0.04), np.arange(0.02, 6.0, 0.04))
    points = np.column_stack((xs.ravel(), ys.ravel()))
    foot, distance = np.empty_like(points), np.empty(len(points))
    nearest_on_segments(points, surfaces.segments_m, foot, distance)
    rooms = ((1.8, 1.2), (7.3, 1.5), (2.0, 4.6), (7.5, 4.5))
    for radius_m, parts in ((0.36, 1), (0.43, 4)):
        label = ndimage.label((distance > radius_m).reshape(xs.shape))[0].ravel()
        assert len({_label_near(points, label, room) for room in rooms}) == parts


def test_most_of_the_labs_surface_can_be_seen() -> None:
    seen = reachable_surface(true_surfaces(find_scenario("lab")))
    assert 22.0 < len(seen.points_m) * 0.01 < 45.0


def test_a_wrong_name_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"no scenario 'lap'; known are .*lab"):
        find_scenario("lap")


def test_a_path_is_accepted_and_a_misspelt_key_is_named(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\n[start]\nposition_m = [1.0, 1.0]\n')
    assert find_scenario(str(path)).name == "mine"
    path.write_text('name = "mine"\n[start]\nposition = [1.0, 1.0]\n')
    with pytest.raises(ConfigError, match=r"mine.toml: unknown key start.position, did you mean start.position_m"):
        find_scenario(str(path))


def test_things_that_the_scanner_would_miss_are_refused() -> None:
    with pytest.raises(ValueError, match="carpet"):
        Item("carpet", (1.0, 1.0), (1.0, 1.0, 0.02))


def test_goals_are_given_in_the_frame_of_the_start_pose() -> None:
    scenario = Scenario("test", Start((1.0, 2.0), 90.0), goals=(Goal((1.0, 3.5)),))
    assert scenario.goals_in_start_frame_m()[0] == pytest.approx((1.5, 0.0))


def test_a_table_stands_on_four_legs_and_a_chair_has_a_back() -> None:
    table = Item("table", (1.0, 1.0), (0.8, 0.6, 0.7), "table")
    chair = Item("chair", (3.0, 3.0), (0.4, 0.4, 0.9), "chair")
    names = [solid.name for solid in solids_of(Scenario("test", Start((2.0, 2.0)), items=(table, chair)))]
    assert sum(name.startswith("table_leg") for name in names) == 4
    assert "chair_back" in names


def test_a_plan_has_the_rooms_proportions() -> None:
    image = plan_view(find_scenario("lab"), np.array([(1.0, 1.0), (2.0, 1.0)]), pixels_per_m=50)
    assert image.size == (round(4.35 * 150) // 3, round(4.6 * 150) // 3)


def test_a_file_may_say_only_how_it_differs_from_another_scenario(tmp_path: Path) -> None:
    lab, slippery = find_scenario("lab"), find_scenario("lab-slip")
    assert slippery.items == lab.items
    assert slippery.encoders.slip.steady == 0.05
    assert slippery.encoders.left_scale_error == lab.encoders.left_scale_error
    path = tmp_path / "mine.toml"
    path.write_text('base = "lab"\nname = "mine"\n[room]\nwall_height_m = 1.2\n')
    mine = find_scenario(str(path))
    assert (mine.name, mine.room.wall_height_m, mine.room.length_x_m) == ("mine", 1.2, lab.room.length_x_m)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('base = "lap"\n', "base must be one of .*, not 'lap'"),
        ('base = "lab"\n[room]\nhight = 2\n', r"mine.toml: unknown key room.hight"),
        ('base = "lab"\n[encoders.slip]\nwander = -0.1\n', r"mine.toml: encoders.slip: .* must not be negative"),
    ],
)
def test_a_wrong_difference_is_named(tmp_path: Path, text: str, named: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=named):
        find_scenario(str(path))
