"""Finds places that were seen before and how they lie to the present one."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import LocalMapConfig, LoopConfig
from station_gui.mapping.slam2d.graph.places import Place, Places
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.graph.sight.sight import seen_through_share
from station_gui.mapping.slam2d.graph.ways import _kernels
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, Match, ScanMatcher
from station_gui.mapping.slam2d.se2_arrays import between, compose, rotate_information
from station_gui.mapping.slam2d.search.branch_and_bound import Search
from station_gui.mapping.slam2d.share import Share


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """Node `new` lies at `measured` in the frame of node `old`; `information` (3, 3) in the frame of `old`.

    `searched`: the estimate was not good enough to start from, so that the place itself may be mistaken.
    `partial`: most of what the new node saw is not known from the old one.
    """

    old: int
    new: int
    measured: NDArray[np.float64]
    information: NDArray[np.float64]
    share: float
    searched: bool
    partial: bool = False


@dataclass(frozen=True, slots=True)
class Candidate:
    """A pair worth a search, and how far round the estimate; 0: the estimate is good, it only wants refining."""

    old: int
    new: int
    shift_m: float


_NEAR_UNITS = 500  # sorting the near nodes, in products of two 3 × 3 blocks
_QUERY_UNITS = 6000


class LoopCloser:
    """Candidates by distance against drift, branch and bound, refinement, and a score to believe it."""

    def __init__(self, config: LoopConfig, map_config: LocalMapConfig, matcher: ScanMatcher) -> None:
        self._config = config
        self._matcher = matcher
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
        return self._choose(new, near, way_m, away_m)

    def _choose(
        self, new: int, near: NDArray[np.int32], way_m: NDArray[np.float64], away_m: NDArray[np.float64]
    ) -> list[Candidate]:
        config = self._config
        shift_m = np.minimum(config.drift_fixed_m + config.drift_ratio * way_m, config.max_search_m)
        far = way_m > config.min_graph_distance_m
        worth = (away_m < config.overlap_m + 0.5 * shift_m) & (far | (away_m <= 0.5 * config.overlap_m))
        chosen: list[Candidate] = []
        for k in np.flatnonzero(worth)[np.argsort(away_m[worth], kind="stable")]:
            old = int(near[k])
            if all(abs(old - other.old) > 2 * config.neighbours for other in chosen):
                chosen.append(Candidate(old, new, float(shift_m[k]) if far[k] else 0.0))
                if len(chosen) == config.max_candidates:
                    break
        return chosen

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
        guess = between(graph.poses[candidate.old], graph.poses[candidate.new])
        if place.pyramid is not None and candidate.shift_m > 0:
            stride = -(-len(query.points_m) // config.max_query_points)
            search = Search(
                np.ascontiguousarray(query.points_m[::stride]),
                place.pyramid,
                guess,
                candidate.shift_m,
                config.search_turn_rad,
                config.min_partial_score if self._may_be_partial(candidate) else config.min_score,
                config.max_branches,
            )
            yield from search.run(self.share)
            if search.found is None:
                return None
            guess = search.found.pose
        return (yield from self._verified(place, query, guess, candidate))

    def _verified(
        self, place: Place, query: LineScan, guess: NDArray[np.float64], pair: Candidate
    ) -> Generator[None, None, Closure | None]:
        match = yield from self._matcher.refine_slowly(query, place.local_map, guess, self.share)
        moved_m = math.hypot(match.pose[0] - guess[0], match.pose[1] - guess[1])
        if not moved_m <= self._config.max_refinement_m:  # nor where it is not a number
            return None
        partial = match.share < self._config.min_inlier_share
        if partial and not (self._may_be_partial(pair) and (yield from self._agrees(place, query, match))):
            return None
        searched = pair.shift_m > 0
        return Closure(pair.old, pair.new, match.pose, match.information, match.share, searched, partial)

    def _may_be_partial(self, pair: Candidate) -> bool:
        return 0 < pair.shift_m <= self._config.max_partial_search_m

    def _agrees(self, place: Place, query: LineScan, match: Match) -> Generator[None, None, bool]:
        """Enough points hold the query, and few are where the place is known to be empty."""
        config = self._config
        points = float(np.linalg.eigvalsh(match.information[:2, :2])[0]) * self._matcher.noise_m**2
        if match.share < config.min_partial_share or points < config.min_held_share * len(query.points_m):
            return False
        stride = -(-len(query.points_m) // config.max_query_points)
        points_m = np.ascontiguousarray(query.points_m[::stride])
        through = yield from seen_through_share(
            points_m, match.pose, place.views, config.through_margin_m, config.through_margin_ratio, self.share
        )
        return through <= config.max_through_share * (through + match.share)

    def _query(self, graph: PoseGraph, by_node: list[list[Keyframe]], node: int) -> LineScan:
        """Scans of the node and its neighbours in its own frame."""
        points, normals = [np.zeros((0, 2))], [np.zeros((0, 2))]
        reach = self._config.query_neighbours
        for k in range(max(0, node - reach), min(len(by_node), node + reach + 1)):
            node_from_k = between(graph.poses[node], graph.poses[k])
            for keyframe in by_node[k][:: self._config.query_every]:
                x, y, theta = compose(node_from_k, keyframe.in_node)
                c, s = math.cos(theta), math.sin(theta)
                turn = np.array([[c, s], [-s, c]])
                points.append(keyframe.points_m @ turn + (x, y))
                normals.append(keyframe.normals @ turn)
        return LineScan(np.ascontiguousarray(np.vstack(points)), np.ascontiguousarray(np.vstack(normals)))


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
    """What a match is worth to the graph: its own covariance, at least a millimetre wide, and the model's floor.

    `match_information`: (3, 3) in a frame in which the edge's first node is turned by `theta_rad`.
    """
    turned = rotate_information(match_information, theta_rad)
    covariance = np.linalg.inv(turned + np.diag((1e-2, 1e-2, 1e-2)))
    covariance += np.diag((shift_sigma_m**2, shift_sigma_m**2, turn_sigma_rad**2))
    information = np.linalg.inv(covariance)
    return np.asarray(0.5 * (information + information.T))
