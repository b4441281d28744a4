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
    max_count: float = 100.0  # older hits of a cell fade after this many
    max_places: int = 60_000  # blocks of 16 × 16 cells that the plane has for all particles,
    max_blocks: int = 120_000  # and that memory holds: 5.4 kB each

    def __post_init__(self) -> None:
        if not 1 <= self.reach_cells <= _kernels.MAX_REACH:
            raise ValueError(f"reach_cells must be 1 to {_kernels.MAX_REACH}, not {self.reach_cells}")
        if self.cell_m <= 0.0 or self.max_places < 1 or self.max_blocks < 1:
            raise ValueError("cell_m, max_places and max_blocks must be positive")


class BlockMaps:
    """Copy on write: a particle that is resampled costs a row of the directory, not a map."""

    def __init__(self, config: BlockMapConfig, particles: int) -> None:
        self._config = config
        side, blocks = _kernels.SIDE, config.max_blocks
        table = 1 << (2 * config.max_places).bit_length()
        self.blocks = Blocks(
            keys=np.full(table, -1, np.int64),
            places=np.zeros(table, np.int32),
            directory=np.full((particles, config.max_places), -1, np.int32),
            nearest=np.empty((blocks, side, side), np.uint8),
            surfels=np.empty((blocks, side, side, 5), np.float32),
            references=np.zeros(blocks, np.int32),
            free=np.arange(blocks - 1, -1, -1, dtype=np.int32),
            counts=np.array([0, blocks], np.int64),
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
    def nearly_full(self) -> bool:
        """Fewer than an eighth of the blocks are free."""
        return 8 * int(self.blocks.counts[1]) < len(self.blocks.free)

    def insert(self, particle: int, scan: LineScan, pose: NDArray[np.float64]) -> None:
        """`pose`: (3,), the robot in the particle's map. What finds no room is left out."""
        config = self._config
        _kernels.stamp(
            self.blocks, particle, scan.points_m, scan.normals, pose, config.cell_m, config.reach_cells,
            config.max_count,
        )  # fmt: skip

    def adopt(self, parents: NDArray[np.int64]) -> None:
        """Particle i goes on with the map of `parents[i]`."""
        _kernels.adopt(self.blocks, self.blocks.directory[:, : self.places_in_use].copy(), parents)

    def surfel_means_m(self, particle: int) -> NDArray[np.float64]:
        """(S, 2): the means of a particle's surfels, in the order of the blocks."""
        ids = np.sort(self.blocks.directory[particle, : self.places_in_use])
        cells = self.blocks.surfels[ids[ids >= 0]].reshape(-1, 5)
        return cells[cells[:, 0] > 0, 1:3].astype(np.float64)
