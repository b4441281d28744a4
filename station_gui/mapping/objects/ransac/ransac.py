"""Steps 3 and 4: reference lines through occupied cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.objects.config import ReferenceConfig
from station_gui.mapping.objects.ransac import _kernels

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FINE_CELLS = 0.75  # a straight front's cells lie so near its line
_MOST_LINES = 2000  # bounds time and memory


class LineFitter:
    """Algorithm 2, then least squares through the inliers: a line through two cells is no better than their size.

    The random numbers are drawn once, so that lines depend on their points alone.
    """

    def __init__(self, config: ReferenceConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._draws = rng.random((config.most_iterations, 2))

    def fit(self, points_m: FloatArray, owners: IntArray, cell_m: float) -> tuple[FloatArray, IntArray]:
        """(R, 2, 2) the lines through the points (N, 2) of each cluster, and (R,) these clusters.

        `owners`: (N,) the cluster of each point, counted from 0, -1 for none.
        """
        config, clusters = self._config, int(owners.max(initial=-1)) + 1
        lines_m = np.zeros((_MOST_LINES, 2, 2))
        line_owners = np.zeros(_MOST_LINES, np.int64)
        left_m, near_m, run_m = np.zeros((3, *points_m.shape))
        count = _kernels.fit_lines(
            points_m, owners, clusters, self._draws, config.iterations_per_node, config.inlier_m,
            _FINE_CELLS * cell_m, max(config.line_reach_m, 3 * cell_m), config.min_nodes, config.lines_a_cluster,
            left_m, near_m, run_m, lines_m, line_owners,
        )  # fmt: skip
        return lines_m[:count], line_owners[:count]
