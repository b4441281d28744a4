"""The whole map, as a robot looks for itself in it."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import GridConfig, MatchConfig
from station_gui.mapping.slam2d.grid import _kernels as grid_kernels
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.localisation.config import ReferenceConfig
from station_gui.mapping.slam2d.localisation.free_space import FreeSpace
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import ScanMatcher
from station_gui.mapping.slam2d.search.branch_and_bound import Pyramid, fill_pyramid
from station_gui.mapping.slam2d.share import Share, Task
from station_gui.mapping.snapshot import GridMap

FloatArray = NDArray[np.float64]

_NO_FADING = math.inf
_ROWS_AT_ONCE = 32
_UNITS_PER_SCAN = 150  # of calling the kernel that goes through its hits
_HITS_PER_UNIT = 3
_CELLS_PER_UNIT = 6  # of the free space
_BYTES_PER_UNIT = 60  # that are copied
_ZEROS_PER_BYTE = 10  # that the system hands out meanwhile
_ROUNDING_CELLS = 4
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
        cell_m, likelihood = yield from self._likelihoods(local_map, matcher)
        corner_m = local_map.origin_x_m, local_map.origin_y_m
        self._pyramid = yield from self._with_rim(likelihood, corner_m, cell_m)
        self._free = yield from self._free_places(likelihood.shape, corner_m, cell_m, self._grid)

    def _extent(self) -> Generator[None, None, tuple[FloatArray, FloatArray]]:
        """The lowest and the highest x and y, (2,) each, of robots and hits that are not too far from all of them."""
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        for keyframe, pose in self._scans:
            if self._share.left <= 0:
                yield
            grid_kernels.widen_box(keyframe.points_m, keyframe.scanner_m, pose, low, high)
            self._share.take(_UNITS_PER_SCAN + len(keyframe.points_m) // _HITS_PER_UNIT)
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

    @property
    def search_reach_m(self) -> float:
        """How far from a place that is free the points of a search may be."""
        return self._config.search_reach_m

    def _likelihoods(
        self, local_map: LocalMap, matcher: ScanMatcher
    ) -> Generator[None, None, tuple[float, NDArray[np.uint8]]]:
        """Of cells of so many metres, (H, W)."""
        cell_m = local_map.cell_m
        while (local_map.size_m / cell_m) ** 2 > self._config.search_cells:
            cell_m *= 2
        factor = round(cell_m / local_map.cell_m)
        side = len(local_map.distance2) // factor
        likelihood = np.zeros((side, side), np.uint8)
        yield from matcher.fill_likelihood(local_map, likelihood, self._share)
        return factor * local_map.cell_m, likelihood

    def _with_rim(
        self, inner: NDArray[np.uint8], corner_m: tuple[float, float], cell_m: float
    ) -> Generator[None, None, Pyramid]:
        """The pyramid of `inner` (H, W) amid zeros, among which those points lie that may be outside it."""
        config, coarsest = self._config, 1 << self._config.depth
        reach_m = config.search_reach_m + config.stand_off_m
        rim = coarsest * math.ceil((reach_m / cell_m + coarsest + _ROUNDING_CELLS) / coarsest)
        core = np.zeros((config.depth + 1, *(side + coarsest for side in inner.shape)), np.uint8)
        core[0, coarsest:, coarsest:] = inner
        yield from fill_pyramid(Pyramid(core, corner_m, cell_m), self._share)
        levels = np.zeros((config.depth + 1, *(side + 2 * rim for side in inner.shape)), np.uint8)
        levels[:, rim - coarsest : -rim, rim - coarsest : -rim] = core
        self._share.take((core.size + levels.size // _ZEROS_PER_BYTE) // _BYTES_PER_UNIT)
        return Pyramid(levels, (corner_m[0] - rim * cell_m, corner_m[1] - rim * cell_m), cell_m)

    def _free_places(
        self, shape: tuple[int, int], corner_m: tuple[float, float], cell_m: float, grid: GridMap
    ) -> Generator[None, None, NDArray[np.uint8]]:
        """Cells near to one that was seen to be free, `shape` of them; as of `_with_rim`."""
        known, free = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
        for first in range(0, len(grid.probability), _ROWS_AT_ONCE):
            if self._share.left <= 0:
                yield
            band = grid.probability[first : first + _ROWS_AT_ONCE]
            rows, columns = np.nonzero(band < self._config.free_below)
            x = grid.origin_m[0] + (columns + 0.5) * grid.cell_m
            y = grid.origin_m[1] + (rows + first + 0.5) * grid.cell_m
            column = np.floor((x - corner_m[0]) / cell_m).astype(np.int64)
            row = np.floor((y - corner_m[1]) / cell_m).astype(np.int64)
            inside = (column >= 0) & (row >= 0) & (column < shape[1]) & (row < shape[0])
            known[row[inside], column[inside]] = 1
            self._share.take(band.size // _CELLS_PER_UNIT)
        _widen(known, self._config.stand_off_m / cell_m, free)
        return (yield from self._with_rim(free, corner_m, cell_m)).levels


def _widen(marked: NDArray[np.uint8], by_cells: float, widened: NDArray[np.uint8]) -> None:
    """Cells of `widened` (H, W) no farther from one that is `marked` become 1."""
    reach = math.floor(by_cells)
    height, width = marked.shape
    framed = np.pad(marked, reach)
    for down in range(2 * reach + 1):
        for right in range(2 * reach + 1):
            if math.hypot(down - reach, right - reach) <= by_cells:
                np.maximum(widened, framed[down : down + height, right : right + width], out=widened)


def newest_of_each_place(poses: FloatArray, spacing_m: float, spacing_rad: float) -> NDArray[np.int64]:
    """Indices into `poses`, (K, 3), ascending: the last one of each square of `spacing_m` and turn."""
    place = np.floor(poses / (spacing_m, spacing_m, spacing_rad)).astype(np.int64)
    place -= place.min(axis=0, initial=0)
    spans = place.max(axis=0, initial=0) + 1
    number = (place[:, 0] * spans[1] + place[:, 1]) * spans[2] + place[:, 2]
    from_end = np.unique(number[::-1], return_index=True)[1]
    return np.asarray(np.sort(len(poses) - 1 - from_end))
