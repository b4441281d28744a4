"""Finds places that the path has come back to, and how they lie to the present one."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.closures.closure import Candidate, Closure, choose, joined
from station_gui.mapping.slam2d.closures.verifier import Verifier
from station_gui.mapping.slam2d.config import LocalMapConfig, LoopConfig
from station_gui.mapping.slam2d.graph.loop_closure import without_weak_direction
from station_gui.mapping.slam2d.graph.sight.sight import Horizon, View
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, ScanMatcher
from station_gui.mapping.slam2d.particle.closing.course import Course
from station_gui.mapping.slam2d.se2_arrays import between
from station_gui.mapping.slam2d.search.branch_and_bound import build_pyramid, search
from station_gui.mapping.slam2d.share import result_at_once

FloatArray = NDArray[np.float64]

_MAX_WAITING = 200


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """The course as the best particle went it: `path`, (steps, 3), the scans of its steps, and which are mapped."""

    course: Course
    path: FloatArray
    scans: Sequence[Keyframe]
    in_map: Sequence[bool]

    def node_poses(self) -> FloatArray:
        return np.asarray(self.path[self.course.first_steps])

    def scans_round(self, node: int, neighbours: int, stride: int = 1) -> Iterator[tuple[Keyframe, FloatArray]]:
        """Scans of the nodes next to `node`, and where they were made in its frame."""
        first = self.course.first_steps
        low = int(first[max(0, node - neighbours)])
        after = node + neighbours + 1
        high = int(first[after]) if after < len(first) else len(self.path)
        for step in range(low, high, stride):
            if self.in_map[step]:
                yield self.scans[step], between(self.path[first[node]], self.path[step])


class LoopFinder:
    """Candidates by distance against drift, branch and bound, refinement, and a share of points to believe it."""

    def __init__(self, config: LoopConfig, places: LocalMapConfig, matcher: ScanMatcher, cell_m: float) -> None:
        """`cell_m`: of the places' maps."""
        self._config = config
        self._matcher = matcher
        self._verifier = Verifier(config, matcher)
        self._jobs: deque[Candidate] = deque(maxlen=_MAX_WAITING)
        self._place = LocalMap(places.size_m, cell_m, places.reach_cells, config.max_place_surfels, places.max_count)

    @property
    def busy(self) -> bool:
        return bool(self._jobs)

    def look_from(self, way: Way, new: int) -> None:
        """Older nodes that `new` may see will be looked at; where too many wait, the oldest are forgotten."""
        config = self._config
        nodes = np.arange(way.course.nodes)
        poses = way.node_poses()
        first = way.course.given + config.neighbours if way.course.given else 0
        apart = np.flatnonzero((nodes >= first) & (nodes < new - 2 * config.neighbours - 2))
        way_m = way.course.distances_m(new)[apart]
        away_m = np.hypot(poses[apart, 0] - poses[new, 0], poses[apart, 1] - poses[new, 1])
        self._jobs.extend(choose(config, new, apart, way_m, away_m))

    def work(self, way: Way) -> Closure | None:
        """Look at one candidate."""
        if not self._jobs:
            return None
        job = self._jobs.popleft()
        query = joined(way.scans_round(job.new, self._config.query_neighbours, self._config.query_every))
        if len(query.points_m) < self._config.min_query_points:
            return None
        poses = way.path[way.course.first_steps[[job.old, job.new]]]
        estimate = between(poses[0], poses[1])
        views = self._draw_place(way, job.old)
        found = self._search(query, estimate, job) if job.shift_m > 0.0 else estimate
        if found is None:
            return None
        closure = result_at_once(
            lambda share: self._verifier.verified(job, query, estimate, found, self._place, views, share)
        )
        if closure is None:
            return None
        held = without_weak_direction(closure.information, self._config.weak_share)
        return replace(closure, information=way.course.edge_information(held, 0.0))

    def _search(self, query: LineScan, guess: FloatArray, job: Candidate) -> FloatArray | None:
        config = self._config
        pyramid = build_pyramid(*self._matcher.likelihood(self._place, config.cell_m), config.levels)
        points, min_score = self._verifier.thinned(query), self._verifier.min_score(job)
        found = search(points, pyramid, guess, job.shift_m, config.search_turn_rad, min_score, config.max_branches)
        return None if found is None else found.pose

    def _draw_place(self, way: Way, node: int) -> list[View]:
        """Into the map; some of the scans, which tell what space was seen to be free."""
        self._place.clear(0.0, 0.0)
        views = []
        for index, (keyframe, pose) in enumerate(way.scans_round(node, self._config.neighbours)):
            self._place.insert(keyframe.points_m, keyframe.normals, pose)
            if index % self._config.view_every == 0:
                views.append(View(pose, Horizon(keyframe)))
        return views
