"""The maps of all particles, in blocks that they share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.matching.scan_matcher import LineScan
from station_gui.mapping.slam2d.particle.blocks import _kernels
from station_gui.mapping.slam2d.particle.blocks._kernels import Blocks


@dataclass(frozen=True, slots=True)
class BlockMapConfig:
    cell_m: float = 0.05  # iris_lama's grid
    reach_cells: int = 7  # a scan may be this far off and still find its surfel
    max_count: int = 100  # older hits of a cell fade after this many
    max_places: int = 60_000  # blocks of 16 × 16 cells that the plane has for all particles,
    max_blocks: int = 100_000  # and that memory holds: 3.3 kB each
    own_blocks: int = 20_000  # what particles may differ in, all together, before they are resampled

    def __post_init__(self) -> None:
        if not 1 <= self.reach_cells <= _kernels.MAX_REACH:
            raise ValueError(f"reach_cells must be 1 to {_kernels.MAX_REACH}, not {self.reach_cells}")
        if self.cell_m <= 0.0 or self.max_places < 1 or self.max_blocks < 1:
            raise ValueError("cell_m, max_places and max_blocks must be positive")


class BlockMaps:
    """Copy on write: a particle that is resampled costs a row of the directory, not a map.

    One map more than there are particles is spare.
    """

    def __init__(self, config: BlockMapConfig, particles: int) -> None:
        self._config = config
        self._spare = particles
        side, blocks = _kernels.SIDE, config.max_blocks
        self._all_ages = np.ones(_kernels.AGES, np.uint8)
        table = 1 << (2 * config.max_places).bit_length()
        self.blocks = Blocks(
            keys=np.full(table, -1, np.int64),
            places=np.zeros(table, np.int32),
            directory=np.full((particles + 1, config.max_places), -1, np.int32),
            nearest=np.empty((blocks, side, side), np.uint8),
            surfels=np.empty((blocks, side, side, 6), np.int16),
            references=np.zeros(blocks, np.int32),
            free=np.arange(blocks - 1, -1, -1, dtype=np.int32),
            counts=np.array([0, blocks], np.int64),
            joined=np.ones(_kernels.AGES, np.uint8),
        )

    @property
    def cell_m(self) -> float:
        return self._config.cell_m

    @property
    def blocks_in_use(self) -> int:
        return len(self.blocks.free) - int(self.blocks.counts[1])

    @property
    def places_in_use(self) -> int:
        return int(self.blocks.counts[0])

    @property
    def crowded(self) -> bool:
        """The particles' maps differ in more than was allowed, or fewer than an eighth of the blocks are free."""
        shared = 2 * self.places_in_use  # one map, and the spare one
        return self.blocks_in_use > min(shared + self._config.own_blocks, len(self.blocks.free) * 7 // 8)

    def insert(self, particle: int, scan: LineScan, pose: NDArray[np.float64], age: int = 0) -> None:
        """`pose`: (3,), the robot in the particle's map. What finds no room is left out."""
        self._stamp(self.blocks, particle, scan, pose, age)

    def join(self, ages: NDArray[np.bool_]) -> None:
        """(A,): which ages' surfels count; those that are not named do."""
        self.blocks.joined[:] = _by_age(ages)

    def adopt(self, parents: NDArray[np.int64]) -> None:
        """Particle i goes on with the map of `parents[i]`."""
        before = self.blocks.directory[:, : self.places_in_use].copy()
        _kernels.adopt(self.blocks, before, np.append(parents, self._spare))

    def draw_spare(self, scan: LineScan, pose: NDArray[np.float64], age: int, joined: NDArray[np.bool_] | None) -> None:
        """Like `insert`, into the spare map; `joined`, (A,): the ages that count in it, None for all."""
        ages = self._all_ages if joined is None else _by_age(joined)
        self._stamp(self.blocks._replace(joined=ages), self._spare, scan, pose, age)

    def adopt_spare(self) -> None:
        """All particles go on with the spare map, which becomes empty."""
        before = self.blocks.directory[:, : self.places_in_use].copy()
        _kernels.adopt(self.blocks, before, np.full(self._spare + 1, self._spare))
        self.clear_spare()

    def clear_spare(self) -> None:
        _kernels.release(self.blocks, self._spare)

    def _stamp(self, blocks: Blocks, particle: int, scan: LineScan, pose: NDArray[np.float64], age: int) -> None:
        config = self._config
        _kernels.stamp(
            blocks, particle, scan.points_m, scan.normals, pose, config.cell_m, config.reach_cells, config.max_count,
            min(age, _kernels.AGES - 1),
        )  # fmt: skip

    def surfel_means_m(self, particle: int) -> NDArray[np.float64]:
        """(S, 2): the means of a particle's surfels, in the order of the places."""
        directory = self.blocks.directory[particle]
        corners = np.zeros((len(directory), 2), np.int64)
        used = self.blocks.keys >= 0
        keys = self.blocks.keys[used]
        wide = 2 * _kernels.FARTHEST_BLOCK
        rows_and_columns = np.column_stack((keys % wide, keys // wide)) - _kernels.FARTHEST_BLOCK
        corners[self.blocks.places[used]] = rows_and_columns * _kernels.SIDE
        places = np.flatnonzero(directory >= 0)
        cells = self.blocks.surfels[directory[places]]
        place, row, column = np.nonzero(cells[..., 0] > 0)
        corner = corners[places[place]] + np.column_stack((column, row))
        return np.asarray((corner + cells[place, row, column, 1:3] / _kernels.UNIT) * self.cell_m)


def _by_age(ages: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(AGES,): one for those that count, and for those that are not named."""
    result = np.ones(_kernels.AGES, np.uint8)
    count = min(len(ages), _kernels.AGES)
    result[:count] = ages[:count]
    return result
