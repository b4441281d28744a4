import math

import numpy as np

from station_gui.planning.config import TreeConfig
from station_gui.planning.guide import Guide, make_guide
from station_gui.planning.road import Road
from station_gui.planning.rrt import Tree
from station_gui.planning.target import Target

_COSTS = np.array([1.6, 0.3, 0.03, 2.0, 1.8])
_GOAL = Target(
    np.array([3.2, 3.0, 0.0]), free_heading=True, headings_rad=np.linspace(-np.pi, np.pi, 72, endpoint=False)
)


def _scene() -> tuple[Road, Guide]:
    """4 x 4 m with a wall between start and goal that leaves 0.8 m."""
    blocked = np.zeros((200, 200), bool)
    blocked[40:, 75:100] = True
    rows, columns = np.nonzero(blocked)
    field = np.full(blocked.shape, 2.0)
    y, x = np.mgrid[0:200, 0:200]
    dx = np.maximum(np.maximum(columns.min() - x, x - columns.max()), 0)
    dy = np.maximum(rows.min() - y, 0)
    field = np.maximum(np.minimum(np.hypot(dx, dy), np.minimum.reduce([x, y, 199 - x, 199 - y])) - 0.5, 0.0) * 0.02
    start = np.array([0.7, 3.0, -1.57, 0.05])
    road = Road(field, np.array([0.0, 0.0, 0.02]), np.array([0.045, 0.305, 0.1, 0.05, 0.15]), start, _COSTS)
    return road, make_guide(road, _GOAL.pose[:2], 2)


def _never() -> bool:
    return False


def test_rrt_finds_a_way_and_rrt_star_a_cheaper_one_by_and_by() -> None:
    road, guide = _scene()
    config = TreeConfig()
    found = Tree(road, guide, _GOAL, config, 5001).find(5000, _never)
    assert found is not None
    costs = [road.cost(found)]
    assert math.isfinite(costs[0])
    for samples in (200, 800):
        tree = Tree(road, guide, _GOAL, config, 3000)
        tree.plant(found)
        costs.append(road.cost(tree.improve(samples, _never)))
    assert costs[0] > costs[1] >= costs[2]


def test_what_the_tree_says_a_way_costs_is_what_it_costs() -> None:
    road, guide = _scene()
    tree = Tree(road, guide, _GOAL, TreeConfig(), 3000)
    found = Tree(road, guide, _GOAL, TreeConfig(), 5001).find(5000, _never)
    assert found is not None
    tree.plant(found)
    best = tree.improve(500, _never)
    np.testing.assert_allclose(road.cost(best), tree.best_cost, atol=1e-6)


def test_no_time_leaves_the_way_that_is_known() -> None:
    road, guide = _scene()
    found = Tree(road, guide, _GOAL, TreeConfig(), 5001).find(5000, _never)
    assert found is not None
    tree = Tree(road, guide, _GOAL, TreeConfig(), 3000)
    tree.plant(found)
    np.testing.assert_allclose(road.cost(tree.improve(500, lambda: True)), road.cost(found), rtol=1e-3)
    assert Tree(road, guide, _GOAL, TreeConfig(), 5001).find(5000, lambda: True) is None


def test_another_seed_grows_another_tree_and_the_same_the_same() -> None:
    road, guide = _scene()
    ways = [Tree(road, guide, _GOAL, TreeConfig(seed=seed), 5001).find(5000, _never) for seed in (1, 1, 2)]
    assert all(way is not None for way in ways)
    np.testing.assert_array_equal(ways[0], ways[1])
    assert ways[0].shape != ways[2].shape or not np.allclose(ways[0], ways[2])
