"""Graph SLAM: scans are tracked on a local map, keyframes hang on the nodes of a graph, closures bend the graph.

Local tracking is scan to map by least squares (as in iris_lama, Pedrosa et al. 2017); loops are found by branch and
bound (as in Cartographer, Hess et al. 2016); the graph is optimised under dynamic covariance scaling (Agarwal et al.
2013). Everything happens in the caller's thread, in an order that depends on the scans alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.base import Admits, admit_all
from station_gui.mapping.slam2d.belief import surprise
from station_gui.mapping.slam2d.config import GraphSlamConfig
from station_gui.mapping.slam2d.graph.loop_closure import LoopCloser, edge_information
from station_gui.mapping.slam2d.graph.node_keyframes import NodeKeyframes
from station_gui.mapping.slam2d.graph.node_way import NodeWay
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.graph.sight.new_ground import NewGround, view_of
from station_gui.mapping.slam2d.graph.sight.sight import View
from station_gui.mapping.slam2d.graph.stored import fill, to_saved
from station_gui.mapping.slam2d.graph.upkeep import GraphUpkeep
from station_gui.mapping.slam2d.grid.following_grid import FollowingGrid
from station_gui.mapping.slam2d.held import HeldScan, HeldScans, is_apart
from station_gui.mapping.slam2d.keyframes import Keyframe, Placed
from station_gui.mapping.slam2d.lines import lines_of
from station_gui.mapping.slam2d.local_map_builder import LocalMapBuilder
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, Match, ScanMatcher
from station_gui.mapping.slam2d.motion import MotionModel, Prediction
from station_gui.mapping.slam2d.pieces import Pieces
from station_gui.mapping.slam2d.rehearsal import rehearse
from station_gui.mapping.slam2d.se2_arrays import between, compose, compose_all
from station_gui.mapping.snapshot import GridMap


class GraphSlam:
    """See `Slam`. Deterministic: the same scans give the same poses bit for bit."""

    def __init__(self, config: GraphSlamConfig) -> None:
        rehearse()
        self._config = config
        self._matcher = ScanMatcher(config.match, config.local_map.reach_cells, config.local_map.cell_m)
        self._local = LocalMapBuilder(config.local_map)
        self._graph = PoseGraph(config.pose_graph)
        self._pieces = Pieces()
        self._grid = FollowingGrid(config.grid)
        self._scans = Placed()
        self._keyframes = NodeKeyframes()
        closer = LoopCloser(config.loops, config.local_map, self._matcher)
        self._upkeep = GraphUpkeep(config.pose_graph, config.loops, closer, self._graph, self._keyframes.by_node)
        self._revision = 0
        self._node = 0
        self._local_from_node = np.zeros(3)
        self._pose = np.zeros(3)  # of the robot in the local map's frame
        self._odometry = Pose2()
        self._motion = MotionModel(config.motion, config.match)
        self._new_ground = NewGround(config.new_ground)
        self._since_rebuild_m = 0.0
        self._node_way = NodeWay(config.keyframes)
        self._lost_scans = 0
        self._fit = 1.0
        self._fair_fit = 1.0  # of the newest match, believed or not
        self._surprise = 0.0
        self._admits: Admits = admit_all
        self._held = HeldScans(config.keyframes)

    def add(self, scan: PointScan) -> Pose2:
        """See `Slam.add`. Raises MappingError for a scan that holds anything but finite numbers."""
        lines = lines_of(scan, self._config.normals)
        if not len(self._keyframes):
            self._begin(scan, lines)
        else:
            self._track(scan, lines)
        return self._added(scan)

    def load(self, saved: SavedMap) -> None:
        """Begin with this map; the next scan has to come by `resume`."""
        fill(self._graph, saved)
        self._pieces.load(saved.pieces)
        self._keyframes.load(saved)
        self._upkeep.closed.extend((int(i), int(j)) for i, j in saved.ends[saved.robust])

    def saved(self) -> SavedMap:
        """The map as it is believed now."""
        return to_saved(self._graph, self._keyframes.all, self._pieces.of_node)

    @property
    def fit(self) -> float:
        """Share of the newest scan's points that fitted, 0 where the match was not believed."""
        return self._fit

    @property
    def surprise(self) -> float:
        """See `StoredSlam`."""
        return self._surprise

    def guard(self, admits: Admits) -> None:
        self._admits = admits

    @property
    def keyframes(self) -> Sequence[Keyframe]:
        """In the order of `trajectory()`."""
        return self._keyframes.all

    @property
    def lost_scans(self) -> int:
        """How many scans in a row have not fitted."""
        return self._lost_scans

    def resume(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        """As `add`, for a robot that somebody else has found to be at this place of the map."""
        lines = lines_of(scan, self._config.normals)
        pose = map_from_robot.as_array()
        away_m = np.hypot(*(self._graph.poses[:, :2] - pose[:2]).T)
        near = int(np.argmin(away_m))
        self._pieces.go_to(near)
        self._pose = pose
        self._node = self._append_node(pose)
        information = self._found_information()
        measured = between(self._graph.poses[near], pose)
        self._graph.add_edge(near, self._node, measured, information, max(float(away_m[near]), 0.1), robust=False)
        self._renew_window()
        match = self._matcher.refine(lines, self._local.current, self._pose)
        if match.share >= self._config.match.lost_share and np.isfinite(match.pose).all():
            self._pose = match.pose
        self._lost_scans = 0
        self._add_keyframe(scan, lines, self._pose_in_node())
        return self._added(scan)

    def begin_piece(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        """See `StoredSlam`. What holds it in the graph is so loose that it moves nothing."""
        config, lines = self._config.pose_graph, lines_of(scan, self._config.normals)
        before, self._pose = self._node, map_from_robot.as_array()
        self._pieces.begin()
        self._node = self._append_node(self._pose)
        measured = between(self._graph.poses[before], self._pose)
        self._add_loose_edge(before, measured, config.unknown_shift_sigma_m, config.unknown_turn_sigma_rad)
        self._begin_window(scan, lines)
        return self._added(scan)

    def join(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        """As `resume`, of a robot followed in a piece that is apart: the piece moves to where it belongs."""
        if self._lost_scans == 0:
            self.add(scan)
        if self._lost_scans:  # what is seen now is not of the piece
            return self.resume(scan, map_from_robot)
        while self._graph.optimising:  # it knows nothing of the move
            self._upkeep.step()
        found, ours = map_from_robot.as_array(), self._pieces.in_current
        new_from_old = compose(found, between(self._map_pose(), np.zeros(3)))
        self._graph.poses[ours] = compose_all(np.tile(new_from_old, (int(ours.sum()), 1)), self._graph.poses[ours])
        away_m = np.where(ours, np.inf, np.hypot(*(self._graph.poses[:, :2] - found[:2]).T))
        old = int(np.argmin(away_m))
        measured = between(self._graph.poses[old], self._graph.poses[self._node])
        way_m = max(float(away_m[old]), 0.1)
        self._graph.add_edge(old, self._node, measured, self._found_information(), way_m, robust=False)
        self._upkeep.closed.append((old, self._node))
        self._pieces.join(old, self._node)
        self._graph.begin_optimisation()
        self._note_revision()
        return Pose2.from_array(self._map_pose())

    @property
    def apart(self) -> bool:
        return self._pieces.apart

    def keyframe_pieces(self) -> NDArray[np.int32]:
        return self._pieces.of_node[self._keyframes.nodes]

    def _found_information(self) -> NDArray[np.float64]:
        config = self._config.pose_graph
        return np.diag(1.0 / np.square([config.found_shift_sigma_m] * 2 + [config.found_turn_sigma_rad]))

    def _added(self, scan: PointScan) -> Pose2:
        self._odometry = scan.odom_from_robot
        self._scans.append(self._node, self._pose_in_node())
        self._work()
        return Pose2.from_array(self._map_pose())

    def finish(self) -> None:
        """Close the last loops, optimise once more, and draw the grid afresh.

        Until then the grid depends a little, in its extent and in cells whose scans moved by a fraction of a cell,
        on when it was asked for; after it on the scans alone.
        """
        if self._graph.nodes == 0:
            return
        self._upkeep.look_for_loops(self._node)
        closures = len(self._upkeep.closed)
        if self._upkeep.finish():
            self._note_revision()
        self._join_pieces(closures)
        self._grid = FollowingGrid(self._config.grid)

    def pose_of_scan(self, index: int) -> Pose2:
        node = self._graph.poses[self._scans.node_of(index)]
        return Pose2.from_array(compose(node, self._scans.in_node(index)))

    def scan_poses(self) -> NDArray[np.float64]:
        """(scans, 3): every scan's pose as it is believed now, map frame."""
        return self._scans.poses(self._graph.poses)

    @property
    def revision(self) -> int:
        return self._revision

    def trajectory(self) -> NDArray[np.float64]:
        return self._keyframes.trajectory(self._graph.poses)

    def keyframe_poses(self) -> NDArray[np.float64]:
        return self._keyframes.poses(self._graph.poses)

    def closures(self) -> NDArray[np.int32]:
        return self._keyframes.first_of(self._upkeep.closed)

    def grid(self) -> GridMap:
        """After a closure that moved much it follows within some seconds of calls, or by `finish`."""
        return self._grid.picture(self._keyframes.all, self.keyframe_poses(), self._revision)

    def _begin(self, scan: PointScan, lines: LineScan) -> None:
        """The map begins with the first scan of enough points; until then the robot is where odometry says."""
        enough = len(lines.points_m) >= self._config.match.min_points
        self._pose = scan.odom_from_robot.as_array()
        if self._graph.nodes == 0:
            self._new_node()
            if enough:
                self._renew_window()
                self._add_keyframe(scan, lines, self._pose_in_node())
        elif enough:
            self._start_over(scan, lines)

    def _track(self, scan: PointScan, lines: LineScan) -> None:
        """Predict by odometry, correct on the local map, extend the map and the graph."""
        odometry = (self._odometry.inverse() @ scan.odom_from_robot).as_array()
        before = self._pose
        match = self._match(scan, lines, self._motion.predict(odometry))
        if match.share == 0.0:
            self._motion.miss()
        self._pose = match.pose
        self._since_rebuild_m += self._node_way.count(between(before, self._pose), match.share)
        if len(lines.points_m) >= self._config.match.min_points:
            self._fit = 0.0 if match.share == 0.0 else self._fair_fit
        if match.share > 0.0:
            self._lost_scans = 0
            self._motion.learn(odometry, before, match)
        elif len(lines.points_m) >= self._config.match.min_points:
            self._lost_scans += 1
            if self._lost_scans > self._config.match.patience_scans:
                self._start_over(scan, lines)
            return
        if not self._admits(self._fit, self._surprise):
            self._held.hold(HeldScan(scan, lines, self._pose_in_node(), self._fit))
            return
        self._admit_held()
        if self._node_way.full:
            self._next_node(match)
        if self._is_keyframe(len(lines.points_m), self._pose_in_node()):
            self._add_keyframe(scan, lines, self._pose_in_node())

    def _admit_held(self) -> None:
        """The robot was where it was followed, jumps and all: what fits as is usual by now enters the map."""
        for held in self._held.release():
            if self._admits(held.fit, 0.0) and self._is_keyframe(len(held.lines.points_m), held.in_node):
                self._add_keyframe(held.scan, held.lines, held.in_node)

    def _match(self, scan: PointScan, lines: LineScan, prediction: Prediction) -> Match:
        """Where the match does not deserve belief the prediction stands, with the odometry's own information."""
        config = self._config.match
        predicted = compose(self._pose, prediction.motion)
        weight = 1.0 / np.square(prediction.sigma)
        if len(lines.points_m) >= config.min_points:
            match = self._matcher.match(lines, self._local.current, predicted, weight)
            self._surprise = surprise(predicted, match.pose, prediction.sigma)
            self._fair_fit = self._without_new_ground(scan, lines, match)
            if self._matcher.believes(self._fair_fit, self._surprise, self._lost_scans):
                return match
        return Match(predicted, np.diag(weight), 0.0, 0.0)

    def _without_new_ground(self, scan: PointScan, lines: LineScan, match: Match) -> float:
        """Share of points that fit, of those that the map knows something of."""
        if not self._new_ground.may_be(match.share, self._surprise, len(lines.points_m)):
            return match.share
        node, poses = self._graph.poses[self._node], self._graph.poses
        asked = self._new_ground.picked(self._keyframes.all)
        views = [View(compose(between(node, poses[h.keyframe.node]), h.keyframe.in_node), h) for h in asked]
        here = view_of(lines, scan.origin_m, between(self._local_from_node, match.pose))
        return self._new_ground.fair_share(match.share, here, views)

    def _next_node(self, match: Match) -> None:
        config = self._config.pose_graph
        measured = self._pose_in_node()
        loose = self._node_way.looseness(config.misfit_ratio)
        information = edge_information(
            match.information,
            float(self._local_from_node[2]),
            loose * config.shift_sigma_m,
            loose * config.turn_sigma_rad,
        )
        before, way_m = self._node, self._node_way.way_m
        self._new_node()
        self._graph.add_edge(before, self._node, measured, information, max(way_m, 0.1), robust=False)
        self._upkeep.look_for_loops(before)

    def _start_over(self, scan: PointScan, lines: LineScan) -> None:
        """Lost for good: a new piece of map, held to the old one by odometry until a loop joins them."""
        config = self._config.pose_graph
        measured = self._pose_in_node()
        before = self._node
        if len(self._keyframes):
            self._pieces.begin()
        self._new_node()
        self._add_loose_edge(before, measured, config.lost_shift_sigma_m, config.lost_turn_sigma_rad)
        self._begin_window(scan, lines)

    def _add_loose_edge(self, before: int, measured: NDArray[np.float64], shift_m: float, turn_rad: float) -> None:
        """To the newest node, which is the first of a piece; `shift_m`, `turn_rad`: standard deviations."""
        information = np.diag(1.0 / np.square([shift_m, shift_m, turn_rad]))
        apart_m = 2 * self._config.local_map.graph_reach_m  # so that the old piece stays out of the local map
        self._graph.add_edge(before, self._node, measured, information, apart_m, robust=False)

    def _begin_window(self, scan: PointScan, lines: LineScan) -> None:
        """Of a piece that begins with this scan."""
        self._renew_window()
        self._lost_scans = 0
        self._add_keyframe(scan, lines, self._pose_in_node())

    def _renew_window(self) -> None:
        """All of it at once."""
        self._local.begin(self._graph, self._keyframes.by_node, self._node, self._map_pose())
        while not self._local.step():
            pass
        self._adopt_window()

    def _new_node(self) -> None:
        """At the robot's pose."""
        pose = self._pose if self._graph.nodes == 0 else self._map_pose()
        if self._graph.nodes:
            self._local.next_node(self._pose_in_node())
        self._node = self._append_node(pose)

    def _append_node(self, pose: NDArray[np.float64]) -> int:
        self._local_from_node = self._pose.copy()
        self._keyframes.add_node()
        self._held.release()  # what is held for a node that came to its end unseen is of a robot that was lost
        self._node_way.begin()
        self._pieces.add_node()
        return self._graph.add_node(pose)

    def _is_keyframe(self, points: int, in_node: NDArray[np.float64]) -> bool:
        if points < self._config.match.min_points:
            return False
        keyframes = self._keyframes.by_node[self._node]
        return not keyframes or is_apart(self._config.keyframes, keyframes[-1].in_node, in_node)

    def _add_keyframe(self, scan: PointScan, lines: LineScan, in_node: NDArray[np.float64]) -> None:
        keyframe = Keyframe(
            scan.stamp_s,
            self._node,
            in_node,
            lines.points_m.astype(np.float32),
            lines.normals.astype(np.float32),
            scan.origin_m,
        )
        self._keyframes.append(keyframe)
        self._local.insert(lines, compose(self._local_from_node, in_node))
        self._local.add_pending(keyframe)

    def _work(self) -> None:
        """A bounded share of what is put off: loops and their optimisation, some scans of the next window."""
        busy, closures = self._upkeep.busy, len(self._upkeep.closed)
        if self._upkeep.step():
            self._note_revision()
        self._join_pieces(closures)
        if not self._local.building and self._since_rebuild_m > self._config.local_map.rebuild_distance_m:
            self._since_rebuild_m = 0.0
            self._local.begin(self._graph, self._keyframes.by_node, self._node, self._map_pose())
        elif self._local.step(spare=busy):
            self._adopt_window()

    def _join_pieces(self, first: int) -> None:
        """By the closures from this one on."""
        for pair in self._upkeep.closed[first:]:
            self._pieces.join(*pair)

    def _note_revision(self) -> None:
        """The nodes have moved: the next window shall be drawn as they are now."""
        self._revision += 1
        self._since_rebuild_m = math.inf

    def _adopt_window(self) -> None:
        in_node = self._pose_in_node()
        self._local_from_node = self._local.current_from_node
        self._pose = compose(self._local_from_node, in_node)

    def _pose_in_node(self) -> NDArray[np.float64]:
        return between(self._local_from_node, self._pose)

    def _map_pose(self) -> NDArray[np.float64]:
        return compose(self._graph.poses[self._node], self._pose_in_node())
