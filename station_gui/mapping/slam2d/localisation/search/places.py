"""All places of a map where a query may lie, a bounded share of the work at a time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.localisation.config import SearchConfig
from station_gui.mapping.slam2d.localisation.query import Query, thinned
from station_gui.mapping.slam2d.localisation.reference import Reference
from station_gui.mapping.slam2d.localisation.search import _kernels
from station_gui.mapping.slam2d.se2_arrays import between, compose_all
from station_gui.mapping.slam2d.share import Share

FloatArray = NDArray[np.float64]

_POINTS_PER_UNIT = 20  # looked up
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


class PlaceSearch:
    """One search for one query. Places are poses of the trail in the map, (3,)."""

    def __init__(self, config: SearchConfig, reference: Reference, query: Query) -> None:
        self._config = config
        self._reference = reference
        self._at = query.at
        near = np.flatnonzero(np.hypot(*(query.points_m - query.at[:2]).T) <= reference.search_reach_m)
        kept = near[thinned(query.points_m[near], config.spacing_m, config.points)]
        c, s = math.cos(query.at[2]), math.sin(query.at[2])
        self._points = np.ascontiguousarray((query.points_m[kept] - query.at[:2]) @ np.array([[c, -s], [s, c]]))
        cell_m = reference.pyramid.cell_m
        farthest_m = max(float(np.hypot(*self._points.T).max(initial=0.0)), 4 * cell_m)
        self._turns = math.ceil(math.tau * farthest_m / cell_m)
        self._stride = _coprime(round(_GOLDEN * self._turns), self._turns)  # so that the best is known early
        self._turn = 0 if len(self._points) >= config.min_points else self._turns
        self._offsets = np.zeros(len(self._points), np.int64)
        self._found = np.zeros((config.max_found, 4), np.int64)
        self._state = np.zeros(3, np.int64)

    @property
    def ended(self) -> bool:
        """Every place has been looked at."""
        return self._turn >= self._turns

    def step(self, share: Share) -> None:
        """At least one turn, and more as far as the share goes; not after the end."""
        config, pyramid = self._config, self._reference.pyramid
        full, before = 255 * len(self._points), int(self._state[2])
        units_per_sum = 1 + len(self._points) // _POINTS_PER_UNIT
        self._turn = _kernels.search_turns(
            self._points, pyramid.levels, self._reference.free, self._turn, self._turns, self._stride, pyramid.cell_m,
            config.keep_level, math.ceil(config.min_score * full), round(config.behind_best * full),
            max(1, share.left // units_per_sum), self._offsets, self._found, self._state,
        )  # fmt: skip
        share.take(units_per_sum * (int(self._state[2]) - before))

    def places(self) -> list[FloatArray]:
        """The best first, none next to a better one."""
        config, pyramid = self._config, self._reference.pyramid
        found = self._found[: self._state[0]]
        found = found[found[:, 3] >= self._state[1] - config.behind_best * 255 * len(self._points)]
        found = found[np.lexsort((found[:, 0], -found[:, 3]))]
        x = pyramid.origin_m[0] + (found[:, 1] + 0.5) * pyramid.cell_m
        y = pyramid.origin_m[1] + (found[:, 2] + 0.5) * pyramid.cell_m
        scanners = np.column_stack((x, y, math.tau * found[:, 0] / self._turns))
        trail_from_scanner = between(self._at, np.zeros(3))
        kept = scanners[distinct(scanners, config)]
        return list(compose_all(kept, np.tile(trail_from_scanner, (len(kept), 1))))


def distinct(poses: FloatArray, config: SearchConfig) -> list[int]:
    """Indices into `poses`, (N, 3) best first, of those that are not next to a better one, up to the limit."""
    kept = np.zeros(config.max_places, np.int64)
    count = _kernels.pick_distinct(np.ascontiguousarray(poses), config.apart_m, config.apart_rad, kept)
    return [int(k) for k in kept[:count]]


def _coprime(least: int, to: int) -> int:
    """The first number from `least` on that has no divisor in common with `to`."""
    number = max(1, least)
    while math.gcd(number, to) > 1:
        number += 1
    return number
