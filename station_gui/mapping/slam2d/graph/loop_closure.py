"""Finds places that were seen before and how they lie to the present one."""

from __future__ import annotations

import math
from collections import OrderedDict
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
    """Node `new` lies at `measured` in the frame of node `old`; `information` (3, 3) in the frame of `old`."""

    old: int
    new: int
    measured: NDArray[np.float64]
    information: NDArray[np.float64]
    share: float


@dataclass(frozen=True, slots=True)
class Candidate:
    """A pair worth a search, and how far round the estimate; 0: the estimate is good, it only wants refining."""

    old: int
    new: int
    shift_m: float


@dataclass(slots=True, eq=False)
class _Place:
    """Surroundings of a node in its own frame."""

    local_map: LocalMap
    pyramid: Pyramid | None


class LoopCloser:
    """Candidates by distance against drift, branch and bound, refinement, and a score to believe it."""

    def __init__(self, config: LoopConfig, map_config: LocalMapConfig, matcher: ScanMatcher) -> None:
        self._config = config
        self._map_config = map_config
        self._matcher = matcher
        self._places: OrderedDict[int, _Place] = OrderedDict()

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

    def close(self, graph: PoseGraph, by_node: list[list[Keyframe]], candidate: Candidate) -> Closure | None:
        """Look for the new node's scans round the old node."""
        old, new = candidate.old, candidate.new
        place = self._place(graph, by_node, old)
        query = self._query(graph, by_node, new)
        if len(query.points_m) < 30:
            return None
        guess = between(graph.poses[old], graph.poses[new])
        if candidate.shift_m > 0:
            found = search(
                query.points_m[:: -(-len(query.points_m) // self._config.max_query_points)].copy(),
                self._pyramid(place),
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
        if moved_m > 0.5:
            return None
        return Closure(pair.old, pair.new, match.pose, match.information, match.share)

    def _place(self, graph: PoseGraph, by_node: list[list[Keyframe]], node: int) -> _Place:
        if node in self._places:
            self._places.move_to_end(node)
            return self._places[node]
        config = self._map_config
        local_map = LocalMap(config.size_m, config.cell_m, config.reach_cells, config.max_surfels, config.max_count)
        reach = self._config.neighbours
        for k in range(max(0, node - reach), min(len(by_node), node + reach + 1)):
            node_from_k = between(graph.poses[node], graph.poses[k])
            for keyframe in by_node[k]:
                scan = keyframe.lines()
                local_map.insert(scan.points_m, scan.normals, compose(node_from_k, keyframe.in_node))
        self._places[node] = _Place(local_map, None)
        if len(self._places) > self._config.cached_places:
            self._places.popitem(last=False)
        return self._places[node]

    def _pyramid(self, place: _Place) -> Pyramid:
        if place.pyramid is None:
            place.pyramid = build_pyramid(*self._matcher.likelihood(place.local_map, self._config.cell_m),
                                          self._config.levels)  # fmt: skip
        return place.pyramid

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
