"""Steps 2-7 and the post-processing, on networks made by hand."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from robot_app.perception.learners.simplified import _kernels as growth
from robot_app.perception.network import _kernels as network
from robot_app.perception.refinement import _kernels as kernels

LENS = np.array([457.0, 457.0, 320.0, 240.0])
STRIDE = 4
SUPPORT = (LENS, STRIDE, 0.06, 0.04)


def edge_line(*corners_m: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Edge points every 5 mm along a line through `corners_m`, and the cells that they lie in."""
    pieces = [np.linspace(a, b, max(2, int(math.dist(a, b) / 0.005))) for a, b in pairwise(corners_m)]
    points = np.concatenate(pieces).astype(np.float32)
    edge_at = np.full((120, 160), -1, np.int32)
    columns = ((points[:, 0] / points[:, 2] * LENS[0] + LENS[2]) / STRIDE).astype(int)
    rows = ((points[:, 1] / points[:, 2] * LENS[1] + LENS[3]) / STRIDE).astype(int)
    edge_at[rows, columns] = np.arange(len(points))
    return points, edge_at


def linked_chain(count: int) -> np.ndarray:
    linked = np.zeros((count, count), np.uint8)
    for a in range(count - 1):
        linked[a, a + 1] = linked[a + 1, a] = 1
    return linked


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


def test_a_node_in_the_middle_of_a_straight_connection_is_removed() -> None:
    edge_m, edge_at = edge_line((-0.2, 0, 1), (0.2, 0, 1))
    node_m, linked = nodes((-0.2, 0, 1), (0, 0.005, 1), (0.2, 0, 1)), linked_chain(3)
    kernels.reduce_straight(node_m, linked, 3, math.radians(160), 0.015, 0.35, *SUPPORT, edge_m, edge_at)
    assert pairs_of(linked) == {(0, 2)}


def test_a_node_at_a_bend_of_less_than_160_degrees_stays() -> None:
    edge_m, edge_at = edge_line((-0.2, 0, 1), (0, 0.1, 1), (0.2, 0, 1))
    node_m, linked = nodes((-0.2, 0, 1), (0, 0.1, 1), (0.2, 0, 1)), linked_chain(3)
    kernels.reduce_straight(node_m, linked, 3, math.radians(160), 0.015, 0.35, *SUPPORT, edge_m, edge_at)
    assert pairs_of(linked) == {(0, 1), (1, 2)}


def test_a_gentle_curve_is_not_cut_short() -> None:
    arc = [(0.4 * math.sin(a), 0.0, 1.5 - 0.4 * math.cos(a)) for a in np.linspace(-1.2, 1.2, 13)]
    edge_m, edge_at = edge_line(*arc)
    node_m, linked = nodes(*arc), linked_chain(13)
    kernels.reduce_straight(node_m, linked, 13, math.radians(160), 0.015, 0.35, *SUPPORT, edge_m, edge_at)
    for a, b in pairs_of(linked):
        middle = (node_m[a] + node_m[b]) / 2
        assert math.hypot(middle[0], middle[2] - 1.5) > 0.36


def test_an_open_outline_is_closed_where_edges_lead() -> None:
    corners = [(-0.1, -0.1, 1.0), (0.1, -0.1, 1.0), (0.1, 0.1, 1.0), (-0.1, 0.1, 1.0)]
    edge_m, edge_at = edge_line(*corners, corners[0])
    node_m, linked = nodes(*corners), linked_chain(4)
    curve = np.zeros(4, np.int32)
    kernels.close_loops(node_m, curve, linked, 4, math.degrees(0.01), -0.95, 0.35, *SUPPORT, edge_m, edge_at)
    assert pairs_of(linked) == {(0, 1), (1, 2), (2, 3), (0, 3)}


def test_an_open_outline_is_not_closed_through_free_air() -> None:
    corners = [(-0.1, -0.1, 1.0), (0.1, -0.1, 1.0), (0.1, 0.1, 1.0), (-0.1, 0.1, 1.0)]
    edge_m, edge_at = edge_line(*corners)
    node_m, linked = nodes(*corners), linked_chain(4)
    curve = np.zeros(4, np.int32)
    kernels.close_loops(node_m, curve, linked, 4, math.degrees(0.01), -0.95, 0.35, *SUPPORT, edge_m, edge_at)
    assert pairs_of(linked) == {(0, 1), (1, 2), (2, 3)}


def test_a_connection_over_a_gap_goes_although_its_middle_lies_on_an_edge() -> None:
    """Equation 31 alone would keep it."""
    left, left_at = edge_line((-0.3, 0, 1), (-0.2, 0, 1))
    middle, _ = edge_line((-0.03, 0, 1), (0.03, 0, 1))
    points = np.concatenate((left, middle))
    columns = ((points[:, 0] * LENS[0] + LENS[2]) / STRIDE).astype(int)
    left_at[60, columns] = np.arange(len(points))
    node_m, linked = nodes((-0.3, 0, 1), (0.3, 0, 1)), linked_chain(2)
    kernels.remove_unsupported(node_m, linked, 2, *SUPPORT, points, left_at)
    assert pairs_of(linked) == set()


def test_a_connection_behind_an_edge_in_the_same_pixels_goes() -> None:
    edge_m, edge_at = edge_line((-0.2, 0, 1), (0.2, 0, 1))
    node_m, linked = nodes((-0.4, 0, 2), (0.4, 0, 2)), linked_chain(2)
    kernels.remove_unsupported(node_m, linked, 2, *SUPPORT, edge_m, edge_at)
    assert pairs_of(linked) == set()


def test_a_node_with_little_edge_around_it_is_disconnected() -> None:
    edge_m, _ = edge_line((-0.2, 0, 1), (0.2, 0, 1))
    stray = np.array([[0.9, 0, 1], [0.905, 0, 1]], np.float32)
    points = np.concatenate((edge_m, stray))
    node_m, linked = nodes((-0.1, 0, 1), (0.1, 0, 1), (0.9, 0, 1)), linked_chain(3)
    kernels.remove_noise(node_m, linked, 3, 0.2, 0.1, 4 / 457, points, len(points))
    assert pairs_of(linked) == {(0, 1)}


@pytest.mark.parametrize(("height_m", "expected"), [(0.0, True), (0.1, False)])
def test_a_node_is_ground_when_no_point_is_above_or_below_it(height_m: float, expected: bool) -> None:
    z = np.zeros((120, 160), np.float32)
    slope_x = ((np.arange(640) + 0.5 - 320) / 457).astype(np.float32)
    slope_y = ((np.arange(480) + 0.5 - 240) / 457).astype(np.float32)
    z[70:80, 75:85] = np.float32(0.17) / slope_y[2 + 4 * np.arange(70, 80)][:, None]  # a floor 0.17 m below the camera
    depth_m = float(z[75, 80])
    if height_m > 0:
        z[60:76, 78:83] = depth_m
    node_m = nodes((0.0, 0.17, depth_m))
    up = np.array([0.0, -1.0, 0.0, 0.17])
    assert kernels.is_ground(node_m, 0, z, slope_x, slope_y, LENS, STRIDE, up, 0.08, 0.035) is expected
