from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from station_gui.export.map_picture import draw_map
from station_gui.mapping.snapshot import GridMap

_NO_CLOSURES = np.zeros((0, 2), np.int32)


def _room(rows: int, columns: int, cell_m: float = 0.05) -> GridMap:
    probability = np.full((rows, columns), 0.1, np.float32)
    probability[[0, -1]] = 0.9
    probability[:, [0, -1]] = 0.9
    return GridMap(probability, (-1.0, -2.0), cell_m)


@pytest.mark.parametrize("shape", [(4, 4), (80, 90), (30, 2500), (2400, 60)])
def test_a_picture_is_of_a_size_for_the_screen_whatever_the_map(tmp_path: Path, shape: tuple[int, int]) -> None:
    path = tmp_path / "map.png"
    way = np.column_stack((np.arange(5), np.linspace(-0.8, 0, 5), np.full(5, -1.5), np.zeros(5)))
    draw_map(_room(*shape), way, np.array([[0, 4]], np.int32), path, title="a room")
    with Image.open(path) as picture:
        assert min(picture.size) > 150
        assert max(picture.size) < 2000


def test_free_is_white_occupied_near_black_and_north_is_up(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    grid = _room(40, 40)
    grid.probability[30:36, 18:22] = 0.95  # in the upper half
    draw_map(grid, np.zeros((0, 4)), _NO_CLOSURES, path, title="a room")
    with Image.open(path) as picture:
        grey = np.asarray(picture.convert("L"))
    middle = grey[:, grey.shape[1] // 2]
    dark = np.flatnonzero(middle < 60)
    assert (middle == 255).any()
    assert dark[(dark > 80) & (dark < 0.45 * len(middle))].size > 20


@pytest.mark.parametrize("value", [0.5, 0.1])
def test_a_map_without_a_wall_can_be_drawn(tmp_path: Path, value: float) -> None:
    path = tmp_path / "map.png"
    grid = GridMap(np.full((1, 1), value, np.float32), (0.0, 0.0), 0.02)
    draw_map(grid, np.zeros((1, 4)), _NO_CLOSURES, path, title="nothing yet", subtitle="0 scans")
    assert path.stat().st_size > 0
