"""The post-processing, on networks made by hand."""

from __future__ import annotations

import math
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from robot_app.perception.config import RefineConfig
from robot_app.perception.learner import Network
from robot_app.perception.refine import Refiner
from robot_app.perception.refinement import _kernels as kernels

LENS = np.array([457.0, 457.0, 320.0, 240.0])
STRIDE = 4
SUPPORT = (LENS, STRIDE, 0.06, 0.04)
STRAIGHT = (math.radians(160), 0.015, 0.35)
ALIKE = np.ones(2, np.float32)  # no curve is drawn finer
P_OPEN = (math.degrees(0.01), -0.95, 0.35)

Neighbours = tuple[np.ndarray, np.ndarray]


def edge_line(*corners_m: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Edge points every 5 mm along a line through `corners_m`, and the cells that they lie in."""
    pieces = [np.linspace(a, b, max(2, int(math.dist(a, b) / 0.005))) for a, b in pairwise(corners_m)]
    points = np.concatenate(pieces).astype(np.float32)
    edge_at = np.full((120, 160), -1, np.int32)
    columns = ((points[:, 0] / points[:, 2] * LENS[0] + LENS[2]) / STRIDE).astype(int)
    rows = ((points[:, 1] / points[:, 2] * LENS[1] + LENS[3]) / STRIDE).astype(int)
    edge_at[rows, columns] = np.arange(len(points))
    return points, edge_at


def chain(count: int) -> Neighbours:
    """The neighbours of nodes connected in a row."""
    linked = np.zeros((count, count), np.uint8)
    for a in range(count - 1):
        linked[a, a + 1] = linked[a + 1, a] = 1
    return neighbours(linked)


def neighbours(linked: np.ndarray) -> Neighbours:
    beside, degree = np.zeros((len(linked), kernels.MOST), np.int32), np.zeros(len(linked), np.int32)
    kernels.list_neighbours(linked, len(linked), beside, degree)
    return beside, degree


def room(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(count, np.float32), np.zeros(count, np.int32)


def nodes(*points_m: tuple[float, float, float]) -> np.ndarray:
    return np.array(points_m, np.float32)


def pairs_of(beside: np.ndarray, degree: np.ndarray) -> set[tuple[int, int]]:
    found = {(a, int(b)) for a in range(len(degree)) for b in beside[a, : degree[a]]}
    assert found == {(b, a) for a, b in found}
    return {(a, b) for a, b in found if a < b}


def test_neighbours_and_connections_say_the_same() -> None:
    rng = np.random.default_rng(1)
    upper = np.triu(rng.random((30, 30)) < 0.1, 1).astype(np.uint8)
    linked = upper + upper.T
    again = np.ones_like(linked)
    kernels.link_neighbours(*neighbours(linked), 30, again)
    np.testing.assert_array_equal(again, linked)


def test_a_node_keeps_no_more_connections_than_there_is_room_for() -> None:
    beside, degree = neighbours(np.ones((12, 12), np.uint8) - np.eye(12, dtype=np.uint8))
    assert degree.max() == kernels.MOST
    assert len(pairs_of(beside, degree)) == degree.sum() / 2


def test_an_isolated_node_is_forgotten_by_its_neighbours() -> None:
    beside, degree = chain(4)
    kernels.isolate(beside, degree, 1)
    assert pairs_of(beside, degree) == {(2, 3)}


def test_a_node_in_the_middle_of_a_straight_connection_is_removed() -> None:
    edge_m, edge_at = edge_line((-0.2, 0, 1), (0.2, 0, 1))
    node_m, linked = nodes((-0.2, 0, 1), (0, 0.005, 1), (0.2, 0, 1)), chain(3)
    kernels.reduce_straight(node_m, *linked, 3, *STRAIGHT, *SUPPORT, edge_m, edge_at, *room(3))
    assert pairs_of(*linked) == {(0, 2)}


def test_a_node_at_a_bend_of_less_than_160_degrees_stays() -> None:
    edge_m, edge_at = edge_line((-0.2, 0, 1), (0, 0.1, 1), (0.2, 0, 1))
    node_m, linked = nodes((-0.2, 0, 1), (0, 0.1, 1), (0.2, 0, 1)), chain(3)
    kernels.reduce_straight(node_m, *linked, 3, *STRAIGHT, *SUPPORT, edge_m, edge_at, *room(3))
    assert pairs_of(*linked) == {(0, 1), (1, 2)}


def test_a_gentle_curve_is_not_cut_short() -> None:
    arc = [(0.4 * math.sin(a), 0.0, 1.5 - 0.4 * math.cos(a)) for a in np.linspace(-1.2, 1.2, 13)]
    edge_m, edge_at = edge_line(*arc)
    node_m, linked = nodes(*arc), chain(13)
    kernels.reduce_straight(node_m, *linked, 13, *STRAIGHT, *SUPPORT, edge_m, edge_at, *room(13))
    for a, b in pairs_of(*linked):
        middle = (node_m[a] + node_m[b]) / 2
        assert math.hypot(middle[0], middle[2] - 1.5) > 0.36


def test_an_open_outline_is_closed_where_edges_lead() -> None:
    corners = [(-0.1, -0.1, 1.0), (0.1, -0.1, 1.0), (0.1, 0.1, 1.0), (-0.1, 0.1, 1.0)]
    edge_m, edge_at = edge_line(*corners, corners[0])
    node_m, linked = nodes(*corners), chain(4)
    curve = np.zeros(4, np.int32)
    kernels.close_loops(node_m, curve, np.zeros(1, np.int32), ALIKE, *linked, 4, *P_OPEN, *SUPPORT, edge_m, edge_at)
    assert pairs_of(*linked) == {(0, 1), (1, 2), (2, 3), (0, 3)}


def test_an_open_outline_is_not_closed_through_free_air() -> None:
    corners = [(-0.1, -0.1, 1.0), (0.1, -0.1, 1.0), (0.1, 0.1, 1.0), (-0.1, 0.1, 1.0)]
    edge_m, edge_at = edge_line(*corners)
    node_m, linked = nodes(*corners), chain(4)
    curve = np.zeros(4, np.int32)
    kernels.close_loops(node_m, curve, np.zeros(1, np.int32), ALIKE, *linked, 4, *P_OPEN, *SUPPORT, edge_m, edge_at)
    assert pairs_of(*linked) == {(0, 1), (1, 2), (2, 3)}


def test_an_open_outline_is_not_closed_to_a_curve_that_it_does_not_touch() -> None:
    corners = [(-0.1, -0.1, 1.0), (0.1, -0.1, 1.0), (0.1, 0.1, 1.0), (-0.1, 0.1, 1.0)]
    edge_m, edge_at = edge_line(*corners, corners[0])
    node_m, linked = (
        nodes(*corners),
        neighbours(np.kron(np.eye(2, dtype=np.uint8), np.array([[0, 1], [1, 0]], np.uint8))),
    )
    curve, groups = np.array([0, 0, 1, 1], np.int32), np.array([0, 1], np.int32)
    kernels.close_loops(node_m, curve, groups, ALIKE, *linked, 4, *P_OPEN, *SUPPORT, edge_m, edge_at)
    assert pairs_of(*linked) == {(0, 1), (2, 3)}


def test_a_connection_over_a_gap_goes_although_its_middle_lies_on_an_edge() -> None:
    """Equation 31 alone would keep it."""
    left, left_at = edge_line((-0.3, 0, 1), (-0.2, 0, 1))
    middle, _ = edge_line((-0.03, 0, 1), (0.03, 0, 1))
    points = np.concatenate((left, middle))
    columns = ((points[:, 0] * LENS[0] + LENS[2]) / STRIDE).astype(int)
    left_at[60, columns] = np.arange(len(points))
    node_m, linked = nodes((-0.3, 0, 1), (0.3, 0, 1)), chain(2)
    kernels.remove_unsupported(node_m, *linked, 2, *SUPPORT, points, left_at)
    assert pairs_of(*linked) == set()


def test_a_connection_behind_an_edge_in_the_same_pixels_goes() -> None:
    edge_m, edge_at = edge_line((-0.2, 0, 1), (0.2, 0, 1))
    node_m, linked = nodes((-0.4, 0, 2), (0.4, 0, 2)), chain(2)
    kernels.remove_unsupported(node_m, *linked, 2, *SUPPORT, edge_m, edge_at)
    assert pairs_of(*linked) == set()


def test_a_node_with_little_edge_around_it_is_disconnected() -> None:
    edge_m, _ = edge_line((-0.2, 0, 1), (0.2, 0, 1))
    stray = np.array([[0.9, 0, 1], [0.905, 0, 1]], np.float32)
    points = np.concatenate((edge_m, stray))
    node_m, linked = nodes((-0.1, 0, 1), (0.1, 0, 1), (0.9, 0, 1)), chain(3)
    curve, small = np.zeros(3, np.int32), np.array([0.05], np.float32)
    kernels.remove_noise(node_m, curve, small, *linked, 3, 0.2, 0.1, 4 / 457, points, len(points))
    assert pairs_of(*linked) == {(0, 1)}


def cloud_of(*corners_m: tuple[float, float, float]) -> SimpleNamespace:
    """What the refiner looks at of an EdgeCloud: one curve over nothing, a point in each cell."""
    line_m, edge_at = edge_line(*corners_m)
    edge_m = line_m[edge_at[edge_at >= 0]]
    edge_at[edge_at >= 0] = np.arange(len(edge_m))
    return SimpleNamespace(
        sample_m=edge_m, sample_curve=np.zeros(len(edge_m), np.int32), samples=len(edge_m), edge_m=edge_m,
        edges=len(edge_m), edge_at=edge_at, lens=LENS, stride=STRIDE, cell_width=STRIDE / LENS[0],
        curve_closed=np.zeros(1, np.uint8), curve_detail=np.ones(1, np.float32), curve_group=np.zeros(1, np.int32),
        curve_extent_m=np.array([math.dist(corners_m[0], corners_m[-1])], np.float32),
        z=np.zeros((120, 160), np.float32), slope_x=np.zeros(640, np.float32), slope_y=np.zeros(480, np.float32),
        up=np.array([0.0, -1.0, 0.0, 100.0]),
    )  # fmt: skip


@pytest.mark.parametrize(("length_m", "expected"), [(0.11, 0), (0.16, 2)])
def test_of_lines_that_stand_alone_short_ones_go(length_m: float, expected: int) -> None:
    ends = ((0.0, 0.0, 1.0), (length_m, 0.0, 1.0))
    network = Network(8)
    network.node_m[:2], network.nodes = ends, 2
    network.linked[0, 1] = network.linked[1, 0] = 1
    Refiner(RefineConfig(), 8, 100).refine(network, cloud_of(*ends))
    assert network.nodes == expected


def outlines_of(beside: np.ndarray, degree: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    member, start = np.zeros(len(degree), np.int32), np.zeros(len(degree) + 1, np.int32)
    return member, start, kernels.list_outlines(beside, degree, len(degree), member, start)


def test_outlines_are_the_connected_nodes() -> None:
    linked = np.zeros((7, 7), np.uint8)
    for a, b in ((0, 4), (4, 6), (1, 2), (2, 5), (5, 1)):
        linked[a, b] = linked[b, a] = 1
    member, start, count = outlines_of(*neighbours(linked))
    assert [set(member[a:b].tolist()) for a, b in pairwise(start[: count + 1])] == [{0, 4, 6}, {1, 2, 5}]


@pytest.mark.parametrize(("half_height_m", "expected"), [(0.01, {(0, 5)}), (0.05, set(pairwise(range(6))))])
def test_a_zigzag_across_a_slot_becomes_a_line_and_one_across_a_face_stays(half_height_m: float, expected) -> None:
    zigzag = [(-0.25 + 0.1 * k, half_height_m * (-1) ** k, 1.0) for k in range(6)]
    edge_m, edge_at = edge_line(*zigzag)
    node_m, linked = nodes(*zigzag), chain(6)
    kernels.flatten_narrow(node_m, *linked, *outlines_of(*linked), 4.0, *SUPPORT, edge_m, edge_at)
    assert pairs_of(*linked) == expected


def test_the_outlines_that_look_largest_are_kept_while_there_is_room() -> None:
    near, far = (-0.1, 0.0, 0.5), (-0.15, 0.0, 3.0)
    node_m = nodes(near, (0.1, 0.0, 0.5), far, (0.15, 0.0, 3.0), (-1.0, 0.5, 2.0), (1.0, 0.5, 2.0))
    linked = neighbours(np.kron(np.eye(3, dtype=np.uint8), np.array([[0, 1], [1, 0]], np.uint8)))
    kernels.keep_important(node_m, *linked, *outlines_of(*linked), 4, np.zeros(6, np.float32))
    assert pairs_of(*linked) == {(0, 1), (4, 5)}


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
