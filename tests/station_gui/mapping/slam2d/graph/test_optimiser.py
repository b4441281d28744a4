from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from station_gui.mapping.slam2d.config import PoseGraphConfig
from station_gui.mapping.slam2d.graph import _kernels
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph

FloatArray = NDArray[np.float64]
TownMaker = Callable[[int], PoseGraph]


def _gauss_newton_step(graph: PoseGraph) -> FloatArray:
    """Numpy and SuperLU: where all nodes go in one step, closures at their full weight."""
    poses, size = graph.poses, 3 * graph.nodes
    rows, columns, values, gradient = [], [], [], np.zeros(size)
    error, jacobian = np.zeros(3), np.zeros((3, 6))
    for e, (i, j) in enumerate(graph.ends.tolist()):
        _kernels.edge_error(poses, i, j, graph.measured[e], error)
        _kernels._jacobian(poses, i, j, jacobian)
        index = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        gradient[index] += jacobian.T @ graph.information[e] @ error
        rows.append(np.repeat(index, 6))
        columns.append(np.tile(index, 6))
        values.append((jacobian.T @ graph.information[e] @ jacobian).ravel())
    whole = csc_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(size, size))
    change = splu(whole[3:, 3:].tocsc()).solve(-gradient[3:])
    return poses + np.concatenate((np.zeros(3), change)).reshape(-1, 3)


def test_one_step_is_the_one_that_superlu_makes(town: TownMaker) -> None:
    graph = town(600)
    graph._config = graph._optimiser._config = PoseGraphConfig(iterations=1)
    expected = _gauss_newton_step(graph)
    graph.optimise()
    np.testing.assert_allclose(graph.poses, expected, rtol=0, atol=1e-9)


def test_shares_of_any_size_give_the_same_poses_bit_for_bit(town: TownMaker) -> None:
    at_once, in_shares = town(300), town(300)
    at_once.optimise()
    in_shares.begin_optimisation()
    while in_shares.optimising:
        in_shares.step(units=97)
    assert at_once.poses.tobytes() == in_shares.poses.tobytes()


@pytest.mark.parametrize("nodes", [300, 6000])
def test_the_work_of_a_step_does_not_grow_with_the_graph(town: TownMaker, nodes: int) -> None:
    graph = town(nodes)
    share, works = graph._optimiser.share, []
    graph.begin_optimisation()
    while graph.optimising:
        before = share.done
        graph.step()
        works.append(share.done - before)
    allowed = PoseGraphConfig().blocks_per_step
    assert max(works) < 1.1 * allowed
    assert np.mean(works[:-1]) > 0.99 * allowed


def test_an_optimisation_says_how_far_nodes_moved(town: TownMaker) -> None:
    graph = town(300)
    before = graph.poses.copy()
    graph.optimise()
    moved_m = np.hypot(*(graph.poses - before)[:, :2].T).max()
    assert graph.moved_m == pytest.approx(moved_m)


def test_a_graph_that_cannot_be_solved_stays_as_it_is() -> None:
    graph = PoseGraph(PoseGraphConfig())
    for x in (0.0, 1.0, 5.0):
        graph.add_node(np.array([x, 0.0, 0.0]))
    graph.add_edge(0, 1, np.array([1.5, 0.0, 0.0]), np.eye(3), 1.0, robust=False)  # nothing holds node 2
    before = graph.poses.copy()
    graph.optimise()
    assert not graph.optimising
    np.testing.assert_array_equal(graph.poses, before)


def test_nodes_may_come_in_numbers_during_an_optimisation(town: TownMaker) -> None:
    """More than there was room for."""
    graph = town(200)
    graph.begin_optimisation()
    graph.step(units=10)
    for k in range(200, 700):
        graph.add_node(np.array([float(k), 0.0, 0.0]))
        graph.add_edge(k - 1, k, np.array([1.0, 0.0, 0.0]), np.eye(3), 1.0, robust=False)
    while graph.optimising:
        graph.step(units=1000)
    assert graph.poses.shape == (700, 3)
    np.testing.assert_allclose(np.hypot(*np.diff(graph.poses[200:], axis=0)[:, :2].T), 1.0)
