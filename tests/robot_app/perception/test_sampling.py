"""Which curves are edges and which are noise."""

from __future__ import annotations

import numpy as np
import pytest

from robot_app.perception._kernels import TILE_CELLS
from robot_app.perception.config import EdgeConfig
from robot_app.perception.curves.sampling import _kernels as kernels

CELL_WIDTH = 4 / 457.0
NOISE = 0.0015
ROWS, COLUMNS = 60, 80
COUNT = 20
ORDER = np.arange(COUNT, dtype=np.int32)


def points(uv: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.column_stack((CELL_WIDTH * (uv - 40.0) * z[:, None], z)).astype(np.float32)


def along_a_row(step_cells: float = 1.0) -> np.ndarray:
    return np.column_stack((10.5 + step_cells * np.arange(COUNT), np.full(COUNT, 20.5))).astype(np.float32)


def looseness(uv: np.ndarray, z: np.ndarray) -> float:
    return kernels.looseness(points(uv, z), uv, ORDER, 0, COUNT, CELL_WIDTH)


def twin_looseness(uv: np.ndarray, z: np.ndarray) -> float:
    gaps = np.linalg.norm(np.diff(uv.astype(float), axis=0), axis=1)
    place = np.concatenate(((0.0,), np.cumsum(gaps)))
    off = []
    for k in range(1, COUNT - 1):
        beside = [k - 1, k + 1]
        q = np.interp(place[k], place[beside], 1.0 / z[beside])
        off.append(min(abs(q * z[k] - 1.0) / CELL_WIDTH, kernels.MOST_LOOSE_CELLS))
    return float(gaps.mean() - 1.0 + np.mean(off) + kernels.DOUBT_CELLS / COUNT)


def test_looseness_is_that_of_its_twin() -> None:
    rng = np.random.default_rng(1)
    for _ in range(5):
        uv = (along_a_row() + rng.uniform(-0.4, 0.4, (COUNT, 2))).astype(np.float32)
        z = (1.0 + rng.uniform(0.0, 0.1, COUNT)).astype(np.float32)
        assert looseness(uv, z) == pytest.approx(twin_looseness(uv, z), rel=1e-4)


def test_an_edge_that_runs_into_the_depth_is_as_firm_as_a_level_one() -> None:
    """Its points lie six cells apart in space."""
    uv = along_a_row()
    receding = (1.0 / np.linspace(1.0, 0.2, COUNT)).astype(np.float32)
    assert np.linalg.norm(np.diff(points(uv, receding), axis=0), axis=1).mean() > 6.0 * CELL_WIDTH * receding.mean()
    assert looseness(uv, receding) == pytest.approx(looseness(uv, np.full(COUNT, 1.5, np.float32)), abs=0.01)


def test_points_that_scatter_in_depth_or_lie_apart_in_the_image_are_loose() -> None:
    rng = np.random.default_rng(2)
    firm = looseness(along_a_row(), np.full(COUNT, 1.5, np.float32))
    scattered = looseness(along_a_row(), (1.5 + rng.uniform(-0.05, 0.05, COUNT)).astype(np.float32))
    apart = looseness(along_a_row(2.5), np.full(COUNT, 1.5, np.float32))
    assert firm == pytest.approx(kernels.DOUBT_CELLS / COUNT, abs=0.01)
    assert min(scattered, apart) > firm + 1.2


def test_a_straight_curve_is_not_ragged_and_a_zigzag_is() -> None:
    uv = along_a_row()
    slanted = uv + np.outer(np.arange(COUNT), (0.0, 0.7)).astype(np.float32)
    zigzag = uv + np.outer(np.arange(COUNT) // 2 % 2, (0.0, 2.0)).astype(np.float32)
    assert kernels.raggedness(slanted, ORDER, 0, COUNT) == pytest.approx(0.0, abs=1e-4)
    assert kernels.raggedness(zigzag, ORDER, 0, COUNT) == pytest.approx(2.0, abs=0.1)


def surface(seed: int = 0, scatter_m: float = 0.0) -> np.ndarray:
    """Inverse depth of something at 1.5 m from row 20 on downwards, nothing above."""
    z = 1.5 + np.random.default_rng(seed).uniform(-scatter_m, scatter_m, (ROWS, COLUMNS))
    inverse = (1.0 / z).astype(np.float32)
    inverse[:20] = 0.0
    return inverse


def is_on(inverse: np.ndarray, z_m: float) -> bool:
    uv = along_a_row()
    point_m = points(uv, np.full(COUNT, z_m, np.float32))
    return kernels.is_on_surface(inverse, point_m, uv, ORDER, 0, COUNT, CELL_WIDTH, NOISE)


def test_a_rim_is_on_a_surface_that_comes_to_it() -> None:
    assert is_on(surface(), 1.5)
    assert not is_on(surface(), 1.4)  # the surface passes behind it
    assert not is_on(surface(scatter_m=0.05), 1.5)
    assert not is_on(np.zeros((ROWS, COLUMNS), np.float32), 1.5)


def is_kept(step_cells: float, z_m: float, *, edges_a_tile: int = 0, score: float = 0.0, rim: bool = False) -> bool:
    """Whether the robot takes a straight level curve for an edge, its points so far apart and at this depth.

    `score`: how sharply it bends everywhere. `rim`: whether it is the upper rim of something smooth.
    """
    config, uv, z = EdgeConfig(), along_a_row(step_cells), np.full(COUNT, z_m, np.float32)
    point_m, extent_m = points(uv, z), np.zeros(1, np.float32)
    kernels.measure(
        point_m, np.full(COUNT, score, np.float32), ORDER, point_m, uv, np.array([0, COUNT], np.int32), 1,
        np.full((ROWS // TILE_CELLS + 3, COLUMNS // TILE_CELLS + 3), edges_a_tile, np.int32), config.crowd_share,
        config.min_curve_m, config.min_curve_cells, config.max_roughness,
        surface() if rim else np.zeros((ROWS, COLUMNS), np.float32), NOISE, config.max_looseness, config.loose_range_m,
        config.max_raggedness, CELL_WIDTH, config.detail_curve_m, config.max_detail, extent_m, np.zeros(1, np.float32),
    )  # fmt: skip
    return bool(extent_m[0] > 0.0)


def test_a_loose_curve_is_an_edge_near_by_and_noise_where_depth_is_noisy() -> None:
    assert is_kept(2.8, 1.5)
    assert not is_kept(2.8, 2.5)
    assert is_kept(1.0, 2.5)


def test_in_a_crowd_of_edges_a_curve_has_to_be_better_or_the_rim_of_something_smooth() -> None:
    assert is_kept(2.2, 1.5)
    assert not is_kept(2.2, 1.5, edges_a_tile=7)
    assert is_kept(2.2, 1.5, edges_a_tile=7, rim=True)
    assert is_kept(1.0, 1.5, edges_a_tile=7)


def test_what_bends_everywhere_is_noise_and_in_a_crowd_what_bends_less_too() -> None:
    assert is_kept(1.0, 1.5, score=0.3)
    assert not is_kept(1.0, 1.5, score=0.5)
    assert not is_kept(1.0, 1.5, score=0.3, edges_a_tile=7)


def test_curves_of_less_than_six_centimetres_or_six_cells_are_noise() -> None:
    assert is_kept(0.4, 1.0)
    assert not is_kept(0.34, 1.0)  # 5.7 cm, 6.5 cells
    assert is_kept(0.36, 1.5)
    assert not is_kept(0.28, 1.5)  # 7 cm, 5.3 cells
