"""Finds places that were seen before and how they lie to the present one."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.closures.closure import Candidate, Closure, choose, joined
from station_gui.mapping.slam2d.closures.verifier import Verifier
from station_gui.mapping.slam2d.config import LocalMapConfig, LoopConfig
from station_gui.mapping.slam2d.graph.places import Place, Places
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.graph.ways import _kernels
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, ScanMatcher
from station_gui.mapping.slam2d.se2_arrays import between, compose, rotate_information
from station_gui.mapping.slam2d.search.branch_and_bound import Search
from station_gui.mapping.slam2d.share import Share

_NEAR_UNITS = 500  # sorting the near nodes, in products of two 3 × 3 blocks
_QUERY_UNITS = 6000


class LoopCloser:
    """Candidates by distance against drift, branch and bound, refinement, and a score to believe it."""

    def __init__(self, config: LoopConfig, map_config: LocalMapConfig, matcher: ScanMatcher) -> None:
        self._config = config
        self._verifier = Verifier(config, matcher)
        self.share = Share()
        self._places = Places(config, map_config, matcher, self.share)

    def forget_places(self) -> None:
        """The nodes have moved against each other."""
        self._places.forget()

    def look(self, graph: PoseGraph, by_node: list[list[Keyframe]], new: int) -> Iterator[Closure | None]:
        """What `new` may see of older nodes: a closure when one is found, None when the share is used up."""
        for candidate in (yield from self.candidates(graph, new)):
            place = yield from self._places.draw(graph, by_node, candidate.old)
            closure = yield from self._close(graph, by_node, candidate, place)
            self._places.let_go()
            if closure is not None:
                yield closure

    def candidates(self, graph: PoseGraph, new: int) -> Generator[None, None, list[Candidate]]:
        """Older nodes that `new` may see, nearest first, none next to another."""
        config = self._config
        poses = graph.poses
        x, y = float(poses[new, 0]), float(poses[new, 1])
        last = max(0, new - 2 * config.neighbours - 2)
        found, state = np.empty(last, np.int32), np.zeros(2, np.int64)
        reach_m = config.overlap_m + 0.5 * config.max_search_m
        yield from self.share.spread(
            lambda s, budget: _kernels.nodes_within(graph.poses, last, x, y, reach_m, found, s, budget), state, last
        )
        near = found[: state[1]]
        if len(near) == 0:
            return []
        way_m = np.empty(len(near))
        limit_m = (config.max_search_m - config.drift_fixed_m) / config.drift_ratio  # farther makes no difference
        yield from graph.ways.measure(self.share, new, near, limit_m, way_m)
        self.share.take(_NEAR_UNITS)
        away_m = np.hypot(graph.poses[near, 0] - x, graph.poses[near, 1] - y)
        return choose(config, new, near, way_m, away_m)

    def _close(
        self, graph: PoseGraph, by_node: list[list[Keyframe]], candidate: Candidate, place: Place
    ) -> Generator[None, None, Closure | None]:
        config = self._config
        if candidate.shift_m > 0:
            yield from self._places.raise_pyramid(place)
        if self.share.left < _QUERY_UNITS:
            yield
        query = self._query(graph, by_node, candidate.new)
        self.share.take(_QUERY_UNITS)
        if len(query.points_m) < config.min_query_points:
            return None
        estimate = between(graph.poses[candidate.old], graph.poses[candidate.new])
        found = estimate
        if place.pyramid is not None and candidate.shift_m > 0:
            search = Search(
                self._verifier.thinned(query),
                place.pyramid,
                estimate,
                candidate.shift_m,
                config.search_turn_rad,
                self._verifier.min_score(candidate),
                config.max_branches,
            )
            yield from search.run(self.share)
            if search.found is None:
                return None
            found = search.found.pose
        verified = self._verifier.verified(candidate, query, estimate, found, place.local_map, place.views, self.share)
        return (yield from verified)

    def _query(self, graph: PoseGraph, by_node: list[list[Keyframe]], node: int) -> LineScan:
        """Scans of the node and its neighbours in its own frame."""
        reach, every = self._config.query_neighbours, self._config.query_every
        nodes = range(max(0, node - reach), min(len(by_node), node + reach + 1))
        node_from = {k: between(graph.poses[node], graph.poses[k]) for k in nodes}
        return joined((scan, compose(node_from[k], scan.in_node)) for k in nodes for scan in by_node[k][::every])


def without_weak_direction(information: NDArray[np.float64], weak_share: float) -> NDArray[np.float64]:
    """The (3, 3) information with less of the shift's weaker direction where it is a small share of the other.

    Along a bare corridor the scatter of the normals alone makes it look as if some points held the robot: what is
    believed goes down with the square of that share, as for the prediction in `prior_information`.
    """
    points, directions = np.linalg.eigh(information[:2, :2])
    share = max(float(points[0]), 0.0) / max(float(points[1]), 1e-9)
    keep = share / math.hypot(share, weak_share)
    shrink = np.eye(3)
    shrink[:2, :2] -= (1.0 - keep) * np.outer(directions[:, 0], directions[:, 0])
    return np.asarray(shrink @ information @ shrink)


def edge_information(
    match_information: NDArray[np.float64], theta_rad: float, shift_sigma_m: float, turn_sigma_rad: float
) -> NDArray[np.float64]:
    """What a match is worth to the graph: its own covariance, no wider than 10 m and 10 rad, and the model's floor.

    `match_information`: (3, 3) in a frame in which the edge's first node is turned by `theta_rad`.
    """
    turned = rotate_information(match_information, theta_rad)
    covariance = np.linalg.inv(turned + np.diag((1e-2, 1e-2, 1e-2)))
    covariance += np.diag((shift_sigma_m**2, shift_sigma_m**2, turn_sigma_rad**2))
    information = np.linalg.inv(covariance)
    return np.asarray(0.5 * (information + information.T))
