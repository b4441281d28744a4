"""Steps 2 and 4: which lines belong together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.objects.dbscan import _kernels

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Density:
    """`turn_rad` is θTh, `reach_m` dEps, `min_objects` minObj of table 5; `offset_weight` as in `line_distance`."""

    turn_rad: float
    reach_m: float
    min_objects: int
    offset_weight: float


def cluster_lines(ends_m: FloatArray, objects: IntArray, density: Density) -> IntArray:
    """(N,) the cluster of each line, counted from 0; -1 for noise.

    `ends_m`: (N, 2, 2) from above, `objects`: (N,) how many seen objects each line stands for.
    """
    labels = np.full(len(ends_m), -1, np.int64)
    if len(ends_m):
        order = np.argsort(ends_m[:, :, 0].min(axis=1), kind="stable")
        _kernels.dbscan(
            np.ascontiguousarray(ends_m), objects, order, density.turn_rad, density.reach_m, density.min_objects,
            density.offset_weight, np.zeros(len(ends_m), np.int64), labels,
        )  # fmt: skip
    return labels


def nearest_clusters(points_m: FloatArray, ends_m: FloatArray, labels: IntArray, reach_m: float) -> IntArray:
    """(M,) the cluster of the line that is nearest to each point, (M, 2); -1 where none is within `reach_m`."""
    owner = np.zeros(len(points_m), np.int64)
    order = np.argsort(points_m[:, 1], kind="stable")
    _kernels.nearest_cluster(
        points_m, order, np.ascontiguousarray(ends_m), labels, reach_m, np.zeros(len(points_m)), owner
    )
    return owner
