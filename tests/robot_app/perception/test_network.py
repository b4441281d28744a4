"""Steps 2-7, on networks made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robot_app.perception.learners.simplified import _kernels as growth
from robot_app.perception.network import _kernels as network


def nodes(*points_m: tuple[float, float, float]) -> np.ndarray:
    return np.array(points_m, np.float32)


def pairs_of(linked: np.ndarray) -> set[tuple[int, int]]:
    return {(int(a), int(b)) for a, b in np.argwhere(np.triu(linked))}


@pytest.mark.parametrize(
    ("distance_m", "expected"),
    [(0.05, 0.0), (0.1, 1.0), (0.15, 1.0), (0.175, 1.0), (0.5, math.tanh(1.55 * 0.175 / 0.5))],
)
def test_the_probability_of_a_node_is_equation_12(distance_m: float, expected: float) -> None:
    assert growth.node_probability(distance_m, 0.1, 0.175, 1.55) == pytest.approx(expected)


def test_the_longest_connection_of_a_crowded_node_goes_first() -> None:
    node_m = nodes((0, 0, 1), (0.1, 0, 1), (-0.2, 0, 1), (0, 0.3, 1))
    linked = np.zeros((4, 4), np.uint8)
    linked[0, 1:] = linked[1:, 0] = 1
    growth.limit_degree(node_m, linked, 4, 2)
    assert pairs_of(linked) == {(0, 1), (0, 2)}


def test_isolated_nodes_go_and_the_others_keep_their_connections() -> None:
    node_m = nodes((9, 9, 9), (1, 0, 1), (9, 9, 9), (2, 0, 1), (3, 0, 1))
    curve = np.arange(5, dtype=np.int32)
    linked = np.zeros((5, 5), np.uint8)
    linked[1, 3] = linked[3, 1] = linked[3, 4] = linked[4, 3] = 1
    count = network.remove_isolated(node_m, curve, linked, 5)
    assert count == 3
    assert node_m[:3, 0].tolist() == [1, 2, 3]
    assert curve[:3].tolist() == [1, 3, 4]
    assert pairs_of(linked) == {(0, 1), (1, 2)}
