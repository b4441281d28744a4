"""Each kernel against a plain twin."""

import heapq
import math

import numpy as np
import pytest

from shared.geometry.se2 import Pose2, wrap_angle
from station_gui.planning import _kernels


def test_the_heap_gives_back_items_as_heapq_does() -> None:
    generator = np.random.default_rng(1)
    keys, items, twin = np.empty(500), np.empty(500, np.int64), []
    size = 0
    for k in range(400):
        key = float(generator.random())
        size = _kernels.heap_push(keys, items, size, key, k)
        heapq.heappush(twin, (key, k))
        if k % 3 == 0:
            size = _kernels.heap_pop(keys, items, size)
            assert (keys[size], items[size]) == heapq.heappop(twin)
    while size > 0:
        size = _kernels.heap_pop(keys, items, size)
        assert (keys[size], items[size]) == heapq.heappop(twin)


def test_a_full_heap_drops_what_does_not_fit() -> None:
    keys, items = np.empty(2), np.empty(2, np.int64)
    size = 0
    for k in range(5):
        size = _kernels.heap_push(keys, items, size, float(k), k)
    assert size == 2


def test_ways_to_the_goal_go_round_what_is_impassable() -> None:
    passable = np.ones((5, 5), bool)
    passable[:4, 2] = False
    way = np.empty((5, 5))
    _kernels.ways_to_goal(passable, 0.1, 0, 0, way)
    twin = _relaxed(passable, 0.1)
    np.testing.assert_allclose(way, twin)
    assert way[0, 4] == pytest.approx(0.1 * (4 + 4 * math.sqrt(2) - 0) - 0.0, abs=0.25)


def _relaxed(passable: np.ndarray, cell_m: float) -> np.ndarray:
    """Bellman and Ford: relax all cells until nothing changes."""
    way = np.full(passable.shape, np.inf)
    way[0, 0] = 0.0
    for _ in range(passable.size):
        for i, j in np.argwhere(passable):
            for a, b in np.argwhere(passable):
                if max(abs(i - a), abs(j - b)) == 1:
                    way[i, j] = min(way[i, j], way[a, b] + cell_m * math.hypot(i - a, j - b))
    return way


@pytest.mark.parametrize("kind", range(8))
@pytest.mark.parametrize("free_heading", [True, False])
def test_a_connection_ends_at_its_goal(kind: int, free_heading: bool) -> None:
    generator = np.random.default_rng(3)
    elements = np.zeros((3, 2))
    found = 0
    for _ in range(30):
        start, goal = generator.uniform(-2, 2, 3), generator.uniform(-2, 2, 3)
        if not _kernels.connection(kind, start, goal, free_heading, 0.5, elements):
            continue
        found += 1
        end = Pose2.from_array(start)
        for curvature, length in elements:
            turn = curvature * length
            chord = length * float(np.sinc(turn / math.tau))
            end = end @ Pose2(chord * math.cos(turn / 2), chord * math.sin(turn / 2), turn)
        assert end.distance_m(Pose2(*goal)) < 1e-5
        if not free_heading:
            assert abs(wrap_angle(end.theta_rad - goal[2])) < 1e-5
        assert (elements[:, 1] <= 0).all() if kind & 2 else (elements[:, 1] >= 0).all()
    assert found or (free_heading and kind & 4)


def test_the_body_is_as_clear_as_the_nearest_of_its_discs() -> None:
    field = np.fromfunction(lambda i, j: 0.01 * j + 0.02 * i, (50, 50))
    discs = np.array([0.0, 0.1, 0.25])
    clear = _kernels.body_clearance(field, 0.0, 0.0, 0.02, discs, 0.5, 0.5, 0.7)
    at = Pose2(0.5, 0.5, 0.7).apply(np.column_stack((discs, np.zeros(3)))) / 0.02 - 0.5
    assert clear == pytest.approx((0.01 * at[:, 0] + 0.02 * at[:, 1]).min())


def test_beyond_the_map_nothing_is_clear() -> None:
    assert _kernels.clearance_at(np.ones((10, 10)), 0.0, 0.0, 0.1, -0.3, 0.5) == 0.0
