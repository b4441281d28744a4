"""Parameters of the particle filter: one set for every log and for the robot.

Where no source is named a value was found on all logs at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from station_gui.mapping.slam2d.config import GridConfig, NormalConfig
from station_gui.mapping.slam2d.particle.blocks.block_maps import BlockMapConfig
from station_gui.mapping.slam2d.particle.closing.loop_closer import ClosingConfig
from station_gui.mapping.slam2d.particle.proposal.proposer import ProposalConfig


@dataclass(frozen=True, slots=True)
class UpdateConfig:
    """When the filter takes a step; the scans between two steps ride on the first of them."""

    distance_m: float = 0.1
    turn_rad: float = math.radians(11.5)
    independent_share: float = 0.01  # of the beams: see the module
    resample_share: float = 0.5  # of the particles: resampled when the effective number is below (eq. 20)
    patience_scans: int = 20  # lost for longer than this the map is continued all the same


@dataclass(frozen=True, slots=True)
class ParticleSlamConfig:
    particles: int = 30  # Grisetti et al. 2007, table I: 15 (Intel) to 80 (MIT Killian)
    seed: int = 0
    normals: NormalConfig = field(default_factory=NormalConfig)
    maps: BlockMapConfig = field(default_factory=BlockMapConfig)
    proposal: ProposalConfig = field(default_factory=ProposalConfig)
    update: UpdateConfig = field(default_factory=UpdateConfig)
    closing: ClosingConfig = field(default_factory=ClosingConfig)
    grid: GridConfig = field(default_factory=GridConfig)

    def __post_init__(self) -> None:
        if not 1 <= self.particles <= 1000:
            raise ValueError(f"particles must be 1 to 1000, not {self.particles}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, not {self.seed}")
