from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import GridConfig
from station_gui.mapping.slam2d.grid.following_grid import FollowingGrid
from station_gui.mapping.slam2d.grid.occupancy_grid import OccupancyGrid
from station_gui.mapping.snapshot import GridMap

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class _Scan:
    points_m: NDArray[np.float32]
    scanner_m: FloatArray


@pytest.fixture
def scans() -> list[_Scan]:
    """400 of them, of points that lie on no border of a cell."""
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (400, 100, 2)).astype(np.float32)
    return [_Scan(own, np.zeros(2)) for own in points]


def _way(count: int) -> FloatArray:
    return np.column_stack((0.01037 * np.arange(count), np.zeros(count), np.zeros(count)))


def _at_once(scans: list[_Scan], poses: FloatArray) -> GridMap:
    grid = OccupancyGrid(GridConfig())
    grid.add_all(scans, poses)
    return grid.snapshot()


def _assert_same(a: GridMap, b: GridMap) -> None:
    """Where either knows something; one may have more room."""
    for grid, other in ((a, b), (b, a)):
        rows, columns = np.nonzero(grid.probability != 0.5)
        down, left = (round((grid.origin_m[k] - other.origin_m[k]) / grid.cell_m) for k in (1, 0))
        known = grid.probability[rows, columns]
        np.testing.assert_array_equal(other.probability[rows + down, columns + left], known)


def test_few_scans_that_moved_are_drawn_again_at_once(scans: list[_Scan]) -> None:
    grid, poses = FollowingGrid(GridConfig()), _way(400)
    grid.picture(scans, poses, 0)
    poses[300:] += (0.3, 0.2, 0.1)
    _assert_same(grid.picture(scans, poses, 1), _at_once(scans, poses))
    assert not grid.redrawing


def test_many_are_drawn_a_share_at_a_time_while_the_old_picture_stays(scans: list[_Scan]) -> None:
    grid, old = FollowingGrid(GridConfig()), _way(400)
    before = grid.picture(scans, old, 0)
    new = old + np.array((0.3, 0.2, 0.1))
    shares = 0
    after = grid.picture(scans, new, 1)
    while grid.redrawing:
        _assert_same(after, before)
        after = grid.picture(scans, new, 1)
        shares += 1
    assert 3 <= shares <= 10
    _assert_same(after, _at_once(scans, new))


def test_what_comes_and_moves_meanwhile_is_in_it_at_the_end(scans: list[_Scan]) -> None:
    grid, poses = FollowingGrid(GridConfig()), _way(400)
    grid.picture(scans[:300], poses[:300], 0)
    revision, shown = 0, None
    for count in range(301, 401):
        if count in (310, 311, 312, 313, 350):
            poses += (0.1, -0.2, 0.05)
            revision += 1
        shown = grid.picture(scans[:count], poses[:count], revision)
    for _ in range(20):
        shown = grid.picture(scans, poses, revision)
    assert shown is not None
    assert not grid.redrawing
    _assert_same(shown, _at_once(scans, poses))


def test_an_empty_grid_is_one() -> None:
    grid = FollowingGrid(GridConfig())
    assert grid.picture([], np.zeros((0, 3)), 0).probability.shape == (1, 1)
    assert grid.picture([], np.zeros((0, 3)), 1).probability.shape == (1, 1)
