from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.objects.config import ReferenceConfig
from station_gui.mapping.objects.ransac import _kernels
from station_gui.mapping.objects.ransac.ransac import LineFitter

CELL_M = 0.02

FloatArray = NDArray[np.float64]


def fit(points_m: FloatArray) -> FloatArray:
    fitter = LineFitter(ReferenceConfig(), np.random.default_rng(1))
    return fitter.fit(points_m, np.zeros(len(points_m), np.int64), CELL_M)[0]


def cells(x0: float, y0: float, x1: float, y1: float) -> FloatArray:
    """The centres of the cells along a segment."""
    count = 1 + math.ceil(2 * math.hypot(x1 - x0, y1 - y0) / CELL_M)
    points = np.linspace((x0, y0), (x1, y1), count)
    return np.unique((np.floor(points / CELL_M) + 0.5) * CELL_M, axis=0)


def algorithm_2(points: FloatArray, draws: FloatArray, inlier_m: float) -> tuple[int, tuple[int, int]]:
    """As the paper writes it, with its slopes; the draws pick the samples. No upright lines."""
    best, pair = -1, (0, 0)
    for u, v in draws:
        i, j = int(u * len(points)), int(v * (len(points) - 1))
        j += j >= i
        (x1, y1), (x2, y2) = points[i], points[j]
        m = (y2 - y1) / (x2 - x1)
        b = y1 - m * x1
        if abs(math.degrees(math.atan(m))) <= 45.0:
            new = np.column_stack((points[:, 0], m * points[:, 0] + b))
        else:
            new = np.column_stack(((points[:, 1] - b) / m, points[:, 1]))
        count = int((np.hypot(*(new - points).T) <= inlier_m).sum())
        if count > best:
            best, pair = count, (i, j)
    return best, pair


@pytest.mark.parametrize("seed", range(5))
def test_the_best_line_is_that_of_the_paper(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 1, (50, 2))
    points[:30, 1] = (0.3 if seed % 2 else 4.0) * points[:30, 0] + rng.normal(0, 0.01, 30)
    draws = rng.random((75, 2))
    line = np.zeros((2, 2))
    support = _kernels.ransac_line(points, draws, 75, 0.05, False, line)
    best, (i, j) = algorithm_2(points, draws, 0.05)
    assert support == best
    np.testing.assert_array_equal(line, points[[i, j]])


@pytest.mark.parametrize("angle_deg", [0.0, 17.0, 45.0, 90.0, 123.0])
def test_a_wall_is_found_to_a_fraction_of_a_cell(angle_deg: float) -> None:
    along = np.array([math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))])
    lines = fit(cells(0.003, 0.007, *(1.5 * along + (0.003, 0.007))))
    assert len(lines) == 1
    off = lines[0] - (0.003, 0.007)
    assert np.abs(off @ np.array([-along[1], along[0]])).max() < 0.012
    assert np.hypot(*(lines[0, 1] - lines[0, 0])) == pytest.approx(1.5, abs=0.04)


def test_fronts_that_stand_four_centimetres_behind_one_another_are_two_lines() -> None:
    lines = fit(np.concatenate((cells(0, 0.01, 0.6, 0.01), cells(0.62, 0.05, 1.2, 0.05))))
    assert sorted(lines[:, :, 1].mean(axis=1).tolist()) == pytest.approx([0.01, 0.05], abs=0.004)
    assert np.abs(np.diff(lines[:, :, 1], axis=1)).max() < 0.005


def test_a_line_ends_where_its_cells_leave_a_gap() -> None:
    lines = fit(np.concatenate((cells(0, 0.01, 0.6, 0.01), cells(1.0, 0.01, 1.4, 0.01))))
    lengths = np.hypot(*(lines[:, 1] - lines[:, 0]).T)
    assert sorted(lengths.tolist()) == pytest.approx([0.4, 0.6], abs=0.03)


def test_a_few_cells_are_no_wall() -> None:
    assert len(fit(np.array([[0.01, 0.01], [0.03, 0.01], [0.05, 0.01]]))) == 0
    assert len(fit(np.zeros((0, 2)))) == 0


def test_cells_that_lie_on_one_another_do_no_harm() -> None:
    assert len(fit(np.full((20, 2), 0.01))) == 0


def test_lines_depend_on_their_own_cells_alone() -> None:
    fitter = LineFitter(ReferenceConfig(), np.random.default_rng(1))
    wall, other = cells(0, 0.01, 0.6, 0.03), cells(3, 3, 3.5, 3.4)
    owners = np.repeat([0, 1], [len(wall), len(other)])
    both, of = fitter.fit(np.concatenate((wall, other)), owners, CELL_M)
    np.testing.assert_array_equal(both[of == 0], fit(wall))
