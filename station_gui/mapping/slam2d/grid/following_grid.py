"""An occupancy grid that is asked for again and again while its scans move, and keeps nobody waiting for long."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.slam2d.config import GridConfig
from station_gui.mapping.slam2d.grid.occupancy_grid import DrawableScan, OccupancyGrid
from station_gui.mapping.slam2d.share import Share, Task
from station_gui.mapping.snapshot import GridMap

FloatArray = NDArray[np.float64]

_SCANS_AT_ONCE = 120  # about 30 ms of a scanner with 360 beams; at ten pictures a second 4000 scans take 3 s
_CELLS_AT_ONCE = 1_000_000


class FollowingGrid:
    """Where few scans have moved they are drawn again at once.

    Where many have, a second grid is drawn a share with each picture, and shown when all of it is there.
    """

    def __init__(self, config: GridConfig) -> None:
        self._config = config
        self._shown = OccupancyGrid(config)
        self._revision = 0  # of the poses in it
        self._next: OccupancyGrid | None = None
        self._next_revision = 0
        self._task: Task | None = None
        self._share = Share()
        self._scans: Sequence[DrawableScan] = ()
        self._poses = np.zeros((0, 3))

    @property
    def redrawing(self) -> bool:
        return self._task is not None

    def picture(self, scans: Sequence[DrawableScan], poses: FloatArray, revision: int) -> GridMap:
        """All `scans`, those that are new at their `poses`, (N, 3); `revision` grows whenever older ones move.

        Raises MappingError where new scans would make the map larger than is allowed; they are left out.
        """
        self._scans, self._poses = scans, poses
        if self._task is None and revision != self._revision:
            self._follow(revision)
        if self._task is not None and self._share.run(self._task, _CELLS_AT_ONCE):
            self._swap()
        drawn = self._shown.consumed
        self._shown.add_all(scans[drawn:], poses[drawn:])
        return self._shown.snapshot()

    def _follow(self, revision: int) -> None:
        drawn = self._shown.consumed
        if len(self._shown.moved(self._poses[:drawn])) <= _SCANS_AT_ONCE:
            self._revision = revision
            self._shown.move(self._poses[:drawn])
            return
        self._next, self._next_revision = OccupancyGrid(self._config), revision
        self._task = self._draw(self._next)

    def _draw(self, grid: OccupancyGrid) -> Task:
        """All scans but those that come while the probabilities are made."""
        cells_per_scan = math.ceil(_CELLS_AT_ONCE / _SCANS_AT_ONCE)
        while grid.consumed < len(self._scans):
            if self._share.left <= 0:
                yield
            begin = grid.consumed
            end = begin + _SCANS_AT_ONCE
            with contextlib.suppress(MappingError):  # told when they came
                grid.add_all(self._scans[begin:end], self._poses[begin:end])
            self._share.take(cells_per_scan * (grid.consumed - begin))
        yield from grid.refresh_slowly(self._share)

    def _swap(self) -> None:
        if self._next is not None:
            self._shown, self._revision = self._next, self._next_revision
        self._next = self._task = None
