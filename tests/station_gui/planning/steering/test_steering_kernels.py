"""The ways of Reeds and Shepp: each ends where it should, and the shortest is the shortest."""

import math

import numpy as np
import pytest

from shared.geometry.se2 import wrap_angle
from station_gui.planning.steering import _kernels


def _end(elements: np.ndarray, pose: np.ndarray) -> np.ndarray:
    at = pose.copy()
    for curvature, length in elements:
        _kernels.advance(at, curvature, length)
    return at


def _length(table: np.ndarray, count: int) -> float:
    return float(np.abs(table[:count, :, 1]).sum(axis=1).min())


def test_every_way_ends_at_the_goal() -> None:
    generator, table = np.random.default_rng(3), np.empty((44, 5, 2))
    for _ in range(300):
        start, goal = generator.uniform(-2, 2, 3), generator.uniform(-2, 2, 3)
        count = _kernels.ways(start, goal, 2.0, table)
        assert count >= 2
        for k in range(count):
            end = _end(table[k], start)
            np.testing.assert_allclose(end[:2], goal[:2], atol=1e-6)
            assert abs(wrap_angle(end[2] - goal[2])) < 1e-6
            assert set(np.round(np.abs(table[k, :, 0]), 9)) <= {0.0, 2.0}


# x, y and heading in circles of radius 1; lengths by another implementation of the paper.
@pytest.mark.parametrize(
    ("x", "y", "phi", "length"), [(3.0, 0.0, 0.0, 3.0), (-2.0, 0.0, 0.0, 2.0), (0.0, 0.0, math.pi, math.pi)]
)
def test_the_shortest_way_is_as_short_as_it_can_be(x: float, y: float, phi: float, length: float) -> None:
    table = np.empty((44, 5, 2))
    count = _kernels.words(x, y, phi, table)
    assert _length(table, count) == pytest.approx(length, abs=1e-9)


def test_the_shortest_way_is_as_long_there_as_back_and_never_longer_than_over_a_third_pose() -> None:
    generator, table = np.random.default_rng(5), np.empty((44, 5, 2))

    def shortest(a: np.ndarray, b: np.ndarray) -> float:
        return _length(table, _kernels.ways(a, b, 1.0, table))

    for _ in range(500):
        a, b, c = generator.uniform(-2, 2, (3, 3))
        assert shortest(a, b) == pytest.approx(shortest(b, a), abs=1e-6)
        assert shortest(a, b) <= shortest(a, c) + shortest(c, b) + 1e-6
        assert shortest(a, b) >= math.dist(a[:2], b[:2]) - 1e-9


def test_a_way_to_a_point_ends_there_with_one_turn() -> None:
    generator, table = np.random.default_rng(4), np.empty((44, 5, 2))
    for _ in range(200):
        start, goal = generator.uniform(-2, 2, 3), generator.uniform(-2, 2, 3)
        for k in range(_kernels.ways_to_point(start, goal, 2.0, table)):
            np.testing.assert_allclose(_end(table[k], start)[:2], goal[:2], atol=1e-6)
            assert not table[k, 2:].any()


def test_a_cusp_costs_and_the_standing_start_does_not() -> None:
    costs = np.array([1.6, 0.3, 0.03, 2.0, 2.0])
    assert _kernels.change_cost(costs, 0.0, 0.0, 2.0, 1.0) == 0.0
    assert _kernels.change_cost(costs, 2.0, 1.0, 2.0, 1.0) == 0.0
    assert _kernels.change_cost(costs, 2.0, 1.0, -2.0, -1.0) == pytest.approx(0.3 + 0.06)
    way = np.array([[2.0, 0.5], [0.0, 0.0], [-2.0, -0.5], [0.0, 0.0], [0.0, 0.0]])
    assert _kernels.least_cost(costs, np.zeros(2), way) == pytest.approx(0.5 + 0.36 + 0.8)
