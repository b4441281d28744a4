"""Parameters of the particle filter: one set for every log and for the robot.

Where no source is named a value was found on Intel, FR079 and MIT Killian together, the same logs that the figures in
the documentation are of. How weights are scaled and how particles part was found on simulated corridors and looked at
on the first part of FR079.

Weights. The beams of a scan hang on the same few walls and the same errors of the map, and so do the next scans:
counted as independent they let one step decide (the logarithms of 30 particles' factors differ by 5 nats in a step on
FR079, by 3 on Intel and in simulation), and differences between particles come back in the next steps (their sum of
autocorrelations is about 2 steps on FR079, 10 to 25 on Intel, 16 in simulated corridors). GMapping divides the
logarithm by three times the number of particles, 90 for 30 of them. Here one beam in a hundred counts. With 0.0005
there was not one resampling on FR079; with 0.01 there are 53 in 3600 steps there, 27 on Intel and 54 on Killian, and
the mean effective number is 0.8 of the particles. With 0.1 they were resampled once a metre in simulated corridors,
more than diversity stands.

What particles are good for. With loop closing off 30 particles drift 0.26 m (rms over three seeds) round a simulated
corridor of 80 m where one that takes each match drifts 0.32 m. And they find out of a wrong place that one stays in:
see the tests of filtering. With paths that are bent to loops one particle is as accurate as 30 on the public logs (on
FR079 0.030 m both), and on the first 3000 scans of FR079 and 4000 of Intel also without (0.0257 and 0.0162 m with 30,
0.0262 and 0.0158 m with one). The number is for robustness: Grisetti's.
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
    independent_share: float = 0.01  # of the logarithm of a step's factor: see above
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
