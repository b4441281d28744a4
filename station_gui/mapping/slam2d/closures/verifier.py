"""Whether a scan fits a place where a search has put it."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.closures.closure import Candidate, Closure
from station_gui.mapping.slam2d.config import LoopConfig
from station_gui.mapping.slam2d.graph.sight.sight import View, seen_through_share
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, Match, ScanMatcher
from station_gui.mapping.slam2d.se2_arrays import between
from station_gui.mapping.slam2d.share import Share

FloatArray = NDArray[np.float64]


class Verifier:
    """Refines what was found and looks at how many points fit, and where those are that do not.

    A place near by is also known from another side, of which little is in its map: then few points need fit, if
    almost none stands where the place was seen to be empty.
    """

    def __init__(self, config: LoopConfig, matcher: ScanMatcher) -> None:
        self._config = config
        self._matcher = matcher

    def thinned(self, query: LineScan) -> FloatArray:
        """(N, 2): every n-th point, no more than the search takes."""
        stride = max(1, -(-len(query.points_m) // self._config.max_query_points))
        return np.ascontiguousarray(query.points_m[::stride])

    def min_score(self, pair: Candidate) -> float:
        """Of the search."""
        return self._config.min_partial_score if self._may_be_partial(pair) else self._config.min_score

    def verified(
        self,
        pair: Candidate,
        query: LineScan,
        estimate: FloatArray,
        found: FloatArray,
        local_map: LocalMap,
        views: Sequence[View],
        share: Share,
    ) -> Generator[None, None, Closure | None]:
        """`estimate`, `found`: (3,), the query in the frame of the old node, as of its `local_map` and its `views`."""
        match = yield from self._refined(query, found, local_map, share)
        if match is None:
            return None
        if math.hypot(*(match.pose - estimate)[:2]) > self._config.agreement_m:
            match = yield from self._against_estimate(query, match, estimate, local_map, share)
        known = match.share >= self._config.min_inlier_share
        held = self._held_share(query, match)
        if not known and not (self._may_be_partial(pair) and (yield from self._agrees(query, match, views, share))):
            return None
        partial = not known and held < self._config.sure_held_share
        witness = not known and held < self._config.min_held_share
        return Closure(pair.old, pair.new, match.pose, match.information, pair.shift_m > 0, partial, witness)

    def _refined(
        self, query: LineScan, start: FloatArray, local_map: LocalMap, share: Share
    ) -> Generator[None, None, Match | None]:
        """None where it ends somewhere else."""
        match = yield from self._matcher.refine_slowly(query, local_map, start, share)
        moved_m = math.hypot(match.pose[0] - start[0], match.pose[1] - start[1])
        return match if moved_m <= self._config.max_refinement_m else None  # nor where it is not a number

    def _against_estimate(
        self, query: LineScan, match: Match, estimate: FloatArray, local_map: LocalMap, share: Share
    ) -> Generator[None, None, Match]:
        """The match, or the one at the estimate where that fits nearly as well.

        So it is along a bare corridor, where a search finds some place: both fit, and the way from one to the other is
        what is not known.
        """
        near = yield from self._refined(query, estimate, local_map, share)
        if near is None or match.share >= near.share + self._config.better_share:
            return match
        apart = between(near.pose, match.pose)
        apart[:2] = match.pose[:2] - near.pose[:2]
        unknown = near.information @ apart  # Sherman-Morrison: the covariance grows by the square of what is between
        information = near.information - np.outer(unknown, unknown) / (1.0 + apart @ unknown)
        return replace(near, information=information)

    def _may_be_partial(self, pair: Candidate) -> bool:
        return 0 < pair.shift_m <= self._config.max_partial_search_m

    def _agrees(
        self, query: LineScan, match: Match, views: Sequence[View], share: Share
    ) -> Generator[None, None, bool]:
        """Enough points hold the query, and few are where the place is known to be empty."""
        config = self._config
        if match.share < config.min_partial_share or self._held_share(query, match) < config.witness_held_share:
            return False
        through = yield from seen_through_share(
            self.thinned(query), match.pose, views, config.through_margin_m, config.through_margin_ratio, share
        )
        return through <= config.max_through_share * (through + match.share)

    def _held_share(self, query: LineScan, match: Match) -> float:
        """Of all points: those that hold the direction in which the match is weaker."""
        points = float(np.linalg.eigvalsh(match.information[:2, :2])[0]) * self._matcher.noise_m**2
        return points / max(len(query.points_m), 1)
