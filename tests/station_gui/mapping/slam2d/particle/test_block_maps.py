from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import NormalConfig
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, to_lines
from station_gui.mapping.slam2d.particle.blocks import _kernels
from station_gui.mapping.slam2d.particle.blocks.block_maps import BlockMapConfig, BlockMaps
from station_gui.mapping.slam2d.particle.matching import _kernels as matching

FloatArray = NDArray[np.float64]
SMALL = BlockMapConfig(max_places=8000, max_blocks=16_000)


def _wall(distance_m: float = 3.0) -> LineScan:
    points = np.column_stack((np.full(120, distance_m), np.linspace(-4.0, 4.0, 120)))
    return to_lines(points, np.zeros(2), NormalConfig())


def _counted(maps: BlockMaps) -> NDArray[np.int64]:
    """How often each block is named in the directory."""
    named = maps.blocks.directory[maps.blocks.directory >= 0]
    return np.bincount(named, minlength=len(maps.blocks.references))


def test_particles_share_a_map_until_one_of_them_changes_its_own() -> None:
    maps = BlockMaps(SMALL, 2)
    maps.insert(0, _wall(), np.zeros(3))
    alone = maps.blocks_in_use

    maps.adopt(np.array([0, 0]))
    shared = maps.blocks_in_use
    before = maps.surfel_means_m(0)
    maps.insert(1, _wall(3.02), np.array([0.0, 0.0, 0.02]))

    assert shared == alone
    np.testing.assert_array_equal(maps.surfel_means_m(0), before)
    assert len(maps.surfel_means_m(1)) > len(before)
    assert alone < maps.blocks_in_use <= 2 * alone + 4


def test_a_change_copies_only_the_blocks_that_it_touches() -> None:
    maps = BlockMaps(SMALL, 30)
    for k in range(10):
        maps.insert(0, _wall(), np.array([8.0 * k, 0.0, 0.0]))
    maps.adopt(np.zeros(30, np.int64))
    alone = maps.blocks_in_use
    for particle in range(30):
        maps.insert(particle, _wall(), np.array([0.01 * particle, 0.0, 0.0]))
    assert maps.blocks_in_use < 5 * alone  # 30 maps of which a tenth differs


def test_references_are_those_of_the_directory_and_the_dead_give_their_blocks_back() -> None:
    rng = np.random.default_rng(3)
    maps = BlockMaps(SMALL, 6)
    for k in range(40):
        for particle in range(6):
            maps.insert(particle, _wall(), np.array([0.2 * k, *rng.normal(0.0, 0.05, 2)]))
        maps.adopt(np.sort(rng.integers(0, 6, 6)))
        np.testing.assert_array_equal(maps.blocks.references, _counted(maps))
        assert maps.blocks_in_use == np.count_nonzero(_counted(maps))
    maps.adopt(np.zeros(6, np.int64))
    assert maps.blocks_in_use == np.count_nonzero(maps.blocks.directory[0] >= 0)


def test_a_surfel_is_the_mean_of_its_hits() -> None:
    rng = np.random.default_rng(1)
    points = np.array([1.025, -2.375]) + rng.uniform(-0.02, 0.02, (50, 2))
    maps = BlockMaps(SMALL, 1)
    maps.insert(0, LineScan(points, np.zeros((50, 2))), np.zeros(3))
    np.testing.assert_allclose(maps.surfel_means_m(0), points.mean(axis=0)[None], atol=1e-5)  # whole numbers of 1.5 µm


def test_every_cell_knows_its_nearest_surfel_across_the_borders_of_blocks() -> None:
    rng = np.random.default_rng(2)
    maps = BlockMaps(SMALL, 1)
    points = rng.uniform(-2.0, 2.0, (60, 2))
    maps.insert(0, LineScan(points, np.zeros((60, 2))), np.zeros(3))
    cells = np.unique(np.floor(points / 0.05).astype(int), axis=0)
    for row, column in rng.integers(-45, 45, (400, 2)).tolist():
        expected = int(np.min(np.sum((cells - [column, row]) ** 2, axis=1)))
        block = _kernels.block_at(maps.blocks, 0, row, column)
        code = 255 if block < 0 else int(maps.blocks.nearest[block, row & 15, column & 15])
        found = _kernels.distance2(code)
        assert found == (expected if expected <= 49 else 1 << 20)


def test_a_full_store_leaves_out_what_finds_no_room() -> None:
    maps = BlockMaps(BlockMapConfig(max_places=30, max_blocks=20), 3)
    for k in range(30):
        for particle in range(3):
            maps.insert(particle, _wall(), np.array([1.0 * k, 0.1 * particle, 0.0]))
    assert maps.blocks_in_use == 20
    assert maps.crowded
    np.testing.assert_array_equal(maps.blocks.references, _counted(maps))


@pytest.mark.parametrize("far", [1e7, -1e9, 1e15, 1e300])
def test_points_beyond_the_plane_are_left_out(far: float) -> None:
    maps = BlockMaps(SMALL, 1)
    maps.insert(0, LineScan(np.full((5, 2), far), np.zeros((5, 2))), np.zeros(3))
    maps.insert(0, LineScan(np.zeros((5, 2)), np.zeros((5, 2))), np.array([far, 0.0, math.pi]))
    assert maps.blocks_in_use == 0


def _share_of_points_with_a_surfel(maps: BlockMaps, scan: LineScan, pose: FloatArray) -> float:
    surfels = np.zeros((len(scan.points_m), 5))
    matching.associate(maps.blocks, 0, scan.points_m, scan.normals, pose, maps.cell_m, surfels)
    return float(np.mean(surfels[:, 0] > 0.0))


def test_what_is_not_joined_does_not_count_and_gives_way_to_what_is() -> None:
    maps, ages = BlockMaps(SMALL, 1), np.array([True, True])
    old, new = np.zeros(3), np.array([0.12, 0.0, 0.0])
    maps.insert(0, _wall(), old, age=0)
    before = maps.surfel_means_m(0)

    maps.join(~ages)
    assert _share_of_points_with_a_surfel(maps, _wall(), old) == 0.0
    maps.join(np.array([False, True]))
    maps.insert(0, _wall(), new, age=1)
    surfels = np.zeros((120, 5))
    matching.associate(maps.blocks, 0, _wall().points_m, _wall().normals, new, maps.cell_m, surfels)
    np.testing.assert_allclose(surfels[:, 1], 3.12, atol=1e-4)  # not the old wall at 3.00

    maps.join(ages)
    assert _share_of_points_with_a_surfel(maps, _wall(), old) == 1.0
    assert len(maps.surfel_means_m(0)) == 2 * len(before)


def test_a_surfel_that_is_not_joined_begins_afresh_with_the_next_hit() -> None:
    maps = BlockMaps(SMALL, 1)
    for k, x_m in enumerate((1.01, 1.03)):
        maps.join(np.array([k == 0, k == 1]))
        maps.insert(0, LineScan(np.array([[x_m, 0.02]]), np.zeros((1, 2))), np.zeros(3), age=k)
    np.testing.assert_allclose(maps.surfel_means_m(0), [[1.03, 0.02]], atol=1e-5)


def test_the_spare_map_is_taken_over_by_all() -> None:
    maps = BlockMaps(SMALL, 3)
    for particle in range(3):
        maps.insert(particle, _wall(), np.array([0.3 * particle, 0.0, 0.0]))
    maps.draw_spare(_wall(), np.array([5.0, 0.0, 0.0]), 0, None)
    maps.adopt_spare()
    for particle in range(3):
        np.testing.assert_allclose(maps.surfel_means_m(particle)[:, 0], 8.0, atol=0.01)
    np.testing.assert_array_equal(maps.blocks.references, _counted(maps))
    assert maps.blocks_in_use == np.count_nonzero(maps.blocks.directory[0] >= 0)
