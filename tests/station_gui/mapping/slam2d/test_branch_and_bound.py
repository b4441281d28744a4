from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.slam2d.search.branch_and_bound import Search, build_pyramid, search
from station_gui.mapping.slam2d.share import Share

FloatArray = NDArray[np.float64]


def _exhaustive(points: FloatArray, grid: NDArray[np.uint8], centre: FloatArray, shifts: int, turns: int) -> int:
    """Numpy twin: the best sum over every cell shift and every turn of the same raster."""
    step = 2 * math.asin(0.1 / (2 * float(np.hypot(*points.T).max())))
    padded = np.pad(grid, 200)
    best = 0
    for a in range(-turns, turns + 1):
        c, s = math.cos(centre[2] + a * step), math.sin(centre[2] + a * step)
        x, y = centre[0] + c * points[:, 0] - s * points[:, 1], centre[1] + s * points[:, 0] + c * points[:, 1]
        columns, rows = np.floor(x / 0.1).astype(int) + 200, np.floor(y / 0.1).astype(int) + 200
        for dy in range(-shifts, shifts + 1):
            for dx in range(-shifts, shifts + 1):
                best = max(best, int(padded[rows + dy, columns + dx].sum(dtype=np.int64)))
    return best


@pytest.mark.parametrize("seed", range(6))
def test_it_finds_what_an_exhaustive_search_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = (rng.random((50, 60)) ** 8 * 255).astype(np.uint8)
    points = rng.uniform(-2, 2, (30, 2))
    centre = np.array([3.0, 2.5, 0.4])
    found = search(points, build_pyramid(grid, (0.0, 0.0), 0.1, 4), centre, 1.5, 0.2, 0.01, 10_000_000)

    assert found is not None
    turns = math.ceil(0.2 / (2 * math.asin(0.1 / (2 * float(np.hypot(*points.T).max())))))
    assert round(found.score * 255 * 30) == _exhaustive(points, grid, centre, 15, turns)


def test_a_level_of_the_pyramid_holds_the_maximum_of_its_squares() -> None:
    grid = np.random.default_rng(0).integers(0, 255, (20, 31)).astype(np.uint8)
    levels = build_pyramid(grid, (0.0, 0.0), 0.1, 3).levels
    for row in range(20):
        for column in range(31):
            assert levels[3, row, column] == grid[row : row + 8, column : column + 8].max()


def test_nothing_is_returned_where_nothing_is_good_enough() -> None:
    pyramid = build_pyramid(np.full((20, 20), 100, np.uint8), (0.0, 0.0), 0.1, 3)
    assert search(np.array([[0.1, 0.2]]), pyramid, np.zeros(3), 1.0, 0.1, 0.5, 1000) is None
    assert search(np.zeros((0, 2)), pyramid, np.zeros(3), 1.0, 0.1, 0.1, 1000) is None


def test_a_search_that_pauses_finds_the_same() -> None:
    rng = np.random.default_rng(7)
    pyramid = build_pyramid((rng.random((80, 80)) ** 8 * 255).astype(np.uint8), (0.0, 0.0), 0.1, 4)
    points, centre = rng.uniform(-2, 2, (40, 2)), np.array([4.0, 4.0, 0.1])
    whole = search(points, pyramid, centre, 2.0, 0.2, 0.01, 3000)

    share, paused, works = Share(), Search(points, pyramid, centre, 2.0, 0.2, 0.01, 3000), []
    task = paused.run(share)
    while not share.run(task, 200):
        works.append(share.done - sum(works))

    assert whole is not None
    assert paused.found is not None
    assert paused.found.pose.tobytes() == whole.pose.tobytes()
    assert max(works) < 400
