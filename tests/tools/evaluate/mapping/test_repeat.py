from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tools.evaluate.mapping.repeat import repeatability

LINE = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
CELLS = np.column_stack((np.arange(0, 1, 0.02), np.zeros(50)))


def moved(points_m: NDArray[np.float64], *by_m: float) -> NDArray[np.float64]:
    return np.asarray(points_m + np.array(by_m))


def test_maps_that_are_alike_have_no_distance() -> None:
    alike = repeatability([LINE, LINE, LINE], [CELLS, CELLS, CELLS])
    assert (alike.repeatability_m, alike.only_in_one, alike.grid_repeatability_m) == (0.0, 0.0, 0.0)


def test_a_shift_across_is_the_distance() -> None:
    alike = repeatability([LINE, moved(LINE, 0.0, 0.02, 0.0)], [CELLS, moved(CELLS, 0.0, 0.03)])
    assert alike.repeatability_m == pytest.approx(0.02)
    assert alike.grid_repeatability_m == pytest.approx(0.03)


def test_of_three_maps_every_pair_counts() -> None:
    alike = repeatability([LINE, LINE, moved(LINE, 0.0, 0.03, 0.0)], [CELLS] * 3)
    assert alike.repeatability_m == pytest.approx(0.03 * math.sqrt(2 / 3))


def test_what_only_one_map_has_is_counted_apart() -> None:
    more = np.concatenate((LINE, moved(LINE, 0.0, 2.0, 0.0)))
    alike = repeatability([LINE, more], [CELLS, CELLS])
    assert alike.repeatability_m == 0.0
    assert alike.only_in_one == pytest.approx(1 / 3)


def test_a_single_map_tells_nothing() -> None:
    alike = repeatability([LINE], [CELLS])
    assert math.isnan(alike.repeatability_m)
    assert math.isnan(alike.grid_repeatability_m)


def test_an_empty_map_is_left_out_of_the_distances() -> None:
    assert repeatability([LINE, LINE, np.zeros((0, 2, 3))], [CELLS] * 3).repeatability_m == 0.0
