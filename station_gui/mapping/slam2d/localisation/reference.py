"""The whole map, as a robot looks for itself in it."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from shared.geometry.se2 import Pose2
from station_gui.mapping.slam2d.config import GridConfig, MatchConfig
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.localisation.config import ReferenceConfig
from station_gui.mapping.slam2d.localisation.free_space import FreeSpace
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import ScanMatcher
from station_gui.mapping.slam2d.search.branch_and_bound import Pyramid, build_pyramid, fill_pyramid
from station_gui.mapping.slam2d.share import Share, Task
from station_gui.mapping.snapshot import GridMap

FloatArray = NDArray[np.float64]

_NO_FADING = math.inf
_ROWS_AT_ONCE = 32
_UNITS_PER_SCAN = 1500
_CELLS_PER_UNIT = 6  # of the free space
_LARGEST_REACH_CELLS = 15  # squared distances are kept in eight bits


class Reference:
    """Surfels, likelihoods and free space of the scans; made a share at a time, then never changed."""

    def __init__(
        self,
        config: ReferenceConfig,
        match: MatchConfig,
        grid: GridConfig,
        keyframes: Sequence[Keyframe],
        poses: FloatArray,
    ) -> None:
        """`poses`: (K, 3) of the keyframes, map frame. Of those at one place the newest is drawn."""
        self._config = config
        self._match = match
        self._grid_config = grid
        kept = newest_of_each_place(poses, config.spacing_m, config.spacing_rad)
        self._scans = [(keyframes[k], poses[k]) for k in kept.tolist()]
        self._share = Share()
        self._task: Task | None = self._make()
        self._local_map: LocalMap | None = None
        self._matcher: ScanMatcher | None = None
        self._pyramid: Pyramid | None = None
        self._grid: GridMap | None = None
        self._free: NDArray[np.uint8] | None = None

    def step(self, units: int) -> bool:
        """Make some more of it; True once the map can be searched."""
        if self._task is None:
            return True
        if self._share.run(self._task, units):
            self._task = None
            self._scans = []
        return False

    def _make(self) -> Task:
        share = self._share
        low, high = yield from self._extent()
        local_map, matcher = self._windows(low, high)
        centre = 0.5 * (low + high)
        yield from local_map.clear_slowly(float(centre[0]), float(centre[1]), share)
        config = self._config
        drawn = FreeSpace(self._grid_config, config.grid_cell_m, config.max_grid_cells, low, high)
        for keyframe, pose in self._scans:
            if share.left <= 0:
                yield
            share.take(local_map.insert(keyframe.points_m, keyframe.normals, pose))
            share.take(drawn.draw(keyframe, pose))
        self._local_map, self._matcher = local_map, matcher
        yield from drawn.fill(share)
        self._grid = drawn.grid()
        self._pyramid = yield from self._likelihoods(local_map, matcher)
        self._free = yield from self._free_places(self._pyramid, self._grid)

    def _extent(self) -> Generator[None, None, tuple[FloatArray, FloatArray]]:
        """The lowest and the highest x and y, (2,) each, of robots and hits that are not too far from all of them."""
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        for keyframe, pose in self._scans:
            if self._share.left <= 0:
                yield
            place = Pose2.from_array(pose)
            hits = np.vstack((place.apply(keyframe.scanner_m[None]), place.apply(keyframe.points_m)))
            low, high = np.minimum(low, hits.min(axis=0)), np.maximum(high, hits.max(axis=0))
            self._share.take(_UNITS_PER_SCAN + len(hits))
        scanners, away_m = np.array([pose[:2] for _, pose in self._scans]), self._config.far_m
        return np.maximum(low, scanners.min(axis=0) - away_m), np.minimum(high, scanners.max(axis=0) + away_m)

    def _windows(self, low: FloatArray, high: FloatArray) -> tuple[LocalMap, ScanMatcher]:
        """The map is still to be cleared."""
        config = self._config
        side_m = float((high - low).max()) + 2 * config.margin_m
        cell_m = config.cell_m
        while (side_m / cell_m) ** 2 > config.max_cells:
            cell_m *= 2
        reach = min(max(2, math.ceil(config.reach_m / cell_m)), _LARGEST_REACH_CELLS)
        hits = sum(len(keyframe.points_m) for keyframe, _ in self._scans)
        surfels = min(max(hits, 1), config.max_surfels)
        local_map = LocalMap(side_m, cell_m, reach, surfels, _NO_FADING, cleared=False)
        return local_map, ScanMatcher(self._match, reach, cell_m)

    @property
    def local_map(self) -> LocalMap:
        assert self._local_map is not None, "the reference is not ready"
        return self._local_map

    @property
    def matcher(self) -> ScanMatcher:
        assert self._matcher is not None, "the reference is not ready"
        return self._matcher

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

    def _likelihoods(self, local_map: LocalMap, matcher: ScanMatcher) -> Generator[None, None, Pyramid]:
        config = self._config
        cell_m = local_map.cell_m
        while (local_map.size_m / cell_m) ** 2 > config.search_cells:
            cell_m *= 2
        factor = round(cell_m / local_map.cell_m)
        side = len(local_map.distance2) // factor
        levels = np.zeros((config.depth + 1, side, side), np.uint8)
        yield from matcher.fill_likelihood(local_map, levels[0], self._share)
        pyramid = Pyramid(levels, (local_map.origin_x_m, local_map.origin_y_m), factor * local_map.cell_m)
        yield from fill_pyramid(pyramid, self._share)
        return pyramid

    def _free_places(self, pyramid: Pyramid, grid: GridMap) -> Generator[None, None, NDArray[np.uint8]]:
        """Cells near to one that was seen to be free."""
        cell_m = pyramid.cell_m
        free = np.zeros_like(pyramid.levels[0])
        for first in range(0, len(grid.probability), _ROWS_AT_ONCE):
            if self._share.left <= 0:
                yield
            band = grid.probability[first : first + _ROWS_AT_ONCE]
            rows, columns = np.nonzero(band < self._config.free_below)
            x = grid.origin_m[0] + (columns + 0.5) * grid.cell_m
            y = grid.origin_m[1] + (rows + first + 0.5) * grid.cell_m
            column = np.floor((x - pyramid.origin_m[0]) / cell_m).astype(np.int64)
            row = np.floor((y - pyramid.origin_m[1]) / cell_m).astype(np.int64)
            inside = (column >= 0) & (row >= 0) & (column < free.shape[1]) & (row < free.shape[0])
            free[row[inside], column[inside]] = 1
            self._share.take(band.size // _CELLS_PER_UNIT)
        yield
        away = ndimage.distance_transform_edt(free == 0) * cell_m
        yield
        near = (away <= self._config.stand_off_m).astype(np.uint8)
        return build_pyramid(near, pyramid.origin_m, cell_m, self._config.depth).levels


def newest_of_each_place(poses: FloatArray, spacing_m: float, spacing_rad: float) -> NDArray[np.int64]:
    """Indices into `poses`, (K, 3), ascending: the last one of each square of `spacing_m` and turn."""
    place = np.floor(poses / (spacing_m, spacing_m, spacing_rad)).astype(np.int64)
    place -= place.min(axis=0, initial=0)
    spans = place.max(axis=0, initial=0) + 1
    number = (place[:, 0] * spans[1] + place[:, 1]) * spans[2] + place[:, 2]
    from_end = np.unique(number[::-1], return_index=True)[1]
    return np.asarray(np.sort(len(poses) - 1 - from_end))
