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

_ROWS_AT_ONCE = 32
_CELLS_PER_UNIT = 20
_UNITS_PER_SCAN = 400
_UNITS_PER_SURFEL = 10


class LocalMap:
    """Square window of `size_m` in some frame; grows nowhere, forgets nothing until `clear`."""

    def __init__(self, size_m: float, cell_m: float, reach_cells: int, max_surfels: int, max_count: float) -> None:
        side = round(size_m / cell_m)
        self.cell_m = cell_m
        self.size_m = side * cell_m
        self.nearest = np.empty((side, side), np.int32)
        self.distance2 = np.empty((side, side), np.uint8)
        self.surfels = np.empty((max_surfels, 5))
        self._reach_cells = reach_cells
        self._max_count = max_count
        self.clear(0.0, 0.0)

    def clear(self, centre_x_m: float, centre_y_m: float) -> None:
        at_once(lambda share: self.clear_slowly(centre_x_m, centre_y_m, share))

    def clear_slowly(self, centre_x_m: float, centre_y_m: float, share: Share) -> Task:
        """The map is of no use until the task has come to its end."""
        self.used = 0
        self.origin_x_m = centre_x_m - 0.5 * self.size_m
        self.origin_y_m = centre_y_m - 0.5 * self.size_m
        for row in range(0, len(self.nearest), _ROWS_AT_ONCE):
            if share.left <= 0:
                yield
            self.nearest[row : row + _ROWS_AT_ONCE].fill(-1)
            self.distance2[row : row + _ROWS_AT_ONCE].fill(_kernels.NONE_NEAR)
            share.take(_ROWS_AT_ONCE * len(self.nearest) // _CELLS_PER_UNIT)

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
            self._reach_cells,
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
