"""Follows the robot in a map that does not change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.base import Admits, MappingError
from station_gui.mapping.slam2d.belief import odometry_sigma, surprise
from station_gui.mapping.slam2d.config import GraphSlamConfig
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.graph.stored import fill
from station_gui.mapping.slam2d.grid.occupancy_grid import OccupancyGrid
from station_gui.mapping.slam2d.keyframes import Keyframe, Placed
from station_gui.mapping.slam2d.lines import lines_of
from station_gui.mapping.slam2d.local_map_builder import LocalMapBuilder
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, ScanMatcher
from station_gui.mapping.slam2d.se2_arrays import between, compose
from station_gui.mapping.snapshot import GridMap

FloatArray = NDArray[np.float64]


class MapTracker:
    """See `StoredSlam`. Every scan is matched with the window of the map round the robot; none enters the map."""

    def __init__(self, config: GraphSlamConfig) -> None:
        self._config = config
        self._matcher = ScanMatcher(config.match, config.local_map.reach_cells, config.local_map.cell_m)
        self._window = LocalMapBuilder(config.local_map)
        self._graph = PoseGraph(config.pose_graph)
        self._picture: GridMap | None = None
        self._by_node: list[list[Keyframe]] = []
        self._saved: SavedMap | None = None
        self._keyframe_places = Placed()
        self._scans = Placed()
        self._pose = np.zeros(3)
        self._odometry = Pose2()
        self._window_at = np.zeros(3)
        self._lost_scans = 0
        self._fit = 1.0
        self._surprise = 0.0

    def load(self, saved: SavedMap) -> None:
        fill(self._graph, saved)
        self._saved = saved
        self._by_node = [[] for _ in range(len(saved.nodes))]
        for keyframe in saved.keyframes:
            self._keyframe_places.append(keyframe.node, keyframe.in_node)
            self._by_node[keyframe.node].append(keyframe)

    def saved(self) -> SavedMap:
        """The map that was given."""
        if self._saved is None:
            raise MappingError("there is no map to save")
        return self._saved

    def resume(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        lines = lines_of(scan, self._config.normals)
        self._pose = map_from_robot.as_array()
        self._begin_window()
        while not self._window.step():
            pass
        match = self._matcher.refine(lines, self._window.current, self._pose)
        if match.share >= self._config.match.lost_share and np.isfinite(match.pose).all():
            self._pose = match.pose
        self._lost_scans = 0
        return self._added(scan)

    def add(self, scan: PointScan) -> Pose2:
        lines = lines_of(scan, self._config.normals)
        motion = (self._odometry.inverse() @ scan.odom_from_robot).as_array()
        believed = self._correct(lines, motion)
        if believed or len(lines.points_m) >= self._config.match.min_points:
            self._lost_scans = 0 if believed else self._lost_scans + 1
        moved_m = float(np.hypot(*(self._pose - self._window_at)[:2]))
        if moved_m > self._config.local_map.rebuild_distance_m and not self._window.building:
            self._begin_window()
        self._window.step()
        return self._added(scan)

    def _correct(self, lines: LineScan, motion: FloatArray) -> bool:
        """Predict by odometry, match; False where the prediction stands."""
        config = self._config.match
        predicted = compose(self._pose, motion)
        self._pose = predicted
        if len(lines.points_m) < config.min_points:
            return False
        sigma = odometry_sigma(config, motion)
        match = self._matcher.match(lines, self._window.current, predicted, 1.0 / np.square(sigma))
        self._fit = 0.0
        self._surprise = surprise(predicted, match.pose, sigma)
        if not self._matcher.believes(match.share, self._surprise, self._lost_scans):
            return False
        self._pose = match.pose
        self._fit = match.share
        return True

    def _nearest_node(self) -> int:
        return int(np.argmin(np.hypot(*(self._graph.poses[:, :2] - self._pose[:2]).T)))

    def _begin_window(self) -> None:
        self._window_at = self._pose.copy()
        self._window.begin(self._graph, self._by_node, self._nearest_node(), self._pose)

    def _added(self, scan: PointScan) -> Pose2:
        self._odometry = scan.odom_from_robot
        node = self._nearest_node()
        self._scans.append(node, between(self._graph.poses[node], self._pose))
        return Pose2.from_array(self._pose)

    def begin_piece(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        raise MappingError("this map does not change")

    def join(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        """Nothing moves."""
        return self.resume(scan, map_from_robot)

    @property
    def apart(self) -> bool:
        return self._saved is not None and bool(self._saved.pieces[self._nearest_node()])

    def keyframe_pieces(self) -> NDArray[np.int32]:
        return self._saved.pieces[self._keyframe_places.nodes] if self._saved is not None else np.zeros(0, np.int32)

    @property
    def lost_scans(self) -> int:
        return self._lost_scans

    @property
    def fit(self) -> float:
        return self._fit

    @property
    def surprise(self) -> float:
        return self._surprise

    def guard(self, admits: Admits) -> None:
        """Nothing enters the map."""

    @property
    def keyframes(self) -> Sequence[Keyframe]:
        return self._saved.keyframes if self._saved is not None else ()

    def finish(self) -> None:
        """Nothing was put off."""

    def pose_of_scan(self, index: int) -> Pose2:
        node = self._graph.poses[self._scans.node_of(index)]
        return Pose2.from_array(compose(node, self._scans.in_node(index)))

    @property
    def revision(self) -> int:
        """Nothing moves."""
        return 0

    def trajectory(self) -> FloatArray:
        stamps = np.array([keyframe.stamp_s for keyframe in self.keyframes])
        return np.column_stack((stamps, self.keyframe_poses()))

    def keyframe_poses(self) -> FloatArray:
        return self._keyframe_places.poses(self._graph.poses)

    def closures(self) -> NDArray[np.int32]:
        if self._saved is None:
            return np.zeros((0, 2), np.int32)
        first = np.searchsorted(self._saved.keyframe_nodes(), self._saved.ends[self._saved.robust])
        return np.minimum(first, len(self.keyframes) - 1).astype(np.int32).reshape(-1, 2)

    def grid(self) -> GridMap:
        """Always the same one."""
        if self._picture is None:
            drawn = OccupancyGrid(self._config.grid)
            drawn.add_all(self.keyframes, self._keyframe_places.poses(self._graph.poses))
            self._picture = drawn.snapshot()
        return self._picture
