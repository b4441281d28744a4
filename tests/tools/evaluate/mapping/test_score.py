from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.snapshot import ObjectMap
from tools.evaluate.mapping.edges import SeenThings
from tools.evaluate.mapping.score import object_error, sampled
from tools.evaluate.mapping.world import TrueWorld

FloatArray = NDArray[np.float64]
Outline = Callable[..., FloatArray]
MakeMap = Callable[..., ObjectMap]

BOX = ((3.0, 3.0), (0.4, 0.6, 0.5))
SMALL = ((4.0, 4.0), (0.3, 0.3, 0.3), 30.0)


def table(outline: Outline) -> FloatArray:
    legs = [outline((x, y), (0.04, 0.04, 0.67)) for x in (1.62, 2.38) for y in (1.92, 2.48)]
    top = outline((2.0, 2.2), (0.8, 0.6, 0.7))[8:]
    return np.concatenate([*legs, top])


@pytest.fixture
def perfect(outline: Outline) -> list[FloatArray]:
    return [outline(*BOX), outline(*SMALL), table(outline)]


def test_the_true_edges_are_a_map_without_error(
    perfect: list[FloatArray], map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    error = object_error(map_of(*perfect), world, things)
    assert error.object_rmse_m < 1e-3
    assert error.edge_rmse_m < 5e-3
    assert (error.object_recall, error.phantom_objects, error.objects, error.true_objects) == (1.0, 0, 3, 3)
    assert error.height_error_m == pytest.approx(0.0, abs=0.01)
    assert error.missed == ()


def test_what_is_not_in_the_map_is_missed_by_name(
    perfect: list[FloatArray], map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    error = object_error(map_of(perfect[0], perfect[2]), world, things)
    assert error.object_recall == pytest.approx(2 / 3)
    assert error.missed == ("small",)


@pytest.mark.parametrize(("edges", "found"), [(3, True), (2, False)])
def test_a_box_is_found_by_three_of_its_four_edges(
    edges: int, found: bool, outline: Outline, map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    error = object_error(map_of(outline(*BOX)[:edges]), world, things)
    assert ("box" not in error.missed) is found


@pytest.mark.parametrize(("share", "found"), [(0.6, True), (0.4, False)])
def test_an_edge_is_found_by_half_of_its_length(
    share: float, found: bool, outline: Outline, map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    edges = outline(*BOX)[:4]
    edges[:, 1, 2] = share * 0.5 - 0.04  # 4 cm above its end a map's edge still is near
    assert ("box" not in object_error(map_of(edges), world, things).missed) is found


@pytest.mark.parametrize(("shift_m", "found"), [(0.035, True), (0.045, False)])
def test_an_edge_is_found_within_four_centimetres(
    shift_m: float, found: bool, outline: Outline, map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    error = object_error(map_of(outline(*BOX, shift_m=shift_m)[:4]), world, things)
    assert ("box" not in error.missed) is found
    if found:
        assert error.edge_rmse_m == pytest.approx(shift_m, abs=1e-3)


def test_an_edge_that_is_there_twice_counts_twice(
    outline: Outline, map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    twice = map_of(outline(*BOX)[:4], outline(*BOX, shift_m=0.03)[:4])
    error = object_error(twice, world, things)
    assert error.edge_rmse_m == pytest.approx(0.03 / math.sqrt(2), abs=1e-3)
    assert error.drawn_times == pytest.approx(2.0, abs=0.15)
    assert error.stray_edges == pytest.approx(0.0)


def test_edges_in_the_middle_of_a_face_are_stray(
    outline: Outline, map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    ring = outline(BOX[0], (0.4, 0.6, 0.25))[8:]
    error = object_error(map_of(outline(*BOX), ring), world, things)
    drawn_m = 4 * 0.5 + 3 * 2.0
    assert error.stray_edges == pytest.approx((2.0 - 8 * 0.04) / drawn_m, abs=0.02)
    assert error.drawn_times == pytest.approx(1.0, abs=0.1)


def test_lying_edges_find_no_upright_one(
    outline: Outline, map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    rings = [outline(BOX[0], (0.4, 0.6, z))[8:] for z in np.arange(0.05, 0.55, 0.05)]
    assert object_error(map_of(*rings), world, things).object_recall == 0.0


def test_the_error_is_the_distance_to_the_surfaces_and_nothing_is_left_out(
    map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    near = np.array([[[3.23, 2.8, 0.1], [3.23, 3.2, 0.1]]])  # 3 cm before a face
    inside = np.array([[[3.16, 2.8, 0.1], [3.16, 3.2, 0.1]]])  # 4 cm behind it
    assert object_error(map_of(near), world, things).object_rmse_m == pytest.approx(0.03)
    assert object_error(map_of(near, inside), world, things).object_rmse_m == pytest.approx(
        math.sqrt(0.00125), rel=1e-4
    )


def test_an_object_in_the_open_is_a_phantom_and_one_that_is_near_something_is_none(
    outline: Outline, map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    ghost, beside = outline((5.0, 2.0), (0.2, 0.2, 0.4)), outline(*BOX, shift_m=0.08)
    error = object_error(map_of(ghost, beside, outline(*SMALL)), world, things)
    assert error.phantom_objects == 1
    assert error.objects == 3


def test_what_lies_on_the_floor_in_the_open_is_a_phantom(map_of: MakeMap, world: TrueWorld, things: SeenThings) -> None:
    line = np.array([[[5.0, 2.0, 0.0], [5.0, 2.5, 0.0]]])
    assert object_error(map_of(line), world, things).phantom_objects == 1


@pytest.mark.parametrize("off_m", [-0.06, 0.05])
def test_the_height_error_is_that_of_the_found_things(
    off_m: float, perfect: list[FloatArray], outline: Outline, map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    wrong = outline(BOX[0], (0.4, 0.6, 0.5 + off_m))
    error = object_error(map_of(wrong, perfect[1]), world, things)
    assert error.height_error_m == pytest.approx(abs(off_m) / math.sqrt(2), abs=0.01)


def test_a_height_that_the_map_does_not_claim_to_know_counts_as_it_is_drawn(
    perfect: list[FloatArray], outline: Outline, map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    sides = outline(BOX[0], (0.4, 0.6, 0.4))[:4]
    error = object_error(map_of(sides, perfect[1]), world, things)
    assert error.heights_known == 0.5
    assert error.known_height_error_m == pytest.approx(0.0, abs=0.01)
    assert error.height_error_m == pytest.approx(0.1 / math.sqrt(2), abs=0.01)


def test_a_map_without_objects_misses_everything_and_has_no_error(
    map_of: MakeMap, world: TrueWorld, things: SeenThings
) -> None:
    error = object_error(map_of(), world, things)
    assert (error.object_recall, error.phantom_objects, error.objects) == (0.0, 0, 0)
    assert math.isnan(error.object_rmse_m)
    assert math.isnan(error.height_error_m)


def test_samples_are_evenly_spaced_and_know_their_segment() -> None:
    points_m, segment = sampled(np.array([[[0, 0, 0], [0.1, 0, 0]], [[1, 0, 0], [1, 0, 0.001]]]), 0.02)
    assert points_m[:5, 0].tolist() == pytest.approx([0.01, 0.03, 0.05, 0.07, 0.09])
    assert segment.tolist() == [0, 0, 0, 0, 0, 1]
