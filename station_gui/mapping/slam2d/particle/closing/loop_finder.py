"""Finds places that the path has come back to, and how they lie to the present one."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import MatchConfig
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, ScanMatcher
from station_gui.mapping.slam2d.particle.closing.config import SearchConfig
from station_gui.mapping.slam2d.particle.closing.course import Closure, Course
from station_gui.mapping.slam2d.se2_arrays import between
from station_gui.mapping.slam2d.search.branch_and_bound import build_pyramid, search

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Candidate:
    """A pair worth a search, and how far round the estimate; 0: the estimate is good, it only wants refining."""

    old: int
    new: int
    shift_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """The course as the best particle went it: `path`, (steps, 3), the scans of its steps, and which are mapped."""

    course: Course
    path: FloatArray
    scans: Sequence[Keyframe]
    in_map: Sequence[bool]

    def node_poses(self) -> FloatArray:
        return np.asarray(self.path[self.course.first_steps])

    def scans_round(self, node: int, neighbours: int, stride: int = 1) -> Iterator[tuple[LineScan, FloatArray]]:
        """Scans of the nodes next to `node`, and where they were made in its frame."""
        first = self.course.first_steps
        low = int(first[max(0, node - neighbours)])
        after = node + neighbours + 1
        high = int(first[after]) if after < len(first) else len(self.path)
        for step in range(low, high, stride):
            if self.in_map[step]:
                yield self.scans[step].lines(), between(self.path[first[node]], self.path[step])


class LoopFinder:
    """Candidates by distance against drift, branch and bound, refinement, and a share of points to believe it."""

    def __init__(self, config: SearchConfig, match: MatchConfig, cell_m: float, max_count: float) -> None:
        self._config = config
        self._matcher = ScanMatcher(match, config.place_reach_cells, cell_m)
        self._jobs: deque[Candidate] = deque(maxlen=config.max_waiting)
        self._place = LocalMap(
            config.place_size_m, cell_m, config.place_reach_cells, config.max_place_surfels, max_count
        )

    @property
    def busy(self) -> bool:
        return bool(self._jobs)

    def look_from(self, way: Way, new: int) -> None:
        """Older nodes that `new` may see, nearest first, none next to another, will be looked at."""
        config = self._config
        if config.max_candidates == 0:
            return
        nodes = np.arange(way.course.nodes)
        poses = way.node_poses()
        way_m = way.course.distances_m(new)
        away_m = np.hypot(poses[:, 0] - poses[new, 0], poses[:, 1] - poses[new, 1])
        shift_m = np.minimum(config.drift_fixed_m + config.drift_ratio * way_m, config.max_search_m)
        first = way.course.given + config.neighbours if way.course.given else 0
        apart = (nodes >= first) & (nodes < new - 2 * config.neighbours - 2)
        near = np.flatnonzero(apart & (away_m < config.overlap_m + 0.5 * shift_m))
        found: list[int] = []
        for old in near[np.argsort(away_m[near], kind="stable")].tolist():
            far = way_m[old] > config.min_way_m
            if any(abs(old - other) <= 2 * config.neighbours for other in found):
                continue
            if not far and away_m[old] > 0.5 * config.overlap_m:
                continue
            found.append(old)
            self._jobs.append(Candidate(old, new, float(shift_m[old]) if far else 0.0))
            if len(found) == config.max_candidates:
                break

    def work(self, way: Way) -> Closure | None:
        """Look at one candidate."""
        if not self._jobs:
            return None
        job = self._jobs.popleft()
        config = self._config
        query = self._query(way, job.new)
        if len(query.points_m) < config.min_query_points:
            return None
        poses = way.path[way.course.first_steps[[job.old, job.new]]]
        guess = between(poses[0], poses[1])
        self._draw_place(way, job.old)
        if job.shift_m > 0.0:
            found = self._search(query, guess, job.shift_m)
            if found is None:
                return None
            guess = found
        return self._verified(way.course, query, guess, job)

    def _search(self, query: LineScan, guess: FloatArray, shift_m: float) -> FloatArray | None:
        config = self._config
        likelihood = self._matcher.likelihood(self._place, config.cell_m)
        pyramid = build_pyramid(*likelihood, config.levels)
        stride = -(-len(query.points_m) // config.max_query_points)
        points = np.ascontiguousarray(query.points_m[::stride])
        found = search(points, pyramid, guess, shift_m, config.search_turn_rad, config.min_score, config.max_branches)
        return None if found is None else found.pose

    def _verified(self, course: Course, query: LineScan, guess: FloatArray, job: Candidate) -> Closure | None:
        match = self._matcher.refine(query, self._place, guess)
        if match.share < self._config.min_inlier_share or not np.isfinite(match.pose).all():
            return None
        if math.hypot(match.pose[0] - guess[0], match.pose[1] - guess[1]) > self._config.max_refinement_m:
            return None
        information = course.edge_information(match.information, 0.0)
        return Closure(job.old, job.new, match.pose, information, searched=job.shift_m > 0.0)

    def _draw_place(self, way: Way, node: int) -> None:
        self._place.clear(0.0, 0.0)
        for scan, pose in way.scans_round(node, self._config.neighbours):
            self._place.insert(scan.points_m, scan.normals, pose)

    def _query(self, way: Way, node: int) -> LineScan:
        """Scans of the node and its neighbours in its own frame."""
        points, normals = [np.zeros((0, 2))], [np.zeros((0, 2))]
        for scan, (x, y, theta) in way.scans_round(node, self._config.query_neighbours, self._config.query_stride):
            c, s = math.cos(theta), math.sin(theta)
            turn = np.array([[c, s], [-s, c]])
            points.append(scan.points_m @ turn + (x, y))
            normals.append(scan.normals @ turn)
        return LineScan(np.ascontiguousarray(np.vstack(points)), np.ascontiguousarray(np.vstack(normals)))
