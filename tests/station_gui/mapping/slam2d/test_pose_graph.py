from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from station_gui.mapping.slam2d.config import PoseGraphConfig
from station_gui.mapping.slam2d.graph import _kernels
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.se2_arrays import between, compose

FloatArray = NDArray[np.float64]
_INFORMATION = np.diag((1 / 0.02**2, 1 / 0.02**2, 1 / math.radians(0.5) ** 2))


def _circle(count: int) -> FloatArray:
    angle = np.linspace(0, math.tau, count, endpoint=False)
    return np.column_stack((4 * np.sin(angle), 4 - 4 * np.cos(angle), angle))


def _noisy_circle(rng: np.random.Generator, count: int = 40) -> tuple[PoseGraph, FloatArray, list[FloatArray]]:
    """A chain of noisy steps round a circle; the loop is not closed yet."""
    truth = _circle(count)
    graph = PoseGraph(PoseGraphConfig(iterations=30))
    graph.add_node(truth[0])
    steps = []
    for k in range(1, count):
        step = between(truth[k - 1], truth[k]) + rng.normal(0, (0.02, 0.02, math.radians(0.5)))
        graph.add_node(compose(graph.poses[k - 1], step))
        graph.add_edge(k - 1, k, step, _INFORMATION, 0.6, robust=False)
        steps.append(step)
    return graph, truth, steps


def _error(graph: PoseGraph, truth: FloatArray) -> float:
    return float(np.hypot(*(graph.poses - truth)[:, :2].T).mean())


def test_a_noisy_circle_comes_to_the_optimum_that_dense_least_squares_finds() -> None:
    graph, truth, steps = _noisy_circle(np.random.default_rng(1))
    closing = between(truth[-1], truth[0])
    graph.add_edge(len(truth) - 1, 0, closing, _INFORMATION, 0.6, robust=True)
    start = graph.poses.copy()

    graph.optimise()

    expected = _dense_optimum(start, [*steps, closing])
    np.testing.assert_allclose(graph.poses, expected, atol=2e-4)


def _dense_optimum(start: FloatArray, steps: list[FloatArray]) -> FloatArray:
    root = np.sqrt(np.diag(_INFORMATION))

    def residuals(free: FloatArray) -> FloatArray:
        poses = np.vstack((start[0], free.reshape(-1, 3)))
        rows = []
        for k, step in enumerate(steps):
            error = between(poses[k], poses[(k + 1) % len(poses)]) - step
            error[2] = math.remainder(error[2], math.tau)
            rows.append(root * error)
        return np.concatenate(rows)

    found = least_squares(residuals, start[1:].ravel(), xtol=1e-12, ftol=1e-12)
    return np.vstack((start[0], found.x.reshape(-1, 3)))


def test_closing_the_loop_brings_the_nodes_nearer_to_the_truth() -> None:
    graph, truth, _ = _noisy_circle(np.random.default_rng(2))
    before = _error(graph, truth)
    graph.add_edge(len(truth) - 1, 0, between(truth[-1], truth[0]), _INFORMATION, 0.6, robust=True)
    graph.optimise()
    assert _error(graph, truth) < 0.7 * before


def test_a_false_closure_lets_go_among_true_ones() -> None:
    graph, truth, _ = _noisy_circle(np.random.default_rng(3))
    for a, b in ((39, 0), (38, 1), (30, 5)):
        graph.add_edge(a, b, between(truth[a], truth[b]), _INFORMATION, 0.6, robust=True)
    graph.optimise()
    good = graph.poses.copy()
    graph.add_edge(20, 2, np.zeros(3), _INFORMATION, 0.6, robust=True)  # 20 and 2 are 8 m apart

    graph.optimise()

    assert float(np.hypot(*(graph.poses - good)[:, :2].T).max()) < 0.05


def test_a_loop_that_is_far_open_is_closed() -> None:
    """Dynamic covariance scaling alone would switch the closure off for good."""
    truth = _circle(200)
    graph = PoseGraph(PoseGraphConfig())
    graph.add_node(truth[0])
    for k in range(1, len(truth)):
        step = between(truth[k - 1], truth[k]) + np.array([0.0, 0.0, math.radians(0.1)])  # a drift of 20 degrees
        graph.add_node(compose(graph.poses[k - 1], step))
        graph.add_edge(k - 1, k, step, _INFORMATION, 0.13, robust=False)
    for a, b in ((199, 0), (198, 1)):
        graph.add_edge(a, b, between(truth[a], truth[b]), _INFORMATION, 0.6, robust=True)
    graph.optimise()
    assert float(np.hypot(*(graph.poses[-1] - truth[-1])[:2])) < 0.02


def test_nodes_that_come_during_an_optimisation_follow_the_last_one_in_it() -> None:
    graph, truth, _ = _noisy_circle(np.random.default_rng(4))
    graph.add_edge(39, 0, between(truth[39], truth[0]), _INFORMATION, 0.6, robust=True)
    graph.begin_optimisation()
    assert not graph.step(units=100)
    step = np.array([0.3, 0.1, 0.2])
    graph.add_node(compose(graph.poses[39], step))
    graph.add_edge(39, 40, step, _INFORMATION, 0.3, robust=False)
    while graph.optimising:
        graph.step(units=100)
    np.testing.assert_allclose(between(graph.poses[39], graph.poses[40]), step, atol=1e-12)


def test_the_jacobian_is_the_slope_of_the_edge_error() -> None:
    poses = np.array([[0.3, -0.4, 0.9], [1.2, 0.5, -2.0]])
    measured = np.array([0.5, 0.5, 0.1])
    jacobian = np.zeros((3, 6))
    _kernels._jacobian(poses, 0, 1, jacobian)
    for column in range(6):
        moved = [poses.copy(), poses.copy()]
        errors = [np.zeros(3), np.zeros(3)]
        for sign, pose, error in zip((1, -1), moved, errors, strict=True):
            pose[column // 3, column % 3] += sign * 1e-6
            _kernels.edge_error(pose, 0, 1, measured, error)
        np.testing.assert_allclose(jacobian[:, column], (errors[0] - errors[1]) / 2e-6, atol=1e-8)


def test_distances_follow_the_edges() -> None:
    graph, _, _ = _noisy_circle(np.random.default_rng(5), count=5)
    np.testing.assert_allclose(graph.distances_m(1), [0.6, 0.0, 0.6, 1.2, 1.8])
    assert graph.distances_m(1, limit_m=1.0)[4] == np.inf


@pytest.mark.parametrize("nodes", [0, 1])
def test_a_graph_without_edges_has_nothing_to_optimise(nodes: int) -> None:
    graph = PoseGraph(PoseGraphConfig())
    for _ in range(nodes):
        graph.add_node(np.zeros(3))
    graph.optimise()
    assert len(graph.poses) == nodes
