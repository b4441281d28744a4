"""The grid as a picture."""

import numpy as np
import pytest

from station_gui.mapping.snapshot import GridMap
from station_gui.views.grid_picture import MAX_SIDE_PX, Extent, colour_table, make_picture


def test_rows_and_columns_keep_their_places():
    probability = np.full((3, 5), 0.5, np.float32)
    probability[0, 4] = 1.0
    picture = make_picture(GridMap(probability, (1.0, -2.0), 0.5))
    assert picture.levels is not None
    assert picture.levels[0, 4] == 255
    assert picture.extent == Extent(1.0, -2.0, 2.5, 1.5)
    assert picture.known == Extent(3.0, -2.0, 0.5, 0.5)


def test_a_huge_grid_shrinks_and_keeps_single_occupied_cells():
    probability = np.full((5000, 3000), 0.1, np.float32)
    probability[4321, 1234] = 0.95
    picture = make_picture(GridMap(probability, (0.0, 0.0), 0.05))
    assert picture.levels is not None
    assert max(picture.levels.shape) <= MAX_SIDE_PX
    row, column = np.unravel_index(picture.levels.argmax(), picture.levels.shape)
    assert (column + 0.5) * picture.extent.width_m / picture.levels.shape[1] == pytest.approx(1234.5 * 0.05, abs=0.15)
    assert (row + 0.5) * picture.extent.height_m / picture.levels.shape[0] == pytest.approx(4321.5 * 0.05, abs=0.15)


@pytest.mark.parametrize("cell_m", [0.0, -1.0, np.nan, np.inf])
def test_a_grid_without_size_has_no_picture(cell_m):
    assert make_picture(GridMap(np.zeros((4, 4), np.float32), (0.0, 0.0), cell_m)).levels is None


def test_nan_is_unknown():
    picture = make_picture(GridMap(np.full((2, 2), np.nan, np.float32), (0.0, 0.0), 0.1))
    assert picture.levels is not None
    assert set(picture.levels.ravel().tolist()) == {128}
    assert picture.known is None


def test_colours_are_the_papers():
    table = colour_table()
    assert table[0].tolist() == [255, 255, 255, 255]
    assert table[128].tolist() == [0x9A, 0xA0, 0xA8, 255]
    assert table[192].max() == 255
    assert table[192, :3].max() < 0x20
