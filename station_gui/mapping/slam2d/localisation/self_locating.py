"""A SLAM that notices when it no longer knows where the robot is, and finds it again in its own map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.base import StoredSlam
from station_gui.mapping.slam2d.config import GridConfig
from station_gui.mapping.slam2d.keyframes import Placed
from station_gui.mapping.slam2d.localisation.config import LocalisationConfig
from station_gui.mapping.slam2d.localisation.doubt import Check, Verdict, Wariness
from station_gui.mapping.slam2d.localisation.early import EarlyOdometry
from station_gui.mapping.slam2d.localisation.reference import Reference
from station_gui.mapping.slam2d.localisation.rehearsal import rehearse_search
from station_gui.mapping.slam2d.localisation.relocaliser import Relocaliser
from station_gui.mapping.slam2d.se2_arrays import compose
from station_gui.mapping.snapshot import GridMap, Tracking


class SelfLocatingSlam:
    """See `SessionSlam`. Goes on with `inner` while its scans fit; else looks for the robot in the whole map.

    A robot that has driven far where no place of the map fits, in a map that may grow, begins a new piece of it. That
    is apart until the robot is found in the rest, or a loop closes. In a map that is fixed it stays lost.
    """

    def __init__(
        self, config: LocalisationConfig, grid: GridConfig, inner: StoredSlam, given: SavedMap | None, *, fixed: bool
    ) -> None:
        """`given`: the map to begin with, in which the robot has to be found first; `fixed`: it is not to change."""
        rehearse_search()
        self._config = config
        self._grid_config = grid
        self._inner = inner
        self._fixed = fixed
        self._scans = Placed()  # on scans of the inner one
        self._inner_scans = 0
        self._early = EarlyOdometry()  # before the robot was found for the first time
        self._first_odometry = Pose2()  # when it was
        self._moved = 0  # how often poses that were given out have changed by being found
        self._odometry = Pose2()
        self._pose = Pose2()
        self._relocaliser: Relocaliser | None = None
        self._inner_lost = False  # it is told nothing until the robot is found
        self._wariness = Wariness(config.doubt)
        self._check: Check | None = None  # while there is doubt
        inner.guard(self._admits)
        self._strange_way_m = 0.0  # driven where no place of the map fits
        if given is not None:
            inner.load(given)
            self._lose()

    def add(self, scan: PointScan) -> Pose2:
        """See `Slam.add`. While the robot is lost: its place by odometry from where it was seen last."""
        motion = self._odometry.inverse() @ scan.odom_from_robot if len(self) else Pose2()
        if self._relocaliser is None:
            self._follow(scan, motion)
        elif self._inner_lost:
            self._look(self._relocaliser, scan, motion)
        else:
            self._map_apart(self._relocaliser, scan)
        self._odometry = scan.odom_from_robot
        return self._pose

    def __len__(self) -> int:
        return len(self._early) + len(self._scans)

    def _admits(self, fit: float, surprise: float) -> bool:
        """A piece that is apart is held to nothing yet, and a map that has hardly begun tells nothing odd from new."""
        young = len(self._inner.keyframes) < self._config.doubt.min_keyframes
        return young or self._relocaliser is not None or self._wariness.admits(fit, surprise)

    def _follow(self, scan: PointScan, motion: Pose2) -> None:
        inner, wariness = self._inner, self._wariness
        self._pose = inner.add(scan)
        self._note_inner_scan()
        if len(inner.keyframes) >= self._config.doubt.min_keyframes:
            wariness.note(inner.fit, inner.surprise, motion)
        if inner.lost_scans >= self._config.lost_scans:
            self._lose(self._check.of_all() if self._check is not None else None)
            return
        if self._check is None and wariness.lasting:
            self._check = Check(self._config, self._grid_config, inner)
        if self._check is not None:
            self._go_on_checking(self._check, scan)

    def _go_on_checking(self, check: Check, scan: PointScan) -> None:
        wariness = self._wariness
        verdict = check.add(scan, self._pose, jumped=wariness.jumped, standing=wariness.standing)
        if verdict is Verdict.CARRIED:
            self._lose(check.of_all())
        elif verdict is Verdict.UNFOUNDED or not self._wariness.wary:
            self._check = None
            if verdict is Verdict.UNFOUNDED:
                self._wariness.accept(self._inner.fit)

    def _map_apart(self, relocaliser: Relocaliser, scan: PointScan) -> None:
        """The piece grows; meanwhile the robot is looked for in the rest, until it is found or a loop closes."""
        found = relocaliser.add(scan)
        if found is not None:
            self._located(self._inner.join(scan, found))
            return
        self._pose = self._inner.add(scan)
        self._note_inner_scan()
        if not self._inner.apart:
            self._relocaliser = None

    def _note_inner_scan(self) -> None:
        self._inner_scans += 1
        self._scans.append(self._inner_scans - 1, np.zeros(3))

    def _lose(self, relocaliser: Relocaliser | None = None) -> None:
        """Look for the robot, by what looks for it already where there is one."""
        everywhere = np.ones(len(self._inner.keyframes), np.bool_)
        self._relocaliser = relocaliser or self._new_relocaliser(everywhere)
        self._inner_lost = True
        self._check = None
        self._wariness.begin()
        self._strange_way_m = 0.0

    def _new_relocaliser(self, among: NDArray[np.bool_]) -> Relocaliser:
        """`among`: (K,), the keyframes in question."""
        inner, config = self._inner, self._config
        known = [inner.keyframes[k] for k in np.flatnonzero(among).tolist()]
        poses = inner.keyframe_poses()[among]
        return Relocaliser(config, Reference(config.reference, config.trail.match, self._grid_config, known, poses))

    def _look(self, relocaliser: Relocaliser, scan: PointScan, motion: Pose2) -> None:
        found = relocaliser.add(scan)
        if found is not None:
            self._go_on(scan, found)
            return
        self._pose = self._pose @ motion
        self._strange_way_m += motion.distance_m(Pose2()) if relocaliser.strange else 0.0
        if not self._fixed and self._strange_way_m > self._config.give_up_m:
            self._begin_piece(scan)
        elif self._inner_scans == 0:
            self._early.append(scan.odom_from_robot)
        else:
            last = len(self._scans) - 1
            self._scans.append(self._inner_scans - 1, compose(self._scans.in_node(last), motion.as_array()))

    def _begin_piece(self, scan: PointScan) -> None:
        """The robot is looked for in the map as it was, by what looks for it already."""
        if self._inner_scans == 0:
            self._first_odometry = scan.odom_from_robot
            self._pose = self._beside_the_map(scan)
        self._pose = self._inner.begin_piece(scan, self._pose)
        self._note_inner_scan()
        self._inner_lost = False
        self._moved += 1

    def _beside_the_map(self, scan: PointScan) -> Pose2:
        """Clear of it."""
        poses = self._inner.keyframe_poses()
        reach_m = float(np.abs(scan.points_m).max(initial=0.0))
        margin_m = self._config.beside_m + min(reach_m, self._config.beside_m)
        return Pose2(float(poses[:, 0].max()) + margin_m, float(poses[:, 1].mean()), 0.0)

    def _go_on(self, scan: PointScan, found: Pose2) -> None:
        if self._inner_scans == 0:
            self._first_odometry = scan.odom_from_robot
        self._located(self._inner.resume(scan, found))

    def _located(self, pose: Pose2) -> None:
        """In the map, or in a piece of it that is apart: then the robot is looked for in the rest."""
        self._pose = pose
        self._note_inner_scan()
        self._inner_lost = False
        self._relocaliser = None
        if self._inner.apart and not self._fixed:
            pieces = self._inner.keyframe_pieces()
            self._relocaliser = self._new_relocaliser(pieces != pieces[-1])
        self._moved += 1

    @property
    def tracking(self) -> Tracking:
        if self._relocaliser is not None and self._inner_lost:
            return Tracking.SEARCHING if self._relocaliser.undecided else Tracking.LOST
        return Tracking.APART if self._inner.apart else Tracking.LOCATED

    @property
    def places(self) -> int:
        return len(self._relocaliser.hypotheses) if self._relocaliser is not None else 0

    @property
    def inner(self) -> StoredSlam:
        """The method that follows the robot."""
        return self._inner

    @property
    def fixed(self) -> bool:
        return self._fixed

    def finish(self) -> None:
        self._inner.finish()

    def pose_of_scan(self, index: int) -> Pose2:
        """Of one before the robot was found for the first time: by odometry from there."""
        if index < len(self._early):
            return self._early_pose(index)
        place = index - len(self._early)
        return self._inner.pose_of_scan(self._scans.node_of(place)) @ Pose2.from_array(self._scans.in_node(place))

    def _early_pose(self, index: int) -> Pose2:
        odometry = self._early[index]
        if self._inner_scans == 0:
            return self._early[0].inverse() @ odometry
        return self._inner.pose_of_scan(0) @ (self._first_odometry.inverse() @ odometry)

    @property
    def revision(self) -> int:
        return self._inner.revision + self._moved

    def trajectory(self) -> NDArray[np.float64]:
        return self._inner.trajectory()

    def closures(self) -> NDArray[np.int32]:
        return self._inner.closures()

    def grid(self) -> GridMap:
        return self._inner.grid()

    def saved(self) -> SavedMap:
        return self._inner.saved()
