"""The whole map, as a robot looks for itself in it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from shared.geometry.se2 import Pose2
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.slam2d.config import GridConfig, MatchConfig
from station_gui.mapping.slam2d.grid.occupancy_grid import OccupancyGrid
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.localisation.config import ReferenceConfig
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import ScanMatcher
from station_gui.mapping.slam2d.search.branch_and_bound import Pyramid, build_pyramid
from station_gui.mapping.snapshot import GridMap

FloatArray = NDArray[np.float64]

_NO_FADING = math.inf
_LARGEST_REACH_CELLS = 15  # squared distances are kept in eight bits


class Reference:
    """Surfels, likelihoods and free space of all scans; made a few scans at a time, then never changed."""

    def __init__(
        self,
        config: ReferenceConfig,
        match: MatchConfig,
        grid: GridConfig,
        keyframes: Sequence[Keyframe],
        poses: FloatArray,
    ) -> None:
        """`poses`: (K, 3) of the keyframes, map frame."""
        self._config = config
        self._drawn = OccupancyGrid(grid)
        low, high = _extent(keyframes, poses)
        side_m = float((high - low).max()) + 2 * config.margin_m
        cell_m = config.cell_m
        while (side_m / cell_m) ** 2 > config.max_cells:
            cell_m *= 2
        reach = min(max(2, math.ceil(config.reach_m / cell_m)), _LARGEST_REACH_CELLS)
        hits = sum(len(keyframe.points_m) for keyframe in keyframes)
        self.local_map = LocalMap(side_m, cell_m, reach, min(max(hits, 1), config.max_surfels), _NO_FADING)
        self.local_map.clear(*(0.5 * (low + high)).tolist())
        self.matcher = ScanMatcher(match, reach, cell_m)
        self._waiting = list(zip(keyframes, poses, strict=True))[::-1]
        self._pyramid: Pyramid | None = None
        self._grid: GridMap | None = None
        self._free: NDArray[np.uint8] | None = None

    def step(self) -> bool:
        """Draw some more scans; True once the map can be searched."""
        if self._pyramid is not None and self._free is not None:
            return True
        batch = [self._waiting.pop() for _ in range(min(self._config.scans_per_step, len(self._waiting)))]
        for keyframe, pose in batch:
            scan = keyframe.lines()
            self.local_map.insert(scan.points_m, scan.normals, pose)
        with contextlib.suppress(MappingError):  # a map too large for a grid is judged by its surfels alone
            self._drawn.add_all([keyframe for keyframe, _ in batch], np.array([pose for _, pose in batch]))
        if self._waiting:
            return False
        if self._pyramid is None:
            self._pyramid = self._likelihoods()
        else:
            self._grid = self._drawn.snapshot()
            self._free = self._free_places(self._pyramid, self._grid)
        return False

    @property
    def grid(self) -> GridMap:
        assert self._grid is not None, "the reference is not ready"
        return self._grid

    @property
    def pyramid(self) -> Pyramid:
        assert self._pyramid is not None, "the reference is not ready"
        return self._pyramid

    @property
    def free(self) -> NDArray[np.uint8]:
        """(L, H, W): a pyramid of where a scanner may be; 1 where it may."""
        assert self._free is not None, "the reference is not ready"
        return self._free

    def _likelihoods(self) -> Pyramid:
        local_map, config = self.local_map, self._config
        cell_m = local_map.cell_m
        while (local_map.size_m / cell_m) ** 2 > config.search_cells:
            cell_m *= 2
        return build_pyramid(*self.matcher.likelihood(local_map, cell_m), config.depth)

    def _free_places(self, pyramid: Pyramid, grid: GridMap) -> NDArray[np.uint8]:
        """Cells near to one that was seen to be free."""
        cell_m = pyramid.cell_m
        rows, columns = np.nonzero(grid.probability < self._config.free_below)
        x = grid.origin_m[0] + (columns + 0.5) * grid.cell_m
        y = grid.origin_m[1] + (rows + 0.5) * grid.cell_m
        free = np.zeros_like(pyramid.levels[0])
        column = np.floor((x - pyramid.origin_m[0]) / cell_m).astype(np.int64)
        row = np.floor((y - pyramid.origin_m[1]) / cell_m).astype(np.int64)
        inside = (column >= 0) & (row >= 0) & (column < free.shape[1]) & (row < free.shape[0])
        free[row[inside], column[inside]] = 1
        away = ndimage.distance_transform_edt(free == 0) * cell_m
        return build_pyramid(
            (away <= self._config.stand_off_m).astype(np.uint8), pyramid.origin_m, cell_m, self._config.depth
        ).levels


def _extent(keyframes: Sequence[Keyframe], poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The lowest and the highest x and y, (2,) each, of robots and hits."""
    low, high = poses[:, :2].min(axis=0), poses[:, :2].max(axis=0)
    for keyframe, pose in zip(keyframes, poses, strict=True):
        if len(keyframe.points_m):
            hits = Pose2.from_array(pose).apply(keyframe.points_m)
            low, high = np.minimum(low, hits.min(axis=0)), np.maximum(high, hits.max(axis=0))
    return low, high
