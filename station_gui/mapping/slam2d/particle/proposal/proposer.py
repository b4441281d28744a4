"""The improved proposal of Grisetti et al. 2007: a particle goes where its own map says that the scan was made."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.belief import needed_share, odometry_sigma, surprise
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan
from station_gui.mapping.slam2d.particle.blocks.block_maps import BlockMaps
from station_gui.mapping.slam2d.particle.matching import _kernels as matching
from station_gui.mapping.slam2d.particle.proposal import _kernels

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ProposalConfig:
    """Least squares on a particle's map, the samples round the match, and what the odometry is worth."""

    wide_kernel_m: float = 0.2
    fine_kernel_m: float = 0.05
    inlier_m: float = 0.1
    point_weight: float = 0.3  # of a surfel without a normal, against one with
    max_iterations: int = 20
    min_points: int = 12
    max_range_m: float = 100.0  # farther points are of no scanner that maps rooms
    doubtful_share: float = 0.8  # below this share of inliers the neighbourhood is searched
    better_share: float = 0.05  # what the search must win to be believed against the prediction
    lost_share: float = 0.3  # below this the odometry is believed in any case
    far_sigmas: float = 5.0  # of the odometry: a match that is so far off has to be beyond doubt, a nearer one less
    noise_m: float = 0.015  # of one residual, beams of one wall being correlated
    spread: float = 1.0  # of what is drawn, against the standard deviation
    alike_m: float = 3.0  # what is drawn stays alike over this way, as far as a scan sees: see `Deviates`
    sample_spacing: float = 1.7  # standard deviations of the match between the 27 samples
    odometry_shift_m: float = 0.03  # prior: fixed part and part of the way
    odometry_shift_ratio: float = 0.2
    odometry_turn_rad: float = math.radians(1.0)
    odometry_turn_ratio: float = 0.2
    basin_m: float = 0.2  # from where a match is found again, as wide as its kernel
    basin_rad: float = math.radians(8.0)
    misleading_sigmas: float = 3.0  # of the odometry: how far off another particle's match may start this one's
    weak_points: float = 15.0  # a direction that fewer points hold is left to the odometry,
    weak_weight: float = 10.0  # which then weighs as much as this many
    search_shift_m: float = 0.1
    search_shifts: int = 5
    search_turn_rad: float = math.radians(2.0)
    search_turns: int = 10
    search_points: int = 90


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """`pose`: (3,), map frame; `share` of the points that fit; `system`, `prior`: (3, 3), see the kernel `refine`."""

    pose: FloatArray
    share: float
    system: FloatArray
    prior: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Proposed:
    """A particle's next pose, (3,), the logarithm of its weight's factor, and whether the match was believed.

    `information`: (3, 3) of the pose, map frame.
    """

    pose: FloatArray
    log_weight: float
    matched: bool
    information: FloatArray


class Proposer:
    def __init__(self, config: ProposalConfig, maps: BlockMaps) -> None:
        self._config = config
        self._maps = maps
        distance2 = np.arange(64.0)
        self._likelihood = np.exp(-0.5 * distance2 * (maps.cell_m / config.inlier_m) ** 2)

    def odometry_sigma(self, motion: FloatArray) -> FloatArray:
        """(3,): standard deviations of a motion, (3,), that odometry measured."""
        return odometry_sigma(self._config, motion)

    def track(self, particle: int, scan: LineScan, predicted: FloatArray, sigma: FloatArray) -> Matched:
        """The match alone; the neighbourhood is searched where the prediction does not fit."""
        found = self._match(particle, scan, predicted, predicted, sigma)
        if found.share >= self._config.doubtful_share:
            return found
        start = self._search(particle, scan, predicted)
        other = self._match(particle, scan, start, predicted, sigma)
        return other if other.share > found.share + self._config.better_share else found

    def believes(self, match: Matched, predicted: FloatArray, sigma: FloatArray) -> bool:
        """Whether a match deserves it: the farther it is from the prediction the better it has to fit."""
        config = self._config
        far = surprise(predicted, match.pose, sigma) / config.far_sigmas
        return math.isfinite(far) and match.share >= needed_share(config.lost_share, config.doubtful_share, far)

    def may_mislead(self, apart: FloatArray, sigma: FloatArray) -> bool:
        """Whether a match, (3,) `apart` from the odometry, says too little about where other particles are.

        So it is where the odometry is so uncertain that the particles spread over several places that fit, and where
        the match contradicts the odometry: it may be the best particle that is mistaken.
        """
        config = self._config
        wide = max(float(sigma[:2].max()) / config.basin_m, float(sigma[2]) / config.basin_rad) > 1.0
        return wide or float((np.abs(apart) / sigma).max()) > config.misleading_sigmas

    def propose(
        self,
        particle: int,
        scan: LineScan,
        start: FloatArray,
        prior: FloatArray,
        sigma: FloatArray,
        deviates: FloatArray,
        drawn: FloatArray | None = None,
    ) -> Proposed:
        """`start`: (3,), where matching begins; `prior`, `sigma`: (3,), what odometry says; `deviates`: (3,) normal.

        `drawn`: (3,), a draw from the motion model; where the map fits better there than from `start` it is both.
        """
        config = self._config
        match = self._match(particle, scan, start, prior, sigma)
        if drawn is not None:
            other = self._match(particle, scan, drawn, drawn, sigma)
            if other.share > match.share:
                match, start, prior = other, drawn, drawn
        pose = match.pose.copy()
        log_weight = math.nan
        if self.believes(match, prior, sigma):
            log_weight = _kernels.sample_proposal(
                self._maps.blocks, particle, scan.points_m, scan.normals, prior, match.system, match.prior,
                config.noise_m, config.sample_spacing, config.fine_kernel_m, self._maps.cell_m,
                config.spread * deviates, pose,
            )  # fmt: skip
        if math.isfinite(log_weight):
            return Proposed(pose, log_weight, matched=True, information=match.system / config.noise_m**2)
        pose = start + sigma * deviates  # algorithm 1, line 7: the motion model
        log_weight = self._log_likelihood(particle, scan, pose)
        return Proposed(pose, log_weight, matched=False, information=np.diag(1.0 / sigma**2))

    def _log_likelihood(self, particle: int, scan: LineScan, pose: FloatArray) -> float:
        config = self._config
        total = matching.cost_on_map(
            self._maps.blocks, particle, scan.points_m, scan.normals, pose, config.fine_kernel_m, self._maps.cell_m
        )
        volume = 3 * math.log(config.noise_m / math.sqrt(max(len(scan.points_m), 1)))  # about that of a match
        return -0.5 * total / config.noise_m**2 + volume

    def _match(self, particle: int, scan: LineScan, start: FloatArray, prior: FloatArray, sigma: FloatArray) -> Matched:
        config = self._config
        pose, system, prior_matrix = start.copy(), np.zeros((3, 3)), np.zeros((3, 3))
        share = matching.refine(
            self._maps.blocks, particle, scan.points_m, scan.normals, pose, prior, (config.noise_m / sigma) ** 2,
            config.weak_points, config.weak_weight, config.wide_kernel_m, config.fine_kernel_m, config.inlier_m,
            config.point_weight, config.max_iterations, self._maps.cell_m, system, prior_matrix,
        )  # fmt: skip
        return Matched(pose, share, system, prior_matrix)

    def _search(self, particle: int, scan: LineScan, centre: FloatArray) -> FloatArray:
        config = self._config
        stride = -(-len(scan.points_m) // config.search_points)
        best = centre.copy()
        matching.correlate(
            self._maps.blocks, particle, np.ascontiguousarray(scan.points_m[::stride]), centre, config.search_shifts,
            config.search_shift_m, config.search_turns, config.search_turn_rad, self._likelihood, self._maps.cell_m,
            best,
        )  # fmt: skip
        return best
