"""Global relocalisation: where in a known map is a robot that was put down anywhere?

A SLAM of its own, the trail, follows the robot meanwhile. What it has seen lately is looked for in the whole map by
branch and bound; every place that may be is refined, judged beam by beam, and kept as a hypothesis while the robot
drives on. One is believed when it explains what was seen, no other does nearly as well, and the next scans agree.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.graph_slam import GraphSlam
from station_gui.mapping.slam2d.localisation.config import LocalisationConfig
from station_gui.mapping.slam2d.localisation.query import Query, gather, recent
from station_gui.mapping.slam2d.localisation.reference import Reference
from station_gui.mapping.slam2d.localisation.search.places import PlaceSearch, distinct
from station_gui.mapping.slam2d.localisation.verify.verifier import Hypothesis, verify
from station_gui.mapping.slam2d.matching.scan_matcher import to_lines
from station_gui.mapping.slam2d.se2_arrays import compose
from station_gui.mapping.slam2d.share import Share

FloatArray = NDArray[np.float64]

_PLACES_UNITS = 20_000  # sorting what a search has found
_UNITS_PER_BEAM = 70  # of a place that is refined and judged


class Relocaliser:
    """One thread; a bounded share of the work with every scan."""

    def __init__(self, config: LocalisationConfig, reference: Reference) -> None:
        self._config = config
        self._reference = reference
        self._share = Share()
        self._begin_trail()

    def _begin_trail(self) -> None:
        self._trail = GraphSlam(self._config.trail)
        self._query: Query | None = None
        self._query_scans = 0  # keyframes of the trail when the query was gathered
        self._search: PlaceSearch | None = None
        self._searched_m: float | None = None  # the way driven when the last search began
        self._waiting: deque[FloatArray] = deque()
        self._judged: list[Hypothesis] = []
        self.hypotheses: list[Hypothesis] = []  # the best first
        self._searches = 0
        self._looked = False  # at all that the first search has found
        self._agreed = 0
        self._scans = 0  # since the trail began
        self.trail_from_robot = Pose2()  # at the newest scan

    @property
    def searches(self) -> int:
        """How many searches of the whole map have ended."""
        return self._searches

    @property
    def undecided(self) -> bool:
        """Some places may be it, or the first look at the map has not ended."""
        return bool(self.hypotheses) or not self._looked

    @property
    def strange(self) -> bool:
        """What was seen until now is well known, and no place of the map fits it."""
        return not self.undecided and self._trail.fit > 0.0

    @property
    def settled(self) -> bool:
        """What was seen until now has been looked for, and every place judged."""
        return self._searches > 0 and self._search is None and not self._waiting

    def rival(self, map_from_robot: Pose2) -> Hypothesis | None:
        """The best place that may be believed and is not this one."""
        for h in self.hypotheses:
            if not self.is_believable(h):
                continue
            away = map_from_robot.inverse() @ Pose2.from_array(h.map_from_trail) @ self.trail_from_robot
            doubt = self._config.doubt
            if away.distance_m(Pose2()) >= doubt.apart_m or abs(away.theta_rad) >= doubt.apart_rad:
                return h
        return None

    def judged_at(self, map_from_robot: Pose2) -> Hypothesis | None:
        """How well the map agrees with the robot being there; None before there is anything to say."""
        if self._query is None:
            return None
        start = (map_from_robot @ self.trail_from_robot.inverse()).as_array()
        return verify(self._config.verify, self._reference, self._query, start)

    def add(self, scan: PointScan, units: int | None = None) -> Pose2 | None:
        """The robot in the map at this scan, once there is no doubt; `units`: of work, instead of the usual number."""
        units = self._config.units_per_step if units is None else units
        trail_from_robot = self._trail.add(scan)
        if self._trail.lost_scans > self._config.lost_scans or self._stands_in_doubt():
            self._begin_trail()  # carried off again, or what it saw at first was not the whole truth
            trail_from_robot = self._trail.add(scan)
        elif len(self._trail.keyframes) > self._config.longest_trail_scans:
            trail_from_robot = self._renew_trail(scan, trail_from_robot)
        self._scans += 1
        self.trail_from_robot = trail_from_robot
        if not self._reference.step(units):
            return None
        self._share.begin(units)
        if self._waiting:
            self._judge()
        elif len(self._trail.keyframes) > self._query_scans:
            self._renew_query()
        if self._search is not None:
            self._go_on_searching(self._search)
        elif self._query is not None and not self._waiting and self._wants_search():
            self._searched_m = self._way_m()
            self._search = PlaceSearch(self._config.search, self._reference, self._query)
        return self._decide(scan, trail_from_robot)

    def _stands_in_doubt(self) -> bool:
        """For so long that it is worth to look anew: somebody may have stood round the robot."""
        return (
            self._scans >= self._config.look_again_scans
            and len(self._trail.keyframes) == 1
            and self._search is None
            and not self._waiting
            and not self._is_sure()
        )

    def _renew_trail(self, scan: PointScan, trail_from_robot: Pose2) -> Pose2:
        """A long one is begun anew; the hypotheses stay."""
        kept = self.hypotheses
        self._begin_trail()
        new_from_robot = self._trail.add(scan)
        old_from_new = (trail_from_robot @ new_from_robot.inverse()).as_array()
        self.hypotheses = [replace(h, map_from_trail=compose(h.map_from_trail, old_from_new)) for h in kept]
        self._searched_m = 0.0 if kept else None
        return new_from_robot

    def _renew_query(self) -> None:
        """With what has come since; the hypotheses have to hold for it too."""
        verify_config = self._config.verify
        trajectory = self._trail.trajectory()
        first = recent(trajectory, self._config.trail_m, self._config.trail_scans)
        keyframes = self._trail.keyframes[first:]
        self._query = gather(keyframes, trajectory[first:, 1:], verify_config.spacing_m, verify_config.points)
        self._query_scans = len(trajectory)
        self._waiting.extend(hypothesis.map_from_trail for hypothesis in self.hypotheses)
        if not self._waiting:
            self._agreed = 0

    def _go_on_searching(self, search: PlaceSearch) -> None:
        had_ended = search.ended
        while not search.ended:
            if self._share.left <= 0:
                return
            search.step(self._share)
        if not had_ended and self._share.left < _PLACES_UNITS:
            return
        self._search = None
        self._searches += 1
        known = [hypothesis.map_from_trail for hypothesis in self.hypotheses]
        self._waiting.extend([*known, *search.places()])
        self._looked = self._looked or not self._waiting

    def _judge(self) -> None:
        config, query = self._config.verify, self._query
        if query is None:
            return
        while self._waiting and self._share.left > 0:
            self._judged.append(verify(config, self._reference, query, self._waiting.popleft()))
            self._share.take(_UNITS_PER_BEAM * len(query.points_m))
        if not self._waiting:
            self._keep_possible()
            self._judged = []
        self._looked = self._looked or (self._searches > 0 and not self._waiting)

    def _keep_possible(self) -> None:
        config = self._config.verify
        possible = [
            h for h in self._judged if h.support >= config.keep_support and h.good_share >= config.keep_good_share
        ]
        possible.sort(key=lambda h: -h.support)
        robots = np.array([compose(h.map_from_trail, self._robot_in_trail()) for h in possible]).reshape(-1, 3)
        self.hypotheses = [possible[k] for k in distinct(robots, self._config.search)]
        if not self.hypotheses:
            self._agreed = 0

    def _robot_in_trail(self) -> FloatArray:
        return np.asarray(self._trail.trajectory()[-1, 1:])

    def _wants_search(self) -> bool:
        """At first, and while nothing found can be believed, now and then."""
        if self._searched_m is None:
            return True
        driven_m = self._way_m() - self._searched_m
        return driven_m >= self._config.search_again_m and not self._is_sure()

    def _way_m(self) -> float:
        return float(np.hypot(*np.diff(self._trail.trajectory()[:, 1:3], axis=0).T).sum())

    def _is_sure(self) -> bool:
        if not self.hypotheses:
            return False
        best = self.hypotheses[0]
        second = self.hypotheses[1].support if len(self.hypotheses) > 1 else 0.0
        return self.is_believable(best) and best.support - second >= self._config.verify.uniqueness

    def is_believable(self, place: Hypothesis) -> bool:
        """By itself, whatever other places there are."""
        config = self._config.verify
        enough = place.beams >= config.min_points
        return enough and place.good_share >= config.min_good_share and place.support >= config.min_support

    def _decide(self, scan: PointScan, trail_from_robot: Pose2) -> Pose2 | None:
        if self._waiting or self._search is not None or not self._is_sure():
            return None
        pose = compose(self.hypotheses[0].map_from_trail, trail_from_robot.as_array())
        lines = to_lines(scan.points_m, scan.origin_m, self._config.trail.normals)
        match = self._reference.matcher.refine(lines, self._reference.local_map, pose)
        self._agreed = self._agreed + 1 if match.share >= self._config.verify.scan_share else 0
        return Pose2.from_array(pose) if self._agreed >= self._config.verify.confirmations else None
