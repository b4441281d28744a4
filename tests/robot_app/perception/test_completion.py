"""Stretches of a curve that learning has left out."""

from __future__ import annotations

import numpy as np

from robot_app.perception.completion import _kernels as kernels
from robot_app.perception.refinement import _kernels as refinement
from tests.robot_app.perception.test_refinement import LENS, STRIDE, edge_line, pairs_of

SLACK = 2.0 * STRIDE / LENS[0]
MIN_LENGTH_M = 0.1
ROOM = 12
ANGLE = ((-0.3, 0.2, 1.0), (-0.3, -0.2, 1.0), (0.3, -0.2, 1.0))  # an L of 0.4 and 0.6 m
SQUARE = ((-0.2, -0.2, 1.0), (0.2, -0.2, 1.0), (0.2, 0.2, 1.0), (-0.2, 0.2, 1.0), (-0.2, -0.2, 1.0))


class Drawn:
    """What `complete` makes of nodes and their connections on one curve through `corners_m`."""

    def __init__(self, corners_m, nodes_m, connections, closed: int = 0, detail: float = 1.0) -> None:
        edges, edge_at = edge_line(*corners_m)
        samples = edges[::4].copy()
        self.node_m = np.zeros((ROOM, 3), np.float32)
        self.node_m[: len(nodes_m)] = nodes_m
        self.beside, self.degree = np.zeros((ROOM, refinement.MOST), np.int32), np.zeros(ROOM, np.int32)
        for a, b in connections:
            refinement.connect(self.beside, self.degree, a, b)
        self.nodes = kernels.complete(
            samples, np.zeros(len(samples), np.int32), len(samples), np.array([closed], np.uint8),
            np.array([detail], np.float32), SLACK, MIN_LENGTH_M, LENS, STRIDE, 0.06, 0.04, edges, edge_at,
            self.node_m, np.zeros(ROOM, np.int32), np.zeros(ROOM, np.float32), self.beside, self.degree, len(nodes_m),
            np.zeros(ROOM, np.int32), np.zeros(ROOM, np.int32), np.zeros(len(samples), np.uint8),
            np.zeros(kernels.DEEPEST + 1, np.int32),
        )  # fmt: skip
        self.pairs = pairs_of(self.beside[: self.nodes], self.degree[: self.nodes])


def test_what_connections_follow_stays_as_it_is() -> None:
    drawn = Drawn(ANGLE, ANGLE, [(0, 1), (1, 2)])
    assert drawn.nodes == 3
    assert drawn.pairs == {(0, 1), (1, 2)}


def test_the_end_of_a_curve_without_a_node_is_drawn() -> None:
    drawn = Drawn(ANGLE, ANGLE[:2], [(0, 1)])
    assert drawn.nodes == 3
    assert drawn.pairs == {(0, 1), (1, 2)}
    assert np.linalg.norm(drawn.node_m[2] - ANGLE[2]) < 0.03


def test_a_connection_that_cuts_a_corner_gets_a_node_there() -> None:
    drawn = Drawn(ANGLE, [ANGLE[0], ANGLE[2]], [(0, 1)])
    assert drawn.nodes == 3
    assert drawn.pairs == {(0, 2), (1, 2)}
    assert np.linalg.norm(drawn.node_m[2] - ANGLE[1]) < 0.03


def test_a_gap_in_the_middle_is_drawn() -> None:
    along = [(x, 0.0, 1.0) for x in (-0.3, -0.15, 0.15, 0.3)]
    drawn = Drawn((along[0], along[-1]), along, [(0, 1), (2, 3)])
    assert drawn.nodes == 4
    assert drawn.pairs == {(0, 1), (1, 2), (2, 3)}


def test_stretches_shorter_than_the_least_connection_are_left_out_but_for_small_curves() -> None:
    straight = ((-0.3, 0.0, 1.0), (0.3, 0.0, 1.0))
    nodes_m = [(-0.3, 0.0, 1.0), (0.22, 0.0, 1.0)]
    assert Drawn(straight, nodes_m, [(0, 1)]).nodes == 2
    assert Drawn(straight, nodes_m, [(0, 1)], detail=4.0).pairs == {(0, 1), (1, 2)}


def test_a_connection_across_the_joint_of_a_loop_covers_both_ends() -> None:
    drawn = Drawn(SQUARE, SQUARE[1:4], [(0, 1), (1, 2)], closed=1)
    assert drawn.nodes == 5
    assert {(0, 1), (1, 2)} <= drawn.pairs
    assert (drawn.degree[: drawn.nodes] > 0).all()


def test_no_node_is_made_beyond_the_room_that_there_is() -> None:
    x = np.linspace(-0.6, 0.6, 40)
    saw = [(float(v), 0.1 * (-1.0) ** k, 1.0) for k, v in enumerate(x)]
    drawn = Drawn(saw, [saw[0], saw[-1]], [(0, 1)])
    assert drawn.nodes == ROOM
    assert np.isfinite(drawn.node_m).all()
