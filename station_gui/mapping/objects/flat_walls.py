"""Straight pieces of the 2D map that no 3D edge belongs to: what a robot without a depth camera knows of walls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.objects.config import ReferenceConfig, SurfaceConfig
from station_gui.mapping.objects.dbscan.dbscan import Density, cluster_lines, nearest_clusters
from station_gui.mapping.objects.ransac.ransac import LineFitter
from station_gui.mapping.objects.reference import coordinates, directions

FloatArray = NDArray[np.float64]

_LONG = 1 << 20  # tiles along a side of the largest map


class FlatWalls:
    """Fits lines tile by tile, so that new cells somewhere change nothing elsewhere."""

    def __init__(self, config: SurfaceConfig, reference: ReferenceConfig, fitter: LineFitter) -> None:
        self._config = config
        self._reference = reference
        self._fitter = fitter

    def lines_m(self, nodes_m: FloatArray, reference_m: FloatArray, cell_m: float) -> FloatArray:
        """(R, 2, 2) through those of the occupied cells, (N, 2), that do not lie along a line of `reference_m`."""
        labels = np.zeros(len(reference_m), np.int64)
        rest_m = nodes_m[nearest_clusters(nodes_m, reference_m, labels, self._config.join_m) < 0]
        tile = np.floor(rest_m / self._config.tile_m).astype(np.int64) @ np.array([1, _LONG])
        found_m = self._fitter.fit(rest_m, tile - tile.min(initial=0), cell_m)[0]
        return _continued(found_m, self._reference)


def _continued(lines_m: FloatArray, config: ReferenceConfig) -> FloatArray:
    """Lines that go on in the next tile are one, unless that would not be straight."""
    density = Density(config.turn_rad, config.line_reach_m, 1, config.line_offset_weight)
    labels = cluster_lines(lines_m, np.ones(len(lines_m), np.int64), density)
    size = np.bincount(labels, minlength=1)
    found = [lines_m[size[labels] == 1]]
    for label in np.flatnonzero(size > 1).tolist():
        parts_m = lines_m[labels == label]
        whole_m = _through(parts_m)
        along, _ = directions(whole_m[None])
        off_m = np.abs(coordinates(parts_m.reshape(-1, 2), whole_m[None], along)[1])
        found.append(whole_m[None] if off_m.max() <= config.same_m else parts_m)
    return np.concatenate(found)


def _through(parts_m: FloatArray) -> FloatArray:
    """(2, 2): total least squares through the ends of segments (K, 2, 2), weighted by their lengths."""
    weight = np.repeat(directions(parts_m)[1], 2)
    points_m = parts_m.reshape(-1, 2)
    middle_m = (weight[:, None] * points_m).sum(axis=0) / weight.sum()
    away = points_m - middle_m
    xx, xy, yy = (weight * away[:, 0] ** 2).sum(), (weight * away.prod(axis=1)).sum(), (weight * away[:, 1] ** 2).sum()
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    along = np.array([np.cos(angle), np.sin(angle)])
    at = away @ along
    return np.array([middle_m + at.min() * along, middle_m + at.max() * along])
