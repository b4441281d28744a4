"""Refines a place by least squares and says how well the map agrees with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.localisation.config import VerifyConfig
from station_gui.mapping.slam2d.localisation.query import Query
from station_gui.mapping.slam2d.localisation.reference import Reference
from station_gui.mapping.slam2d.localisation.verify import _kernels
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """`map_from_trail`: (3,). Shares of all beams: those that fit, and those that cannot be."""

    map_from_trail: FloatArray
    fitting: float
    impossible: float
    beams: int

    @property
    def support(self) -> float:
        return self.fitting - self.impossible

    @property
    def good_share(self) -> float:
        """Of the beams that the map can judge."""
        judged = self.fitting + self.impossible
        return self.fitting / judged if judged > 0 else 0.0


def verify(config: VerifyConfig, reference: Reference, query: Query, start: FloatArray) -> Hypothesis:
    """`start`: (3,) the trail in the map."""
    match = reference.matcher.refine(LineScan(query.points_m, query.normals), reference.local_map, start)
    pose = match.pose if np.isfinite(match.pose).all() else start
    verdicts = judge(config, reference, query, pose)
    count = max(len(verdicts), 1)
    fitting = int(np.count_nonzero(verdicts == _kernels.FITS))
    impossible = int(np.count_nonzero(verdicts >= _kernels.IN_FREE_SPACE))
    return Hypothesis(pose, fitting / count, impossible / count, len(verdicts))


def judge(config: VerifyConfig, reference: Reference, query: Query, pose: FloatArray) -> NDArray[np.uint8]:
    """(N,): a verdict for each beam of the query, whose trail lies at `pose`, (3,), in the map."""
    verdicts = np.zeros(len(query.points_m), np.uint8)
    local_map, grid = reference.local_map, reference.grid
    _kernels.judge(
        query.points_m, query.normals, query.scanners_m, pose, config.inlier_m, config.margin_m, config.min_cosine,
        config.free_below, local_map.origin_x_m, local_map.origin_y_m, local_map.cell_m, local_map.nearest,
        local_map.distance2, local_map.reach_cells, local_map.surfels, grid.probability, *grid.origin_m, grid.cell_m,
        verdicts,
    )  # fmt: skip
    return verdicts
