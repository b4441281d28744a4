"""Hybrid A* in parts, so that the time can be looked at between them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from station_gui.planning.config import LatticeConfig
from station_gui.planning.guide import Guide
from station_gui.planning.lattice import _kernels
from station_gui.planning.road import MOST_ELEMENTS, Road
from station_gui.planning.target import Target

_MOVES = 6
_NEAR_START_M = 0.6  # nearer than that the body may have less room than elsewhere


def is_closed_in(road: Road, guide: Guide, goal: Target, config: LatticeConfig) -> bool:
    """Whether a car at the goal would not get away from there, so that there is no way to it either."""
    seen = np.zeros((*guide.to_goal_m.shape, config.headings), bool)
    return _kernels.closed_in(
        road.field_m,
        road.frame,
        road.car,
        road.start,
        road.costs,
        goal.pose,
        goal.free_heading,
        guide.cell_m,
        2 * config.headings,
        config.step_m / 2,
        _NEAR_START_M,
        seen,
        np.empty((config.pocket, 3)),
    )


class LatticeSearch:
    """From the start of a road to a goal, at most `expansions`, for a way that costs less than `limit`."""

    def __init__(
        self, road: Road, guide: Guide, goal: Target, config: LatticeConfig, expansions: int, limit: float
    ) -> None:
        self._road = road
        self._guide = guide
        self._goal = goal
        self._config = config
        self._left = expansions
        self._cost = limit
        pool = _MOVES * expansions + 16
        self._nodes = np.empty((pool, 4))
        self._nodes[0] = (*road.start[:3], 0.0)
        self._led = np.zeros((pool, 2))
        self._parents = np.full(pool, -1, np.int64)
        self._best = np.full(guide.to_goal_m.size * config.headings, math.inf, np.float32)
        self._keys = np.zeros(pool)
        self._items = np.zeros(pool, np.int64)
        self._counts = np.array([1, 1, -1], np.int64)  # the start is in the heap
        self._final = np.zeros((5, 2))

    @property
    def exhausted(self) -> bool:
        """Whether all there is was tried."""
        return bool(self._counts[1] == 0)

    @property
    def _found(self) -> bool:
        return bool(self._counts[2] >= 0)

    def find(self, time_is_up: Callable[[], bool], give_up: Callable[[], bool]) -> NDArray[np.float64] | None:
        """Elements (M, 2) of the cheapest way found, None when there is none.

        Where one is found it is made better until the time is up; before that only `give_up` ends the search.
        """
        while self._left > 0 and not self.exhausted and not (time_is_up() if self._found else give_up()):
            self._expand(min(self._config.batch, self._left))
            self._left -= self._config.batch
            if self._found:
                self._left = min(self._left, self._config.expansions)
        if not self._found:
            return None
        elements = np.zeros((MOST_ELEMENTS, 2))
        count = _kernels.unwind(self._parents, self._led, int(self._counts[2]), self._final, elements)
        return elements[:count] if count else None

    def _expand(self, expansions: int) -> None:
        road = self._road
        self._cost = _kernels.search(
            road.field_m,
            road.frame,
            road.car,
            road.start,
            road.costs,
            self._goal.pose,
            self._goal.free_heading,
            self._guide.to_goal_m,
            self._guide.cell_m,
            self._config.headings,
            self._config.step_m,
            expansions,
            self._nodes,
            self._led,
            self._parents,
            self._best,
            self._keys,
            self._items,
            self._counts,
            self._final,
            self._cost,
        )
