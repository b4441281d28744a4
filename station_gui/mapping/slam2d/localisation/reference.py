"""The whole map, as a robot looks for itself in it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from station_gui.mapping.slam2d.config import MatchConfig
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.localisation.config import ReferenceConfig
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import ScanMatcher
from station_gui.mapping.slam2d.search.branch_and_bound import Pyramid, build_pyramid
from station_gui.mapping.snapshot import GridMap

_NO_FADING = math.inf
_LARGEST_REACH_CELLS = 15  # squared distances are kept in eight bits


class Reference:
    """Surfels, likelihoods and free space of all scans; made a few scans at a time, then never changed."""

    def __init__(
        self,
        config: ReferenceConfig,
        match: MatchConfig,
        keyframes: Sequence[Keyframe],
        poses: NDArray[np.float64],
        grid: GridMap,
    ) -> None:
        """`poses`: (K, 3) of the keyframes, map frame."""
        self._config = config
        self.grid = grid
        rows, columns = grid.probability.shape
        width_m, height_m = columns * grid.cell_m, rows * grid.cell_m
        side_m = max(width_m, height_m) + 2 * config.margin_m
        cell_m = config.cell_m
        while (side_m / cell_m) ** 2 > config.max_cells:
            cell_m *= 2
        reach = min(max(2, math.ceil(config.reach_m / cell_m)), _LARGEST_REACH_CELLS)
        hits = sum(len(keyframe.points_m) for keyframe in keyframes)
        self.local_map = LocalMap(side_m, cell_m, reach, min(max(hits, 1), config.max_surfels), _NO_FADING)
        self.local_map.clear(grid.origin_m[0] + 0.5 * width_m, grid.origin_m[1] + 0.5 * height_m)
        self.matcher = ScanMatcher(match, reach, cell_m)
        self._waiting = list(zip(keyframes, poses, strict=True))[::-1]
        self._pyramid: Pyramid | None = None
        self._free: NDArray[np.uint8] | None = None

    def step(self) -> bool:
        """Draw some more scans; True once the map can be searched."""
        if self._pyramid is not None and self._free is not None:
            return True
        for _ in range(min(self._config.scans_per_step, len(self._waiting))):
            keyframe, pose = self._waiting.pop()
            scan = keyframe.lines()
            self.local_map.insert(scan.points_m, scan.normals, pose)
        if self._waiting:
            return False
        if self._pyramid is None:
            self._pyramid = self._likelihoods()
        else:
            self._free = self._free_places(self._pyramid)
        return False

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

    def _free_places(self, pyramid: Pyramid) -> NDArray[np.uint8]:
        """Cells near to one that was seen to be free."""
        grid, cell_m = self.grid, pyramid.cell_m
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
