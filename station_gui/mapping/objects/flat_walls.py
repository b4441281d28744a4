"""Straight pieces of the 2D map that no 3D edge belongs to: what a robot without a depth camera knows of walls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.objects.config import SurfaceConfig
from station_gui.mapping.objects.dbscan.dbscan import nearest_clusters
from station_gui.mapping.objects.ransac.ransac import LineFitter

FloatArray = NDArray[np.float64]

_LONG = 1 << 20  # tiles along a side of the largest map


class FlatWalls:
    """Fits lines tile by tile; a tile whose cells are as they were is not fitted again, which changes nothing else."""

    def __init__(self, config: SurfaceConfig, fitter: LineFitter) -> None:
        self._config = config
        self._fitter = fitter
        self._known: dict[int, tuple[bytes, FloatArray]] = {}

    def lines_m(self, nodes_m: FloatArray, reference_m: FloatArray, cell_m: float) -> FloatArray:
        """(R, 2, 2) through those of the occupied cells, (N, 2), that do not lie along a line of `reference_m`."""
        labels = np.zeros(len(reference_m), np.int64)
        rest_m = nodes_m[nearest_clusters(nodes_m, reference_m, labels, self._config.join_m) < 0]
        tile = np.floor(rest_m / self._config.tile_m).astype(np.int64) @ np.array([1, _LONG])
        order = np.argsort(tile, kind="stable")
        rest_m, tile = rest_m[order], tile[order]
        names, first = np.unique(tile, return_index=True)
        now: dict[int, tuple[bytes, FloatArray]] = {}
        for name, cells_m in zip(names.tolist(), np.split(rest_m, first[1:]), strict=True):
            content = cells_m.tobytes()
            known = self._known.get(name)
            now[name] = known if known is not None and known[0] == content else (content, self._fit(cells_m, cell_m))
        self._known = now
        found = [lines for _, lines in now.values()]
        return np.concatenate(found) if found else np.zeros((0, 2, 2))

    def _fit(self, cells_m: FloatArray, cell_m: float) -> FloatArray:
        return self._fitter.fit(cells_m, np.zeros(len(cells_m), np.int64), cell_m)[0]
