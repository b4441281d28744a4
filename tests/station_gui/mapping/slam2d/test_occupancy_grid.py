from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.slam2d.config import GridConfig
from station_gui.mapping.slam2d.grid.occupancy_grid import OccupancyGrid
from station_gui.mapping.slam2d.share import Share

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]
_ORIGIN = np.zeros(2)


def _points(*rows: tuple[float, float]) -> NDArray[np.float32]:
    return np.array(rows, np.float32).reshape(-1, 2)


def _twin(points: NDArray[np.float32], cell_m: float) -> tuple[set[tuple[int, int]], set[tuple[int, int]]]:
    """Cells that beams from the origin passed and ended in, by walking every beam in tiny steps."""
    passed, hit = set(), set()
    for x, y in points.astype(np.float64):
        last = (math.floor(x / cell_m), math.floor(y / cell_m))
        steps = np.linspace(0, 1, 200_000, endpoint=False)
        cells = np.unique(np.floor(np.column_stack((steps * x, steps * y)) / cell_m).astype(int), axis=0)
        passed |= {(int(c), int(r)) for c, r in cells} - {last}
        hit.add(last)
    return passed, hit


def test_beams_free_the_cells_they_pass_and_fill_the_one_they_end_in() -> None:
    config = GridConfig(cell_m=0.1)
    points = _points((1.03, 0.42), (-0.77, 1.31), (0.55, -0.91), (-0.33, -0.27))
    grid = OccupancyGrid(config)
    grid.add(points, _ORIGIN + 1e-9, np.zeros(3))
    shown = grid.snapshot()

    passed, hit = _twin(points, 0.1)
    for row in range(shown.probability.shape[0]):
        for column in range(shown.probability.shape[1]):
            cell = (column + round(shown.origin_m[0] / 0.1), row + round(shown.origin_m[1] / 0.1))
            odds = config.hit_log_odds if cell in hit else 0.0
            value = shown.probability[row, column]
            if cell in hit:
                assert value == pytest.approx(1 / (1 + math.exp(-odds)), abs=1e-6) or cell in passed
            elif cell in passed:
                assert value < 0.5
            else:
                assert value == 0.5


def test_a_scan_taken_out_leaves_no_trace() -> None:
    rng = np.random.default_rng(0)
    first, second = (rng.uniform(-2, 2, (50, 2)).astype(np.float32) for _ in range(2))
    moved, fresh = OccupancyGrid(GridConfig()), OccupancyGrid(GridConfig())
    there = np.array([0.3, 0.2, 0.5])
    for _ in range(3):
        moved.add(first, _ORIGIN, np.zeros(3))
        fresh.add(first, _ORIGIN, np.zeros(3))
    moved.add(second, _ORIGIN, np.zeros(3))
    moved.snapshot()
    moved.move(np.vstack((np.zeros((3, 3)), there)))
    fresh.add(second, _ORIGIN, there)

    _assert_same_map(moved, fresh)


def test_redrawing_everything_gives_the_map_of_the_new_poses() -> None:
    rng = np.random.default_rng(1)
    scans = [rng.uniform(-2, 2, (50, 2)).astype(np.float32) for _ in range(4)]
    poses = rng.uniform(-1, 1, (4, 3))
    moved, fresh = OccupancyGrid(GridConfig()), OccupancyGrid(GridConfig())
    for scan, pose in zip(scans, poses, strict=True):
        moved.add(scan, _ORIGIN, np.zeros(3))
        fresh.add(scan, _ORIGIN, pose)
    moved.move(poses)

    _assert_same_map(moved, fresh)


def _assert_same_map(a: OccupancyGrid, b: OccupancyGrid) -> None:
    """Cell by cell over the part that is not unknown."""
    known = []
    for shown in (a.snapshot(), b.snapshot()):
        rows, columns = np.nonzero(shown.probability != 0.5)
        x = columns + round(shown.origin_m[0] / shown.cell_m)
        y = rows + round(shown.origin_m[1] / shown.cell_m)
        known.append(dict(zip(zip(x, y, strict=True), shown.probability[rows, columns].tolist(), strict=True)))
    assert known[0] == known[1]


def test_a_snapshot_stays_as_it_was_when_the_map_grows() -> None:
    grid = OccupancyGrid(GridConfig())
    grid.add(_points((1.0, 0.0)), _ORIGIN, np.zeros(3))
    before = grid.snapshot()
    copy = before.probability.copy()
    grid.add(_points((1.0, 0.0), (9.0, 4.0), (-7.0, 1.0)), _ORIGIN, np.zeros(3))
    after = grid.snapshot()

    assert not before.probability.flags.writeable
    np.testing.assert_array_equal(before.probability, copy)
    assert after.probability.size > before.probability.size


def test_a_map_that_outgrows_its_cells_becomes_coarser() -> None:
    grid = OccupancyGrid(GridConfig(max_cells=100_000))
    for _ in range(3):
        grid.add(_points((2.0, 1.0)), _ORIGIN, np.zeros(3))
    assert grid.snapshot().cell_m == 0.02
    grid.add(_points((12.0, 12.0)), _ORIGIN, np.zeros(3))
    coarse = grid.snapshot()

    assert coarse.cell_m > 0.02
    assert coarse.probability.size <= 100_000
    assert (np.hypot(*(coarse.occupied_m() - (2.0, 1.0)).T) < coarse.cell_m).any()


@pytest.mark.parametrize("pose", [(1e9, 0.0, 0.0), (1e300, -1e300, 0.0), (0.0, np.inf, 0.0), (np.nan, 0.0, 0.0)])
def test_a_pose_out_of_this_world_is_refused_by_name_and_the_map_stays(pose: tuple[float, float, float]) -> None:
    grid = OccupancyGrid(GridConfig())
    grid.add(_points((1.0, 0.5)), _ORIGIN, np.zeros(3))
    before = grid.snapshot()
    with pytest.raises(MappingError, match="the map would be"):
        grid.add(_points((1.0, 0.5)), _ORIGIN, np.array(pose))
    np.testing.assert_array_equal(grid.snapshot().probability, before.probability)


def test_ranges_out_of_this_world_are_left_out() -> None:
    grid = OccupancyGrid(GridConfig())
    grid.add(_points((1e9, 0.0), (1.0, 0.5)), _ORIGIN, np.zeros(3))
    assert grid.snapshot().probability.size < 100_000


@pytest.mark.parametrize("count", [0, 1, 100])
def test_scans_of_nothing_or_of_one_place_do_no_harm(count: int) -> None:
    grid = OccupancyGrid(GridConfig())
    grid.add(np.full((count, 2), 0.5, np.float32), _ORIGIN, np.zeros(3))
    assert len(grid.snapshot().occupied_m()) <= 1


def test_the_walls_of_the_lab_are_thin_and_where_they_are(lab: FloatArray, scan_from: ScanMaker) -> None:
    rng = np.random.default_rng(11)
    grid = OccupancyGrid(GridConfig())
    for angle in np.linspace(0, math.tau, 60):
        pose = Pose2(1.95 + 1.05 * math.sin(angle), 2.1 - 1.15 * math.cos(angle), float(angle))
        scan = scan_from(lab, pose, rng, noise_m=0.02)
        grid.add(scan.points_m.astype(np.float32), _ORIGIN, pose.as_array())

    occupied = grid.snapshot().occupied_m()
    distance = _distance_to_walls(occupied, lab)

    assert float(np.sqrt(np.mean(distance**2))) < 0.016
    assert _share_covered(lab[:4], occupied) > 0.9  # the rest lies behind the boxes


def _distance_to_walls(points: FloatArray, walls: FloatArray) -> FloatArray:
    start, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    offset = points[:, np.newaxis] - start
    place = np.clip((offset * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
    return np.linalg.norm(offset - place[..., np.newaxis] * along, axis=2).min(axis=1)


def _share_covered(walls: FloatArray, occupied: FloatArray) -> float:
    samples = np.vstack([np.linspace(wall[:2], wall[2:], 80) for wall in walls])
    nearest = np.linalg.norm(samples[:, np.newaxis] - occupied, axis=2).min(axis=1)
    return float((nearest < 0.05).mean())


def test_a_map_refreshed_in_small_shares_is_the_same_one() -> None:
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (300, 2)).astype(np.float32)
    grids = [OccupancyGrid(GridConfig(cell_m=0.02)) for _ in range(2)]
    share, rests = Share(), 0
    for grid in grids:
        grid.add(points, _ORIGIN, np.zeros(3))
    task = grids[0].refresh_slowly(share)
    while not share.run(task, 1):
        rests += 1
    assert rests > 5
    np.testing.assert_array_equal(grids[0].snapshot().probability, grids[1].snapshot().probability)
    assert (grids[0].snapshot().probability > 0.65).any()
