"""What was looked through, drawn once over an area that is known beforehand."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import GridConfig
from station_gui.mapping.slam2d.grid import _kernels
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.share import Share, Task
from station_gui.mapping.snapshot import GridMap

FloatArray = NDArray[np.float64]

_ROWS_AT_ONCE = 32
_CELLS_PER_UNIT = 6  # most of them were never looked at
_UNITS_PER_PASS = 0.25  # of a beam through the side of a cell


class FreeSpace:
    """Counts of hits and passes, as of `OccupancyGrid`, without its growing and following; touches no memory early."""

    def __init__(self, config: GridConfig, cell_m: float, max_cells: int, low: FloatArray, high: FloatArray) -> None:
        """For all that lies between the corners `low` and `high`, (2,), map frame; `cell_m` is doubled to fit."""
        self._config = config
        width_m, height_m = (high - low).tolist()
        while (width_m / cell_m + 2) * (height_m / cell_m + 2) > max_cells:
            cell_m *= 2
        self._cell_m = cell_m
        self._origin_m = float(low[0]) - cell_m, float(low[1]) - cell_m
        shape = math.ceil(height_m / cell_m) + 2, math.ceil(width_m / cell_m) + 2
        self._hits, self._passes = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
        self._probability = np.empty(shape, np.float32)

    def draw(self, keyframe: Keyframe, pose: FloatArray) -> int:
        """At `pose`, (3,), map frame; returns about how much work it was, in units of 15 ns."""
        _kernels.trace_scan(
            keyframe.points_m, keyframe.scanner_m, pose, *self._origin_m, self._cell_m, self._config.max_range_m, 1,
            self._hits, self._passes,
        )  # fmt: skip
        way_m = float(np.abs(keyframe.points_m - keyframe.scanner_m).sum())
        return round(_UNITS_PER_PASS * way_m / self._cell_m)

    def fill(self, share: Share) -> Task:
        """Once, when all scans are in it."""
        config, (rows, columns) = self._config, self._hits.shape
        for first in range(0, rows, _ROWS_AT_ONCE):
            if share.left <= 0:
                yield
            last = min(first + _ROWS_AT_ONCE, rows)
            _kernels.fill_probability(
                self._hits, self._passes, first, last - 1, 0, columns - 1, config.hit_log_odds, config.miss_log_odds,
                config.limit_log_odds, config.thin_share, config.thin_reach_cells, self._probability,
            )  # fmt: skip
            share.take((last - first) * columns // _CELLS_PER_UNIT)

    def grid(self) -> GridMap:
        return GridMap(self._probability, self._origin_m, self._cell_m)
