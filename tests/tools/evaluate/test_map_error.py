from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.snapshot import GridMap
from tools.evaluate import _kernels
from tools.evaluate.map_error import (
    align,
    map_error,
    pose_error,
    reachable_surface,
    standing_places_m,
    surface_samples,
)
from tools.simulator.scenario import Item, Scenario, Start, find_scenario
from tools.simulator.truth import TrueSurfaces, true_surfaces

CELL_M = 0.02


@pytest.fixture(scope="module")
def lab() -> TrueSurfaces:
    return true_surfaces(find_scenario("lab"))


def grid_of(points_m: NDArray[np.float64], map_from_room: Pose2) -> GridMap:
    """A grid in which exactly the cells under the points are occupied."""
    cells = np.floor((map_from_room.apply(points_m) + 10.0) / CELL_M).astype(int)
    probability = np.full((1000, 1000), 0.5, np.float32)
    probability[cells[:, 1], cells[:, 0]] = 0.9
    return GridMap(probability, (-10.0, -10.0), CELL_M)


def test_a_perfect_map_has_the_error_of_its_cells_and_is_complete(lab: TrueSurfaces) -> None:
    grid = grid_of(reachable_surface(lab).points_m, lab.start.inverse())
    error = map_error(grid, lab)
    assert error.map_rmse_m < CELL_M / 2
    assert error.map_completeness == 1.0


def test_a_map_that_began_a_little_elsewhere_is_aligned(lab: TrueSurfaces) -> None:
    points_m = reachable_surface(lab).points_m
    moved = Pose2(0.06, -0.04, 0.03) @ lab.start.inverse()
    error = map_error(grid_of(points_m, moved), lab)
    assert error.map_rmse_m < CELL_M / 2
    assert error.map_completeness > 0.999
    assert (align(grid_of(points_m, moved).occupied_m(), lab) @ moved).as_array() == pytest.approx(0.0, abs=3e-3)


def test_a_bent_map_is_not_forgiven(lab: TrueSurfaces) -> None:
    points_m = reachable_surface(lab).points_m.copy()
    points_m[:, 0] *= 1.04
    assert map_error(grid_of(points_m, lab.start.inverse()), lab).map_rmse_m > 0.025


def test_false_walls_count_although_the_alignment_ignores_them(lab: TrueSurfaces) -> None:
    points_m = reachable_surface(lab).points_m
    ghost = np.column_stack((np.linspace(1.0, 3.0, 200), np.full(200, 3.2)))
    error = map_error(grid_of(np.vstack((points_m, ghost)), lab.start.inverse()), lab)
    assert error.map_rmse_m > 0.05
    assert error.map_completeness > 0.999


def test_half_a_map_is_half_complete(lab: TrueSurfaces) -> None:
    points_m = reachable_surface(lab).points_m
    half = points_m[points_m[:, 1] < np.median(points_m[:, 1])]
    assert map_error(grid_of(half, lab.start.inverse()), lab).map_completeness == pytest.approx(0.5, abs=0.06)


def test_an_empty_map_is_no_map(lab: TrueSurfaces) -> None:
    error = map_error(GridMap(np.full((10, 10), 0.5, np.float32), (0.0, 0.0), 0.05), lab)
    assert math.isnan(error.map_rmse_m)
    assert error.map_completeness == 0.0


def test_only_what_the_scanner_can_see_from_where_the_robot_fits_counts() -> None:
    """Two boxes close off a corner: what lies behind them is hidden, what faces the room is not."""
    boxes = (Item("a", (0.5, 1.0), (1.0, 0.2, 0.5)), Item("b", (1.1, 0.55), (0.2, 1.1, 0.5)))
    truth = true_surfaces(Scenario("test", Start((2.5, 2.5)), items=boxes))
    places, seen = standing_places_m(truth), reachable_surface(truth).points_m
    in_corner = (seen[:, 0] < 0.99) & (seen[:, 1] < 0.89)
    assert not in_corner.any()
    assert not ((places[:, 0] < 1.0) & (places[:, 1] < 0.9)).any()
    facing = (np.abs(seen[:, 1] - 1.1) < 0.01) & (seen[:, 0] < 0.95)
    assert facing.sum() > 80
    assert len(seen) < len(surface_samples(truth).points_m)


def test_the_kernels_agree_with_numpy(lab: TrueSurfaces) -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 4, (50, 2))
    foot, distance = np.empty((50, 2)), np.empty(50)
    _kernels.nearest_on_segments(points, lab.segments_m, foot, distance)
    start, along = lab.segments_m[:, 0], lab.segments_m[:, 1] - lab.segments_m[:, 0]
    to_point = points[:, None] - start
    t = np.clip(np.sum(to_point * along, 2) / np.sum(along * along, 1), 0, 1)
    assert distance == pytest.approx(np.linalg.norm(to_point - t[..., None] * along, axis=2).min(axis=1))
    assert np.linalg.norm(points - foot, axis=1) == pytest.approx(distance)
    for a, b in zip(points[:25], points[25:], strict=True):
        crossing = _kernels.blocked(*a, *b, lab.segments_m)
        assert crossing == _crosses(a, b, lab.segments_m)


def _crosses(a: NDArray[np.float64], b: NDArray[np.float64], segments: NDArray[np.float64]) -> bool:
    """Solve a + s (b - a) = u + t (v - u) for each segment."""
    for u, v in segments:
        matrix = np.column_stack((b - a, u - v))
        if abs(np.linalg.det(matrix)) > 1e-12:
            s, t = np.linalg.solve(matrix, u - a)
            if 0 <= s <= 1 and 0 <= t <= 1:
                return True
    return False


def wave(stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack((stamps, 2 + np.cos(stamps), 2 + np.sin(stamps), stamps + math.pi / 2))


def test_a_true_trajectory_in_another_frame_has_no_error() -> None:
    truth = wave(np.arange(0.0, 6.0, 0.02))
    estimated = wave(np.linspace(0.1, 5.5, 40))
    estimated[:, 1:3] = Pose2(1.0, -2.0, 0.7).apply(estimated[:, 1:3])
    assert pose_error(estimated, truth) < 1e-4


def test_noise_on_a_trajectory_is_its_error() -> None:
    rng = np.random.default_rng(2)
    estimated = wave(np.linspace(0.1, 5.5, 2000))
    estimated[:, 1:3] += rng.normal(0, 0.02, (2000, 2))
    assert pose_error(estimated, wave(np.arange(0.0, 6.0, 0.02))) == pytest.approx(0.02 * math.sqrt(2), rel=0.05)


def test_a_trajectory_of_another_time_is_refused() -> None:
    with pytest.raises(ValueError, match="beyond"):
        pose_error(wave(np.linspace(0, 9, 10)), wave(np.arange(0.0, 6.0, 0.02)))
