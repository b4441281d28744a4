from __future__ import annotations

import math

import numpy as np

from station_gui.mapping.slam2d.config import GridConfig
from station_gui.mapping.slam2d.grid.occupancy_grid import OccupancyGrid
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.localisation.free_space import FreeSpace
from station_gui.mapping.slam2d.localisation.reference import newest_of_each_place
from station_gui.mapping.slam2d.share import Share, at_once

_CORNER = np.array([5.0, 5.0])


def _keyframe(rng: np.random.Generator) -> Keyframe:
    angle = rng.uniform(-math.pi, math.pi, 200)
    points = np.column_stack((2.0 * np.cos(angle), 1.5 * np.sin(angle))).astype(np.float32)
    return Keyframe(0.0, 0, np.zeros(3), points, np.zeros_like(points), np.array([0.1, 0.0]))


def test_free_space_is_what_the_occupancy_grid_draws() -> None:
    rng = np.random.default_rng(0)
    grid, free = OccupancyGrid(GridConfig(cell_m=0.05)), FreeSpace(GridConfig(), 0.05, 10**6, -_CORNER, _CORNER)
    for k in range(6):
        keyframe, pose = _keyframe(rng), np.array([0.1 * k, 0.05 * k, 0.3 * k])
        grid.add(keyframe.points_m, keyframe.scanner_m, pose)
        assert free.draw(keyframe, pose) > 0
    at_once(free.fill)
    whole, part = free.grid(), grid.snapshot()
    row = round((part.origin_m[1] - whole.origin_m[1]) / 0.05)
    column = round((part.origin_m[0] - whole.origin_m[0]) / 0.05)
    rows, columns = part.probability.shape
    np.testing.assert_array_equal(whole.probability[row : row + rows, column : column + columns], part.probability)
    assert np.count_nonzero(whole.probability != 0.5) == np.count_nonzero(part.probability != 0.5) > 1000


def test_free_space_of_a_large_map_has_larger_cells() -> None:
    grid = FreeSpace(GridConfig(), 0.05, 5000, -_CORNER, _CORNER)
    at_once(grid.fill)
    assert grid.grid().cell_m == 0.2
    assert grid.grid().probability.size <= 5000


def test_free_space_is_filled_in_shares() -> None:
    grid, share, rests = FreeSpace(GridConfig(), 0.05, 10**6, -_CORNER, _CORNER), Share(), 0
    task = grid.fill(share)
    while not share.run(task, 1000):
        rests += 1
    assert rests > 3
    assert (grid.grid().probability == 0.5).all()


def test_of_scans_at_one_place_the_newest_is_kept() -> None:
    poses = np.array([(0.1, 0.1, 0.0), (0.6, 0.1, 0.0), (0.15, 0.2, 0.1), (0.1, 0.1, 2.0), (-0.1, 0.1, 0.0)])
    assert newest_of_each_place(poses, 0.25, 0.5).tolist() == [1, 2, 3, 4]
    assert newest_of_each_place(np.zeros((0, 3)), 0.25, 0.5).tolist() == []
