from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt, map_coordinates

from shared.geometry.field._kernels import bilinear, to_distances


def test_values_between_cells_are_bilinear() -> None:
    rng = np.random.default_rng(1)
    field = rng.uniform(size=(5, 7))
    places = rng.uniform((0, 0), (4, 6), (50, 2))
    found = [bilinear(field, u, v) for v, u in places.tolist()]
    np.testing.assert_allclose(found, map_coordinates(field, places.T, order=1), atol=1e-12)


def test_at_a_cell_the_value_is_its_own() -> None:
    field = np.arange(12.0).reshape(3, 4)
    assert bilinear(field, 2.0, 1.0) == pytest.approx(6.0)


@pytest.mark.parametrize("shape", [(1, 1), (30, 45), (45, 30)])
def test_distances_are_those_of_scipy(shape: tuple[int, int]) -> None:
    free = np.random.default_rng(2).uniform(size=shape) > 0.03
    free[0, 0] = False
    field = np.where(free, 1e4, 0.0)
    to_distances(field, 0.05)
    np.testing.assert_allclose(field, 0.05 * distance_transform_edt(free), atol=1e-12)


def test_no_distance_is_greater_than_the_bound() -> None:
    field = np.full((4, 5), 9.0)
    to_distances(field, 0.1)
    np.testing.assert_allclose(field, 0.3)
