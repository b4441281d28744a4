from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.graph.solver.analysis import Analysis
from station_gui.mapping.slam2d.graph.solver.block_cholesky import BlockCholesky
from station_gui.mapping.slam2d.share import Share

FloatArray = NDArray[np.float64]
TownMaker = Callable[[int], PoseGraph]


def _run(share: Share, task: object, units: int) -> None:
    while not share.run(task, units):  # type: ignore[arg-type]
        pass


def _solve(ends: NDArray[np.int32], unknowns: int, units: int) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """Of a random system with the edges' structure: its matrix, right side and solution, and whether it failed."""
    share = Share()
    analysis = Analysis(share)
    system = BlockCholesky(share, analysis)
    _run(share, analysis.run(unknowns, ends, len(ends)), units)
    _run(share, system.clear(), units)
    rng = np.random.default_rng(1)
    dense = np.zeros((unknowns, 3, unknowns, 3))
    for e, (i, j) in enumerate((ends - 1).tolist()):
        for node in (i, j):
            if node >= 0:
                own = rng.normal(size=(3, 3))
                block = own @ own.T + 4.0 * np.eye(3)
                system.diagonal[analysis.position[node]] += block.ravel()
                dense[node, :, node] += block
        if analysis.slots[e] >= 0:
            row, column = (i, j) if analysis.position[i] > analysis.position[j] else (j, i)
            block = rng.normal(size=(3, 3))
            system.below[analysis.slots[e]] += block.ravel()
            dense[row, :, column] += block
            dense[column, :, row] += block.T
    right = rng.normal(size=(unknowns, 3))
    system.right[analysis.position[:unknowns]] = right
    _run(share, system.solve(), units)
    size = 3 * unknowns
    return dense.reshape(size, size), right.ravel(), system.right[analysis.position[:unknowns]].ravel(), system.failed


@pytest.mark.parametrize("units", [1, 50, 1_000_000])
def test_it_solves_as_superlu_does(town: TownMaker, units: int) -> None:
    graph = town(150)
    matrix, right, found, failed = _solve(graph.ends, 149, units)
    expected = splu(csc_array(matrix)).solve(right)
    assert not failed
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_pauses_do_not_change_a_bit(town: TownMaker) -> None:
    ends = town(150).ends
    assert _solve(ends, 149, 7)[2].tobytes() == _solve(ends, 149, 1_000_000)[2].tobytes()


def test_two_edges_between_the_same_nodes_share_a_block() -> None:
    ends = np.array([[0, 1], [1, 2], [2, 1], [2, 3], [3, 1]], np.int32)
    matrix, right, found, failed = _solve(ends, 3, 5)
    assert not failed
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right), atol=1e-9)


def test_a_system_that_is_not_positive_definite_is_refused() -> None:
    share = Share()
    analysis = Analysis(share)
    system = BlockCholesky(share, analysis)
    _run(share, analysis.run(2, np.array([[0, 1], [1, 2]], np.int32), 2), 100)
    _run(share, system.clear(), 100)
    system.diagonal[:2] = -np.eye(3).ravel()
    _run(share, system.solve(), 100)
    assert system.failed


def test_the_order_keeps_the_factor_of_a_chain_as_small_as_the_chain() -> None:
    share = Share()
    analysis = Analysis(share)
    ends = np.array([[k, k + 1] for k in range(5000)], np.int32)
    _run(share, analysis.run(5000, ends, 5000), 1000)
    assert analysis.blocks == 4999
    assert sorted(analysis.position[:5000].tolist()) == list(range(5000))


def test_the_factor_of_a_town_is_sparse(town: TownMaker) -> None:
    share = Share()
    analysis = Analysis(share)
    graph = town(1500)
    _run(share, analysis.run(1499, graph.ends, graph.edges), 1000)
    assert analysis.blocks < 7 * 1500
