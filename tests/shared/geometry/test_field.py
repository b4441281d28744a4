from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from shared.geometry.field._kernels import bilinear


def test_values_between_cells_are_bilinear() -> None:
    rng = np.random.default_rng(1)
    field = rng.uniform(size=(5, 7))
    places = rng.uniform((0, 0), (4, 6), (50, 2))
    found = [bilinear(field, u, v) for v, u in places.tolist()]
    np.testing.assert_allclose(found, map_coordinates(field, places.T, order=1), atol=1e-12)


def test_at_a_cell_the_value_is_its_own() -> None:
    field = np.arange(12.0).reshape(3, 4)
    assert bilinear(field, 2.0, 1.0) == pytest.approx(6.0)
