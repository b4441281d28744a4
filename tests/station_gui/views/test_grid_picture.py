"""The grid as a picture."""

import numpy as np
import pytest

from station_gui.mapping.snapshot import GridMap
from station_gui.views.grid_picture import MAX_SIDE_PX, Extent, colour_table, cropped, make_picture


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


def test_cropping_keeps_what_was_seen_where_it_is():
    probability = np.full((100, 200), 0.5, np.float32)
    probability[40:50, 120:150] = 0.1
    probability[44, 130] = 0.9
    whole = make_picture(GridMap(probability, (-2.0, 1.0), 0.1))
    part = cropped(whole, 0.5)
    assert whole.levels is not None
    assert part.levels is not None
    assert part.levels.shape == (20, 40)
    assert (part.extent.left_m, part.extent.bottom_m) == pytest.approx((9.5, 4.5))
    row, column = np.unravel_index(part.levels.argmax(), part.levels.shape)
    assert part.extent.left_m + (column + 0.5) * 0.1 == pytest.approx(-2.0 + 130.5 * 0.1)
    assert part.extent.bottom_m + (row + 0.5) * 0.1 == pytest.approx(1.0 + 44.5 * 0.1)


def test_cropping_stays_within_the_grid():
    picture = make_picture(GridMap(np.full((10, 20), 0.1, np.float32), (0.0, 0.0), 0.1))
    part = cropped(picture, 5.0)
    assert part.levels is not None
    assert part.levels.shape == (10, 20)
    assert part.extent == picture.extent
