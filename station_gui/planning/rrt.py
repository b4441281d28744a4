"""Trees of poses that grow through free space: RRT (LaValle 1998) and RRT* (Karaman and Frazzoli 2011).

Edges are the ways of Reeds and Shepp, so that the car can follow what is found. RRT* begins with a way that is known
already and draws its samples where a better one may lead (Gammell et al. 2014), by the way that a point would go.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.planning.config import TreeConfig
from station_gui.planning.guide import Guide
from station_gui.planning.road import MOST_ELEMENTS, Road, split, walk
from station_gui.planning.steering._kernels import change_cost
from station_gui.planning.target import Target
from station_gui.planning.tree import _kernels

_EDGE_M = 0.5  # of the way that is known already
_PATH_POINT_M = 0.05


class Tree:
    """Grows from the start of a road."""

    def __init__(self, road: Road, guide: Guide, goal: Target, config: TreeConfig, capacity: int) -> None:
        self._road = road
        self._guide = guide
        self._goal = goal
        self._config = config
        self._random = np.random.default_rng(config.seed)
        self._poses = np.zeros((capacity, 3))
        self._costs = np.zeros(capacity)
        self._driven = np.zeros(capacity)
        self._links = np.full((3, capacity), -1, np.int64)  # parent, first child, next sibling
        self._edges = np.zeros((capacity, 5, 2))
        self._ends = np.zeros((capacity, 2, 2))
        self._at_goal = np.zeros(capacity, bool)
        self._poses[0] = road.start[:3]
        self._count = 1

    def plant(self, elements: NDArray[np.float64]) -> bool:
        """Put a way to the goal, (M, 2), into the tree; not one so tight that it is not free when looked at again.

        Each look along a way is at other poses of it, as far apart as its parts are long.
        """
        parts = split(elements, _EDGE_M)
        poses, spent = self._road.prices(parts)
        if not math.isfinite(spent[-1]):
            return False
        edge = np.zeros((5, 2))
        for k in range(min(len(parts), len(self._poses) - 1)):
            node = self._count
            edge[0] = parts[k]
            self._poses[node], self._costs[node] = poses[k + 1], spent[k + 1]
            _kernels.set_edge(self._edges, self._ends, node, edge)
            _kernels.hang(self._links[0], self._links[1], self._links[2], node, node - 1)
            last, first = self._ends[node - 1, 1], self._ends[node, 0]
            change = change_cost(self._road.costs, last[0], last[1], first[0], first[1])
            self._driven[node] = spent[k + 1] - spent[k] - change
            self._count += 1
        self._at_goal[self._count - 1] = True
        return True

    @property
    def best_cost(self) -> float:
        """Of the best way to the goal so far; infinite without one."""
        return float(self._costs[self._at_goal].min(initial=math.inf))

    def improve(self, samples: int, time_is_up: Callable[[], bool]) -> NDArray[np.float64]:
        """RRT*: the best way, (M, 2), after so many samples or when the time is up."""
        drawn = 0
        while drawn < samples and not time_is_up():
            self._grow(min(self._config.batch, samples - drawn), self.best_cost, rewire=True)
            drawn += self._config.batch
        return self._best()

    def find(self, samples: int, time_is_up: Callable[[], bool]) -> NDArray[np.float64] | None:
        """RRT: the first way, (M, 2), None when there is none after so many samples or when the time is up."""
        drawn = 0
        near_m = self._config.first_detour * self._guide.shortest_m
        while drawn < samples and not time_is_up() and not self._at_goal.any():
            everywhere = drawn // self._config.batch % 2 == 1
            self._grow(self._config.batch, math.inf if everywhere else near_m, rewire=False)
            drawn += self._config.batch
        return self._best() if self._at_goal.any() else None

    def _grow(self, samples: int, way_m: float, rewire: bool) -> None:
        targets, to_goal = self._targets(samples, way_m, rewire)
        road = self._road
        self._count = _kernels.grow(
            road.field_m,
            road.frame,
            road.car,
            road.start,
            road.costs,
            targets,
            to_goal,
            self._guide.to_goal_m,
            self._guide.cell_m,
            self._config.reach_m,
            rewire,
            self._poses,
            self._costs,
            self._driven,
            self._links[0],
            self._links[1],
            self._links[2],
            self._edges,
            self._ends,
            self._at_goal,
            self._count,
        )

    def _targets(self, samples: int, way_m: float, rewire: bool) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """(N, 3) poses to grow to, where ways of `way_m` may lead, and (N,) which of them are at the goal."""
        config, random = self._config, self._random
        cells = self._guide.cells_within_m(way_m)
        targets = np.empty((samples, 3))
        targets[:, :2] = cells[random.integers(len(cells), size=samples)]
        targets[:, :2] += random.uniform(0.0, self._guide.cell_m, (samples, 2))
        targets[:, 2] = random.uniform(-math.pi, math.pi, samples)
        if rewire:
            path = walk(Pose2.from_array(self._poses[0]), self._best(), _PATH_POINT_M)
            near = random.random(samples) < config.path_share
            about = path[random.integers(len(path), size=samples)]
            spread = (config.path_spread_m, config.path_spread_m, config.path_spread_rad)
            targets[near] = (about + random.normal(0.0, spread, (samples, 3)))[near]
        to_goal = random.random(samples) < config.goal_share
        targets[to_goal, :2] = self._goal.pose[:2]
        targets[to_goal, 2] = random.choice(self._goal.headings_rad, np.count_nonzero(to_goal))
        return targets, to_goal

    def _best(self) -> NDArray[np.float64]:
        at_goal = np.flatnonzero(self._at_goal)
        node = int(at_goal[np.argmin(self._costs[at_goal])])
        elements = np.zeros((MOST_ELEMENTS, 2))
        return elements[: _kernels.unwind(self._links[0], self._edges, node, elements)]
