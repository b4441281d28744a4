"""Steps 3 and 4: reference lines through occupied cells."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.objects.config import ReferenceConfig
from station_gui.mapping.objects.ransac import _kernels

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FINE_CELLS = 0.75  # a straight front's cells lie so near its line
_MOST_KNOWN = 2000  # clusters that are remembered; bounds memory


class LineFitter:
    """Algorithm 2, then least squares through the inliers: a line through two cells is no better than their size.

    The random numbers are drawn once, so that lines depend on their points alone, and the same points are not fitted
    again.
    """

    def __init__(self, config: ReferenceConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._draws = rng.random((config.most_iterations, 2))
        self._known: dict[tuple[float, bytes], FloatArray] = {}
        self._older: dict[tuple[float, bytes], FloatArray] = {}

    def fit(self, points_m: FloatArray, owners: IntArray, cell_m: float) -> tuple[FloatArray, IntArray]:
        """(R, 2, 2) the lines through the points (N, 2) of each cluster, and (R,) these clusters.

        `owners`: (N,) the cluster of each point, -1 for none.
        """
        order = np.argsort(owners, kind="stable")
        order = order[np.searchsorted(owners[order], 0) :]
        sorted_m = points_m[order]
        clusters, first = np.unique(owners[order], return_index=True)
        bounds = itertools.pairwise([*first.tolist(), len(order)])
        lines = [self._lines(sorted_m[begin:end], cell_m) for begin, end in bounds]
        found = np.repeat(clusters, [len(each) for each in lines])
        return np.concatenate([np.zeros((0, 2, 2)), *lines]), found

    def _lines(self, points_m: FloatArray, cell_m: float) -> FloatArray:
        key = (cell_m, points_m.tobytes())
        found = self._known.get(key)
        if found is None:
            found = self._older.get(key)
            if found is None:
                found = self._fitted(points_m, cell_m)
            if len(self._known) == _MOST_KNOWN:
                self._known, self._older = {}, self._known
            self._known[key] = found
        return found

    def _fitted(self, points_m: FloatArray, cell_m: float) -> FloatArray:
        config = self._config
        lines_m = np.zeros((config.lines_a_cluster, 2, 2))
        left_m, near_m, run_m = np.zeros((3, *points_m.shape))
        count = _kernels.fit_lines(
            points_m, self._draws, config.iterations_per_node, config.inlier_m, _FINE_CELLS * cell_m,
            max(config.line_reach_m, 3 * cell_m), config.min_nodes, left_m, near_m, run_m, lines_m,
        )  # fmt: skip
        return lines_m[:count]
