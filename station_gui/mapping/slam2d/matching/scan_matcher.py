"""Finds where a scan lies on a local map."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.belief import needed_share
from station_gui.mapping.slam2d.config import MatchConfig, NormalConfig
from station_gui.mapping.slam2d.matching import _kernels
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.se2_arrays import between
from station_gui.mapping.slam2d.search._kernels import correlate, fill_likelihood
from station_gui.mapping.slam2d.share import Share, Task, at_once

_NO_PRIOR = np.zeros(3)
_ROWS_AT_ONCE = 16
_CELLS_PER_UNIT = 12


@dataclass(frozen=True, slots=True, eq=False)
class LineScan:
    """Points of a scan and the normals of the lines they lie on: `points_m`, `normals` (N, 2), robot frame."""

    points_m: NDArray[np.float64]
    normals: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """`pose`: (3,); `information`: (3, 3) of (x, y in the map's frame, theta); `share` of the points that fit."""

    pose: NDArray[np.float64]
    information: NDArray[np.float64]
    share: float
    rms_m: float


def to_lines(points_m: NDArray[np.float64], origin_m: NDArray[np.float64], config: NormalConfig) -> LineScan:
    points = np.ascontiguousarray(points_m, dtype=np.float64)
    useful, normals = np.empty_like(points), np.empty_like(points)
    count = _kernels.scan_lines(
        points,
        origin_m,
        config.half_window,
        config.max_gap_m,
        config.max_rms_m,
        config.max_lonely_m,
        useful,
        normals,
    )
    return LineScan(useful[:count], normals[:count])


class _Refinement:
    """Least squares on their way: the arrays are those of the kernel."""

    def __init__(self, start: NDArray[np.float64]) -> None:
        self.pose = start.copy()
        self.hessian = np.zeros((3, 3))
        self.figures = np.zeros(4)
        self.state = np.zeros(3)

    @property
    def iterations(self) -> int:
        return int(self.state[1])

    @property
    def ended(self) -> bool:
        return bool(self.state[2])


class ScanMatcher:
    """Gauss–Newton from a prediction; a correlative search first where the prediction does not fit.

    The search is Olson's (2009) on the look-up table of distances; the refinement takes point-to-line residuals
    with the weights of Geman and McClure.
    """

    def __init__(self, config: MatchConfig, reach_cells: int, cell_m: float) -> None:
        self._config = config
        self._likelihood = _likelihood_table(reach_cells, cell_m, config.inlier_m)

    @property
    def noise_m(self) -> float:
        """Of one point: a match's information times its square counts points."""
        return self._config.noise_m

    def match(
        self, scan: LineScan, local_map: LocalMap, predicted: NDArray[np.float64], prior_weight: NDArray[np.float64]
    ) -> Match:
        """`prior_weight`: (3,) inverse variances of the prediction."""
        found = self.refine(scan, local_map, predicted, predicted, prior_weight)
        if len(scan.points_m) < self._config.min_points or not self._is_doubtful(found, predicted, prior_weight):
            return found
        start = self.search(scan, local_map, predicted)
        other = self.refine(scan, local_map, start, predicted, prior_weight)
        return other if other.share > found.share + self._config.better_share else found

    def _is_doubtful(self, match: Match, predicted: NDArray[np.float64], prior_weight: NDArray[np.float64]) -> bool:
        """Few points fit, or too few for how far it is from the prediction."""
        config = self._config
        if not config.doubtful_share <= match.share < config.far_share:
            return match.share < config.doubtful_share
        away = between(predicted, match.pose) * np.sqrt(prior_weight)
        return not self.believes(match.share, float(np.abs(away).max()), 0)

    def believes(self, share: float, surprise: float, lost_scans: int) -> bool:
        """Whether a match that is so far from the prediction, in standard deviations, deserves it."""
        config = self._config
        far = surprise / (config.far_sigmas * (1 + lost_scans))  # the prediction is the older the longer it is lost
        return math.isfinite(far) and share >= needed_share(config.lost_share, config.far_share, far)

    def refine(
        self,
        scan: LineScan,
        local_map: LocalMap,
        start: NDArray[np.float64],
        prior: NDArray[np.float64] = _NO_PRIOR,
        prior_weight: NDArray[np.float64] = _NO_PRIOR,
    ) -> Match:
        work = _Refinement(start)
        self._iterate(work, scan, local_map, prior, prior_weight, self._config.max_iterations + 1)
        return self._match_of(work)

    def refine_slowly(
        self, scan: LineScan, local_map: LocalMap, start: NDArray[np.float64], share: Share
    ) -> Generator[None, None, Match]:
        """`refine` without a prior, as far as the share goes at a time."""
        work = _Refinement(start)
        units = 1 + len(scan.points_m)  # of one iteration
        while not work.ended:
            if share.left <= 0:
                yield
            done = work.iterations
            self._iterate(work, scan, local_map, _NO_PRIOR, _NO_PRIOR, 1 + max(0, share.left) // units)
            share.take(units * (1 + work.iterations - done))
        return self._match_of(work)

    def _iterate(
        self,
        work: _Refinement,
        scan: LineScan,
        local_map: LocalMap,
        prior: NDArray[np.float64],
        prior_weight: NDArray[np.float64],
        budget: int,
    ) -> None:
        config = self._config
        _kernels.refine(
            scan.points_m,
            scan.normals,
            work.pose,
            prior,
            prior_weight * config.noise_m**2,
            config.weak_points,
            config.weak_weight if prior_weight.any() else 0.0,
            config.wide_kernel_m,
            config.fine_kernel_m,
            config.inlier_m,
            config.point_weight,
            config.max_iterations,
            local_map.origin_x_m,
            local_map.origin_y_m,
            local_map.cell_m,
            local_map.nearest,
            local_map.surfels,
            work.hessian,
            work.figures,
            work.state,
            budget,
        )

    def _match_of(self, work: _Refinement) -> Match:
        _, inside, inliers, squares = work.figures.tolist()
        share = inliers / inside if inside > 0 else 0.0
        rms_m = math.sqrt(squares / inliers) if inliers > 0 else 0.0
        return Match(work.pose, work.hessian / self._config.noise_m**2, share, rms_m)

    def search(self, scan: LineScan, local_map: LocalMap, centre: NDArray[np.float64]) -> NDArray[np.float64]:
        """The best of a grid of poses round `centre`, with every n-th point."""
        config = self._config
        stride = -(-len(scan.points_m) // config.search_points)
        best = centre.copy()
        correlate(
            np.ascontiguousarray(scan.points_m[::stride]),
            centre,
            config.search_shifts,
            config.search_shift_m,
            config.search_turns,
            config.search_turn_rad,
            self._likelihood,
            local_map.origin_x_m,
            local_map.origin_y_m,
            local_map.cell_m,
            local_map.distance2,
            best,
        )
        return best

    def likelihood(self, local_map: LocalMap, cell_m: float) -> tuple[NDArray[np.uint8], tuple[float, float], float]:
        """The map as a grid of likelihoods 0..255 with cells of about `cell_m`, its lower left corner and cell."""
        factor = max(1, round(cell_m / local_map.cell_m))
        side = len(local_map.distance2) // factor
        likelihood = np.zeros((side, side), np.uint8)
        at_once(lambda share: self.fill_likelihood(local_map, likelihood, share))
        return (
            likelihood,
            (local_map.origin_x_m, local_map.origin_y_m),
            factor * local_map.cell_m,
        )

    def fill_likelihood(self, local_map: LocalMap, likelihood: NDArray[np.uint8], share: Share) -> Task:
        """The map as a grid of likelihoods 0..255; each cell stands for a square of whole cells of the map."""
        factor = len(local_map.distance2) // len(likelihood)
        table = np.round(255 * self._likelihood).astype(np.uint8)
        for first in range(0, len(likelihood), _ROWS_AT_ONCE):
            if share.left <= 0:
                yield
            last = min(first + _ROWS_AT_ONCE, len(likelihood))
            fill_likelihood(local_map.distance2, table, factor, likelihood, first, last)
            share.take((last - first) * len(local_map.distance2) * factor // _CELLS_PER_UNIT)


def _likelihood_table(reach_cells: int, cell_m: float, sigma_m: float) -> NDArray[np.float64]:
    """(256,): likelihood of a hit by squared distance in cells; 0 out of reach."""
    distance2 = np.arange(256, dtype=np.float64)
    table = np.exp(-0.5 * distance2 * (cell_m / sigma_m) ** 2)
    table[reach_cells**2 + 1 :] = 0.0
    return np.asarray(table)
