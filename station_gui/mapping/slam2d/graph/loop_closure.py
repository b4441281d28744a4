"""Finds places that were seen before and how they lie to the present one."""

from __future__ import annotations

import math
from collections import OrderedDict, deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import LocalMapConfig, LoopConfig
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, Match, ScanMatcher
from station_gui.mapping.slam2d.se2_arrays import between, compose, rotate_information
from station_gui.mapping.slam2d.search.branch_and_bound import Pyramid, build_pyramid, search


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """Node `new` lies at `measured` in the frame of node `old`; `information` (3, 3) in the frame of `old`.

    `searched`: the estimate was not good enough to start from, so that the place itself may be mistaken.
    """

    old: int
    new: int
    measured: NDArray[np.float64]
    information: NDArray[np.float64]
    share: float
    searched: bool


@dataclass(frozen=True, slots=True)
class Candidate:
    """A pair worth a search, and how far round the estimate; 0: the estimate is good, it only wants refining."""

    old: int
    new: int
    shift_m: float


@dataclass(slots=True, eq=False)
class _Place:
    """Surroundings of a node in its own frame; `waiting` scans are not in it yet."""

    local_map: LocalMap
    waiting: deque[tuple[Keyframe, NDArray[np.float64]]]
    pyramid: Pyramid | None = None


class LoopCloser:
    """Candidates by distance against drift, branch and bound, refinement, and a score to believe it.

    One candidate is worked on at a time, a bounded share of it in each `step`.
    """

    def __init__(self, config: LoopConfig, map_config: LocalMapConfig, matcher: ScanMatcher) -> None:
        self._config = config
        self._map_config = map_config
        self._matcher = matcher
        self._places: OrderedDict[int, _Place] = OrderedDict()
        self._candidate: Candidate | None = None

    @property
    def busy(self) -> bool:
        return self._candidate is not None

    def forget_places(self) -> None:
        """The nodes have moved against each other."""
        self._places.clear()

    def candidates(self, graph: PoseGraph, new: int) -> list[Candidate]:
        """Older nodes that `new` may see, nearest first, none next to another."""
        config = self._config
        way_m = graph.distances_m(new)
        poses = graph.poses
        away_m = np.hypot(poses[:, 0] - poses[new, 0], poses[:, 1] - poses[new, 1])
        shift_m = np.minimum(config.drift_fixed_m + config.drift_ratio * way_m, config.max_search_m)
        apart = np.abs(np.arange(graph.nodes) - new) > 2 * config.neighbours + 2
        near = np.flatnonzero(apart & (np.arange(graph.nodes) < new) & (away_m < config.overlap_m + 0.5 * shift_m))
        found: list[Candidate] = []
        for old in near[np.argsort(away_m[near], kind="stable")]:
            if any(abs(int(old) - other.old) <= 2 * config.neighbours for other in found):
                continue
            far = way_m[old] > config.min_graph_distance_m
            if not far and away_m[old] > 0.5 * config.overlap_m:
                continue
            found.append(Candidate(int(old), new, float(shift_m[old]) if far else 0.0))
            if len(found) == config.max_candidates:
                break
        return found

    def begin(self, candidate: Candidate) -> None:
        self._candidate = candidate

    def step(self, graph: PoseGraph, by_node: list[list[Keyframe]]) -> Closure | None:
        """Draw some scans of the old place, or its pyramid, or else look for the new node's scans in it."""
        candidate = self._candidate
        if candidate is None:
            return None
        place = self._place(graph, by_node, candidate.old)
        if place.waiting:
            self._draw(place)
            return None
        if candidate.shift_m > 0 and place.pyramid is None:
            likelihood = self._matcher.likelihood(place.local_map, self._config.cell_m)
            place.pyramid = build_pyramid(*likelihood, self._config.levels)
            return None
        self._candidate = None
        return self._close(graph, by_node, candidate, place)

    def _close(
        self, graph: PoseGraph, by_node: list[list[Keyframe]], candidate: Candidate, place: _Place
    ) -> Closure | None:
        query = self._query(graph, by_node, candidate.new)
        if len(query.points_m) < self._config.min_query_points:
            return None
        guess = between(graph.poses[candidate.old], graph.poses[candidate.new])
        if place.pyramid is not None and candidate.shift_m > 0:
            stride = -(-len(query.points_m) // self._config.max_query_points)
            found = search(
                np.ascontiguousarray(query.points_m[::stride]),
                place.pyramid,
                guess,
                candidate.shift_m,
                self._config.search_turn_rad,
                self._config.min_score,
                self._config.max_branches,
            )
            if found is None:
                return None
            guess = found.pose
        return self._verified(place, query, guess, candidate)

    def _verified(self, place: _Place, query: LineScan, guess: NDArray[np.float64], pair: Candidate) -> Closure | None:
        match: Match = self._matcher.refine(query, place.local_map, guess)
        if match.share < self._config.min_inlier_share or not np.isfinite(match.pose).all():
            return None
        moved_m = math.hypot(match.pose[0] - guess[0], match.pose[1] - guess[1])
        if moved_m > self._config.max_refinement_m:
            return None
        return Closure(pair.old, pair.new, match.pose, match.information, match.share, searched=pair.shift_m > 0)

    def _place(self, graph: PoseGraph, by_node: list[list[Keyframe]], node: int) -> _Place:
        if node in self._places:
            self._places.move_to_end(node)
            return self._places[node]
        place = _Place(self._blank_map(), deque())
        reach = self._config.neighbours
        for k in range(max(0, node - reach), min(len(by_node), node + reach + 1)):
            node_from_k = between(graph.poses[node], graph.poses[k])
            place.waiting.extend((keyframe, compose(node_from_k, keyframe.in_node)) for keyframe in by_node[k])
        self._places[node] = place
        return place

    def _blank_map(self) -> LocalMap:
        """That of the place that was not needed for longest, or a new one."""
        if len(self._places) >= self._config.cached_places:
            local_map = self._places.popitem(last=False)[1].local_map
            local_map.clear(0.0, 0.0)
            return local_map
        config = self._map_config
        return LocalMap(
            config.size_m, config.cell_m, config.reach_cells, self._config.max_place_surfels, config.max_count
        )

    def _draw(self, place: _Place) -> None:
        for _ in range(min(self._config.scans_per_step, len(place.waiting))):
            keyframe, pose = place.waiting.popleft()
            scan = keyframe.lines()
            place.local_map.insert(scan.points_m, scan.normals, pose)

    def _query(self, graph: PoseGraph, by_node: list[list[Keyframe]], node: int) -> LineScan:
        """Scans of the node and its neighbours in its own frame."""
        points, normals = [np.zeros((0, 2))], [np.zeros((0, 2))]
        reach = self._config.query_neighbours
        for k in range(max(0, node - reach), min(len(by_node), node + reach + 1)):
            node_from_k = between(graph.poses[node], graph.poses[k])
            for keyframe in by_node[k][::3]:
                x, y, theta = compose(node_from_k, keyframe.in_node)
                c, s = math.cos(theta), math.sin(theta)
                turn = np.array([[c, s], [-s, c]])
                points.append(keyframe.points_m @ turn + (x, y))
                normals.append(keyframe.normals @ turn)
        return LineScan(np.ascontiguousarray(np.vstack(points)), np.ascontiguousarray(np.vstack(normals)))


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
