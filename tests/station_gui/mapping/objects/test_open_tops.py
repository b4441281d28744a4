from __future__ import annotations

import numpy as np
import pytest

from station_gui.mapping.objects.open_tops import open_tops

SIDE = [[1.0, 0.0, 0.0], [1.0, 0.0, 0.8]]


@pytest.mark.parametrize(
    ("rim", "is_open"),
    [
        ([[1.0, 0.0, 0.8], [1.0, 1.0, 0.8]], False),
        ([[1.0, -0.5, 0.82], [1.0, 0.5, 0.82]], False),  # in the middle of it
        ([[1.0, 0.0, 0.7], [1.0, 1.0, 0.7]], True),  # a shelf's board below the top
        ([[1.0, 0.2, 0.8], [1.0, 1.0, 0.8]], True),
    ],
)
def test_a_side_ends_where_a_level_edge_meets_its_top(rim: list[list[float]], is_open: bool) -> None:
    assert open_tops(np.array([SIDE, rim])).tolist() == [is_open, False]
    assert open_tops(np.array([SIDE[::-1], rim])).tolist() == [is_open, False]


def test_a_lone_side_is_open_and_an_empty_map_has_none() -> None:
    assert open_tops(np.array([SIDE])).tolist() == [True]
    assert open_tops(np.zeros((0, 2, 3), np.float32)).tolist() == []
