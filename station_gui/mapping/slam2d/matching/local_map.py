"""A window of surfels: what scans are matched with.

A surfel is the mean of all hits in one cell and of their normals, so that the noise of many scans averages out
below the size of a cell; each cell of the window also knows its nearest surfel, so that data association is one
look-up, as on the distance field of iris_lama (Pedrosa et al. 2017).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.matching import _kernels
from station_gui.mapping.slam2d.share import Share, Task, at_once

_UNITS_PER_SCAN = 400
_UNITS_PER_SURFEL = 10


class LocalMap:
    """Square window of `size_m` in some frame; grows nowhere, forgets nothing until `clear`."""

    def __init__(
        self,
        size_m: float,
        cell_m: float,
        reach_cells: int,
        max_surfels: int,
        max_count: float,
        *,
        cleared: bool = True,
    ) -> None:
        """Not `cleared`: the caller clears it before use, which for a large one is better done slowly."""
        side = round(size_m / cell_m)
        self.cell_m = cell_m
        self.size_m = side * cell_m
        self.origin_x_m = -0.5 * self.size_m
        self.origin_y_m = -0.5 * self.size_m
        self.nearest = np.empty((side, side), np.int32)
        self.distance2 = np.empty((side, side), np.uint8)
        self.surfels = np.zeros((max_surfels, 5))
        self.used = 0
        tiles = -(-side // _kernels.TILE)
        self._dirty = np.ones((tiles, tiles), np.bool_)
        self.reach_cells = reach_cells
        self._max_count = max_count
        if cleared:
            self.clear(0.0, 0.0)

    def clear(self, centre_x_m: float, centre_y_m: float) -> None:
        at_once(lambda share: self.clear_slowly(centre_x_m, centre_y_m, share))

    def clear_slowly(self, centre_x_m: float, centre_y_m: float, share: Share) -> Task:
        """The map is of no use until the task has come to its end."""
        dirty, used = self._dirty, self.used
        origin_m = self.origin_x_m, self.origin_y_m
        yield from share.spread(
            lambda s, b: _kernels.mark_tiles(self.surfels, used, *origin_m, self.cell_m, self.reach_cells, dirty, s, b),
            np.zeros(1, np.int64),
            used,
        )
        yield from share.spread(
            lambda s, b: _kernels.clear_tiles(dirty, self.nearest, self.distance2, s, b),
            np.zeros(1, np.int64),
            dirty.size,
        )
        self.used = 0
        self.origin_x_m = centre_x_m - 0.5 * self.size_m
        self.origin_y_m = centre_y_m - 0.5 * self.size_m

    def insert(
        self,
        points_m: NDArray[np.float64] | NDArray[np.float32],
        normals: NDArray[np.float64] | NDArray[np.float32],
        pose: NDArray[np.float64],
    ) -> int:
        """`points_m`, `normals`: (N, 2), robot frame; `pose`: (3,), the robot in the window's frame.

        Returns about how much work it was, in products of two 3 × 3 blocks.
        """
        before = self.used
        self.used = _kernels.stamp(
            points_m,
            normals,
            pose,
            self.origin_x_m,
            self.origin_y_m,
            self.cell_m,
            self.reach_cells,
            self._max_count,
            self.nearest,
            self.distance2,
            self.surfels,
            self.used,
        )
        return _UNITS_PER_SCAN + len(points_m) + _UNITS_PER_SURFEL * (self.used - before)

    def surfel_means_m(self) -> NDArray[np.float64]:
        """(S, 2) in the window's frame."""
        used = self.surfels[: self.used]
        return np.asarray(used[:, 1:3] / used[:, :1])
