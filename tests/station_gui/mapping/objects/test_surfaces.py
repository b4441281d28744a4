from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.objects.config import ReferenceConfig, SurfaceConfig
from station_gui.mapping.objects.fusing.fused_edges import Edges
from station_gui.mapping.objects.ransac.ransac import LineFitter
from station_gui.mapping.objects.surfaces import ObjectBuilder
from station_gui.mapping.snapshot import ObjectKind, ObjectMap

CELL_M = 0.02
NO_LINES = np.zeros((0, 2, 2))


def build(edges: Edges, cells_m: NDArray[np.float64], lines_m: NDArray[np.float64] = NO_LINES) -> ObjectMap:
    fitter = LineFitter(ReferenceConfig(), np.random.default_rng(1))
    return ObjectBuilder(SurfaceConfig(), ReferenceConfig(), fitter).build(edges, lines_m, cells_m, CELL_M)


def edges_of(posts: list[list[float]], rails: list[list[float]]) -> Edges:
    """Posts as x, y, bottom, top; rails as x0, y0, x1, y1, height."""
    ends = [[[x, y, low], [x, y, high]] for x, y, low, high in posts]
    ends += [[[x0, y0, z], [x1, y1, z]] for x0, y0, x1, y1, z in rails]
    upright = np.arange(len(ends)) < len(posts)
    return Edges(np.array(ends, np.float64).reshape(-1, 2, 3), upright, np.full(len(ends), 5))


def cells_along(*segments: tuple[float, float, float, float]) -> NDArray[np.float64]:
    pieces = [
        np.linspace((x0, y0), (x1, y1), 1 + round(np.hypot(x1 - x0, y1 - y0) / CELL_M)) for x0, y0, x1, y1 in segments
    ]
    return np.concatenate(pieces)


BOX = edges_of(
    posts=[[0, 0, 0.01, 0.41], [0.6, 0, 0.02, 0.40], [0.6, 0.4, 0.0, 0.40]],
    rails=[[0.02, 0, 0.59, 0, 0.40], [0.6, 0.01, 0.6, 0.39, 0.40]],
)
BOX_CELLS = cells_along((0, 0, 0.6, 0), (0.6, 0.02, 0.6, 0.4))


def test_a_box_has_two_fronts_and_a_top_and_is_one_object() -> None:
    made = build(BOX, BOX_CELLS)
    assert set(made.cluster.tolist()) == {0}
    assert set(made.kind.tolist()) == {ObjectKind.SMALL}
    corners = made.panels.corners_m[made.panels.kind != ObjectKind.FLAT]
    level = np.ptp(corners[:, :, 2], axis=1) < 1e-6
    assert level.tolist() == [False, False, True]
    assert corners[:, :, 2].max() == pytest.approx(0.40, abs=0.01)
    np.testing.assert_allclose(np.sort(corners[2, :, 0]), [0.0, 0.0, 0.6, 0.6], atol=0.02)


def test_the_ends_of_edges_meet() -> None:
    made = build(BOX, BOX_CELLS)
    front = made.segments_m[3]
    np.testing.assert_allclose(front, [[0, 0, 0.40], [0.6, 0, 0.40]], atol=1e-6)
    assert made.segments_m[0, :, 2] == pytest.approx([0.0, 0.40])


def test_a_table_is_a_top_on_legs() -> None:
    legs = [[x, y, 0.0, 0.70] for x, y in ((0, 0), (1.2, 0), (1.2, 0.8))]
    made = build(edges_of(legs, [[0, 0, 1.2, 0, 0.72], [1.2, 0, 1.2, 0.8, 0.72]]), np.zeros((0, 2)))
    assert len(made.panels.corners_m) == 1
    np.testing.assert_allclose(made.panels.corners_m[0, :, 2], 0.72, atol=1e-6)
    assert set(made.cluster.tolist()) == {0}
    assert set(made.kind.tolist()) == {ObjectKind.LARGE}


def test_boxes_of_other_heights_that_stand_side_by_side_are_two_objects() -> None:
    posts = [[0, 0, 0, 0.3], [0.5, 0, 0, 0.6], [1.0, 0, 0, 0.6]]
    made = build(edges_of(posts, [[0, 0, 0.5, 0, 0.3], [0.5, 0, 1.0, 0, 0.6]]), cells_along((0, 0, 1.0, 0)))
    heights = np.unique(made.panels.corners_m[:, :, 2].max(axis=1).round(2))
    assert heights.tolist() == pytest.approx([0.3, 0.6])
    assert len(set(made.panels.cluster.tolist())) == 2


def test_a_front_goes_on_to_where_the_level_edge_over_it_ends() -> None:
    made = build(edges_of([[0, 0, 0, 0.6]], [[0, 0, 1.0, 0, 0.6]]), cells_along((0, 0, 0.9, 0)))
    upright_m = made.segments_m[np.ptp(made.segments_m[:, :, 2], axis=1) > 0.5]
    assert sorted(upright_m[:, 0, 0].tolist()) == pytest.approx([0.0, 1.0], abs=0.01)


def test_two_upright_edges_make_a_front_but_no_edge_that_was_not_seen_joins_their_tops() -> None:
    made = build(edges_of([[0, 0, 0, 1.1], [1.6, 0, 0, 1.0]], []), cells_along((0, 0, 1.6, 0)))
    assert (made.panels.kind != ObjectKind.FLAT).sum() == 1
    assert made.panels.corners_m[0, :, 2].max() == pytest.approx(1.0)
    level_m = made.segments_m[np.ptp(made.segments_m[:, :, 2], axis=1) < 0.1]
    assert len(level_m) == 1
    np.testing.assert_allclose(level_m[0, :, 2], 0.0, atol=1e-6)


def test_walls_that_no_camera_saw_are_flat() -> None:
    made = build(edges_of([], []), cells_along((0, 0, 3.0, 0), (0, 0.1, 0, 2.0)))
    assert set(made.panels.kind.tolist()) == {ObjectKind.FLAT}
    assert len(made.segments_m) == 0
    lengths = np.linalg.norm(made.panels.corners_m[:, 1] - made.panels.corners_m[:, 0], axis=1)
    assert sorted(lengths.tolist()) == pytest.approx([1.9, 3.0], abs=0.1)


def test_a_map_of_nothing_has_nothing() -> None:
    made = build(edges_of([], []), np.zeros((0, 2)))
    assert len(made.segments_m) == len(made.panels.corners_m) == 0


def test_the_same_things_give_the_same_map_bit_for_bit_and_nothing_is_remembered() -> None:
    fitter = LineFitter(ReferenceConfig(), np.random.default_rng(1))
    builder = ObjectBuilder(SurfaceConfig(), ReferenceConfig(), fitter)
    builder.build(edges_of([], []), NO_LINES, cells_along((0, 0, 3.0, 0)), CELL_M)
    again = builder.build(BOX, NO_LINES, BOX_CELLS, CELL_M)
    fresh = build(BOX, BOX_CELLS)
    np.testing.assert_array_equal(again.segments_m, fresh.segments_m)
    np.testing.assert_array_equal(again.panels.corners_m, fresh.panels.corners_m)


def test_a_map_that_grew_is_the_same_as_one_that_was_made_at_once() -> None:
    fitter = LineFitter(ReferenceConfig(), np.random.default_rng(1))
    builder = ObjectBuilder(SurfaceConfig(), ReferenceConfig(), fitter)
    wall, more = cells_along((-1.0, 0, 0.6, 0)), cells_along((0.6, 0.02, 0.6, 0.4), (2.0, 0, 2.0, 1.3))
    lines = np.array([[[-1.0, 0.0], [0.6, 0.0]]])
    one_post = edges_of([[0, 0, 0.01, 0.41]], [])
    builder.build(one_post, lines, wall, CELL_M)
    builder.build(BOX, lines, wall, CELL_M)
    grown, fresh = (
        each.build(BOX, lines, np.concatenate((wall, more)), CELL_M)
        for each in (builder, ObjectBuilder(SurfaceConfig(), ReferenceConfig(), fitter))
    )
    for a, b in zip(
        (grown.segments_m, grown.cluster, grown.panels.corners_m, grown.panels.kind),
        (fresh.segments_m, fresh.cluster, fresh.panels.corners_m, fresh.panels.kind),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)
