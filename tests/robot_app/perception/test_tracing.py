"""Edge points threaded onto curves."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from robot_app.perception.config import EdgeConfig
from robot_app.perception.curves.tracer import CurveTracer

LENS = np.array([457.0, 457.0, 320.0, 240.0])
STRIDE = 4
CELL_WIDTH = STRIDE / 457.0
ROWS, COLUMNS = 120, 160
CROWD = np.zeros((33, 43), np.int32)  # a quiet neighbourhood
EMPTY = np.zeros((ROWS, COLUMNS), np.float32)  # no surface

Points = list[tuple[float, float, float]]


def cells_of(points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One edge point for each cell, in the order that they come."""
    edge_at = np.full((ROWS, COLUMNS), -1, np.int32)
    kept = []
    for x, y, z in points_m:
        i, j = int((y / z * LENS[1] + LENS[3]) / STRIDE), int((x / z * LENS[0] + LENS[2]) / STRIDE)
        if 0 <= i < ROWS and 0 <= j < COLUMNS and edge_at[i, j] < 0:
            edge_at[i, j] = len(kept)
            kept.append((x, y, z))
    edge_m = np.zeros((ROWS * COLUMNS, 3), np.float32)
    edge_m[: len(kept)] = np.array(kept).reshape(-1, 3)
    return edge_m, edge_at


def line(*corners_m: tuple[float, float, float]) -> np.ndarray:
    pieces = [np.linspace(a, b, max(2, int(math.dist(a, b) / 0.002))) for a, b in pairwise(corners_m)]
    return np.concatenate(pieces)


def traced(*lines_m: np.ndarray, config: EdgeConfig | None = None) -> CurveTracer:
    tracer = CurveTracer(config or EdgeConfig(), ROWS, COLUMNS)
    tracer.update(*cells_of(np.concatenate(lines_m)), CROWD, EMPTY, LENS, STRIDE, CELL_WIDTH)
    return tracer


def samples_of(tracer: CurveTracer) -> np.ndarray:
    return tracer.sample_m[: tracer.samples]


def large_curves(tracer: CurveTracer) -> int:
    return int((tracer.extent_m[: tracer.curves] > 0.1).sum())


SQUARE: Points = [(-0.2, -0.2, 1.0), (0.2, -0.2, 1.0), (0.2, 0.2, 1.0), (-0.2, 0.2, 1.0)]


@pytest.mark.parametrize("turn_rad", [0.0, 0.1, 0.3, 0.785, 1.2])
def test_an_outline_is_one_curve_whatever_its_direction_in_the_image(turn_rad: float) -> None:
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    corners = [(c * x - s * y, s * x + c * y, z) for x, y, z in SQUARE]
    assert large_curves(traced(line(*corners, corners[0]))) == 1


def test_the_corners_of_an_outline_are_samples_and_weigh_most() -> None:
    tracer = traced(line(*SQUARE, SQUARE[0]))
    heavy = samples_of(tracer)[tracer.sample_weight[: tracer.samples] > 0.6 * tracer.sample_weight.max()]
    for corner in SQUARE:
        assert np.linalg.norm(heavy - corner, axis=1).min() < 0.012
    assert max(np.linalg.norm(np.array(SQUARE) - point, axis=1).min() for point in heavy) < 0.03


def test_samples_lie_at_equal_distances_along_an_edge() -> None:
    tracer = traced(line((-0.4, 0.0, 1.0), (0.4, 0.1, 1.0)))
    gaps = np.linalg.norm(np.diff(samples_of(tracer), axis=0), axis=1)
    assert 20 < tracer.samples < 45
    assert gaps.min() > 0.005
    assert gaps.max() < 0.04


def test_an_edge_that_ends_behind_another_is_a_curve_by_itself() -> None:
    tracer = traced(line((-0.3, 0.0, 1.0), (0.3, 0.0, 1.0)), line((0.0, -0.4, 1.3), (0.0, -0.02, 1.3)))
    assert large_curves(tracer) == 2
    curves = np.unique(tracer.sample_curve[: tracer.samples])
    assert len({int(tracer.group[k]) for k in curves}) == 2


def test_an_edge_that_ends_on_another_belongs_to_its_group() -> None:
    tracer = traced(line((-0.3, 0.0, 1.0), (0.3, 0.0, 1.0)), line((0.0, -0.4, 1.0), (0.0, -0.01, 1.0)))
    curves = np.unique(tracer.sample_curve[: tracer.samples])
    assert len(curves) == 2
    assert len({int(tracer.group[k]) for k in curves}) == 1


def test_an_edge_goes_on_across_a_small_gap() -> None:
    tracer = traced(line((-0.3, 0.0, 1.0), (-0.02, 0.0, 1.0)), line((0.01, 0.0, 1.0), (0.3, 0.0, 1.0)))
    assert large_curves(tracer) == 1


def test_two_parallel_edges_are_two_curves() -> None:
    tracer = traced(line((-0.3, 0.0, 1.0), (0.3, 0.0, 1.0)), line((-0.3, 0.04, 1.0), (0.3, 0.04, 1.0)))
    assert large_curves(tracer) == 2


def test_a_few_stray_points_give_no_samples() -> None:
    rng = np.random.default_rng(1)
    stray = np.column_stack((rng.uniform(-0.5, 0.5, (40, 2)), rng.uniform(0.9, 3.0, 40)))
    assert traced(stray).samples == 0


def test_the_nodes_of_a_small_outline_may_lie_closer() -> None:
    small = [(0.2 * x, 0.2 * y, z) for x, y, z in SQUARE]
    assert traced(line(*SQUARE, SQUARE[0])).detail[0] == pytest.approx(1.0)
    tracer = traced(line(*small, small[0]))
    assert tracer.samples > 4
    assert tracer.detail[0] > 3.0


def test_samples_stay_within_their_bound_and_reach_all_curves() -> None:
    edges = [line((-0.6, y, 1.0), (0.6, y, 1.0)) for y in np.linspace(-0.4, 0.4, 10)]
    tracer = traced(*edges, config=EdgeConfig(max_samples=120))
    assert 60 < tracer.samples <= 120
    assert len(np.unique(tracer.sample_curve[: tracer.samples])) == 10


def test_no_edges_give_no_samples_after_some() -> None:
    tracer = traced(line(*SQUARE))
    tracer.update(*cells_of(np.zeros((0, 3))), CROWD, EMPTY, LENS, STRIDE, CELL_WIDTH)
    assert tracer.samples == 0
    assert tracer.curves == 0


def test_every_cell_an_edge_stays_within_memory() -> None:
    rng = np.random.default_rng(1)
    rows, columns = np.mgrid[0:ROWS, 0:COLUMNS] * STRIDE + 2.0
    z = rng.uniform(0.6, 8.0, (ROWS, COLUMNS))
    points = np.stack(((columns - LENS[2]) / LENS[0] * z, (rows - LENS[3]) / LENS[1] * z, z), axis=-1)
    for flat in (points.reshape(-1, 3), (points / z[..., None]).reshape(-1, 3)):
        tracer = traced(flat)
        assert tracer.samples <= EdgeConfig().max_samples
        assert np.isfinite(samples_of(tracer)).all()


def test_short_pieces_among_some_points_are_dropped_and_the_others_stay() -> None:
    long, short = line((-0.3, 0.1, 1.0), (0.3, 0.1, 1.0)), line((-0.05, -0.1, 1.0), (0.05, -0.1, 1.0))
    edge_m, edge_at = cells_of(np.concatenate((short, long, short - np.array([0.0, 0.1, 0.0]))))
    shorts = len(np.unique(edge_at[edge_at >= 0])) - len(cells_at(long))
    first = shorts // 2
    tracer = CurveTracer(EdgeConfig(min_contact_m=0.25), ROWS, COLUMNS)
    tracer.drop_short(edge_m, edge_at, first, int(edge_at.max()) + 1, LENS, STRIDE, CELL_WIDTH)
    left = np.sort(edge_at[edge_at >= 0])
    np.testing.assert_array_equal(left, np.arange(first + len(cells_at(long))))


def cells_at(points_m: np.ndarray) -> np.ndarray:
    edge_at = cells_of(points_m)[1]
    return edge_at[edge_at >= 0]
