from __future__ import annotations

import math

import numpy as np

from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.share import Share


def _filled(rng: np.random.Generator) -> LocalMap:
    """A map with cells written to up to its borders."""
    local_map = LocalMap(9.7, 0.05, 8, 5000, 100.0)
    for _ in range(3):
        points = rng.uniform(-6.0, 6.0, (600, 2))
        local_map.insert(points, np.zeros_like(points), np.array([0.3, -0.2, rng.uniform(-math.pi, math.pi)]))
    return local_map


def test_a_cleared_map_is_as_a_new_one() -> None:
    local_map, new = _filled(np.random.default_rng(0)), LocalMap(9.7, 0.05, 8, 5000, 100.0)
    local_map.clear(3.0, 4.0)
    np.testing.assert_array_equal(local_map.nearest, new.nearest)
    np.testing.assert_array_equal(local_map.distance2, new.distance2)
    assert local_map.used == 0
    assert local_map.origin_x_m == new.origin_x_m + 3.0


def test_clearing_in_shares_keeps_to_them() -> None:
    local_map, new = _filled(np.random.default_rng(1)), LocalMap(9.7, 0.05, 8, 5000, 100.0)
    share, works, ended = Share(), [], False
    task = local_map.clear_slowly(0.0, 0.0, share)
    while not ended:
        before = share.done
        ended = share.run(task, 300)
        works.append(share.done - before)
    np.testing.assert_array_equal(local_map.distance2, new.distance2)
    assert len(works) > 10
    assert max(works) < 500


def test_points_of_either_precision_make_the_same_map() -> None:
    points = np.random.default_rng(2).uniform(-4.0, 4.0, (300, 2)).astype(np.float32)
    one, other = LocalMap(9.7, 0.05, 8, 5000, 100.0), LocalMap(9.7, 0.05, 8, 5000, 100.0)
    one.insert(points, np.zeros_like(points), np.array([0.1, 0.2, 0.3]))
    other.insert(points.astype(np.float64), np.zeros((300, 2)), np.array([0.1, 0.2, 0.3]))
    assert one.surfels[: one.used].tobytes() == other.surfels[: other.used].tobytes()
    assert one.nearest.tobytes() == other.nearest.tobytes()
