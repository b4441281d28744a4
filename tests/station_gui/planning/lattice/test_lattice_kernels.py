"""Each kernel against a plain twin."""

import math

import numpy as np
import pytest

from station_gui.planning.lattice import _kernels


def test_ways_to_the_goal_go_round_what_is_impassable() -> None:
    passable = np.ones((5, 5), bool)
    passable[:4, 2] = False
    way = np.empty((5, 5))
    _kernels.ways_to_goal(passable, 0.1, 0, 0, way)
    twin = _relaxed(passable, 0.1)
    np.testing.assert_allclose(way, twin)
    assert way[0, 4] == pytest.approx(0.1 * (4 + 4 * math.sqrt(2) - 0) - 0.0, abs=0.25)


def _relaxed(passable: np.ndarray, cell_m: float) -> np.ndarray:
    """Bellman and Ford: relax all cells until nothing changes."""
    way = np.full(passable.shape, np.inf)
    way[0, 0] = 0.0
    for _ in range(passable.size):
        for i, j in np.argwhere(passable):
            for a, b in np.argwhere(passable):
                if max(abs(i - a), abs(j - b)) == 1:
                    way[i, j] = min(way[i, j], way[a, b] + cell_m * math.hypot(i - a, j - b))
    return way
