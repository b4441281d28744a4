"""Whether scans that fit worse than usual mean that the robot was carried off while it was followed.

A robot that stands where things look alike may fit by chance, well enough to be followed on. Three things tell it from
one past which somebody walks: it lasts, its scans and those of the map look through each other's points more than is
usual there, and there is another place that explains them far better.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.base import StoredSlam
from station_gui.mapping.slam2d.config import GridConfig
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.localisation.config import DoubtConfig, LocalisationConfig
from station_gui.mapping.slam2d.localisation.contradiction import Contradiction
from station_gui.mapping.slam2d.localisation.reference import Reference
from station_gui.mapping.slam2d.localisation.relocaliser import Relocaliser
from station_gui.mapping.slam2d.matching.scan_matcher import to_lines
from station_gui.mapping.slam2d.share import Share, Task

_POSES_PER_UNIT = 2  # of the map, looked through for those near by


class Wariness:
    """Which scans are odd, and whether that lasts. While it may, no scan is to enter the map."""

    def __init__(self, config: DoubtConfig) -> None:
        self._config = config
        self._usual_fit = 1.0
        self._rest = 0  # scans that have to pass before the fit is doubted again
        self.calm_down()

    def calm_down(self) -> None:
        self._odd_scans = 0
        self._calm_scans = 0
        self._way_m = 0.0  # since the first odd scan
        self._moved_m = 0.0  # the same, with the way to that scan
        self.jumped = False  # farther than odometry allows

    def begin(self) -> None:
        """The robot was found at a place: what was usual is of no concern."""
        self._usual_fit = 1.0
        self._rest = 0
        self.calm_down()

    def accept(self, fit: float) -> None:
        """There was nothing in it: this is how scans fit here."""
        self._usual_fit = fit
        self._rest = self._config.rest_scans
        self.calm_down()

    def admits(self, fit: float, surprise: float) -> bool:
        """Whether a scan may enter the map."""
        return not (self.wary or self._is_odd(fit, surprise))

    def note(self, fit: float, surprise: float, motion: Pose2) -> None:
        """The newest scan, whether it entered the map or not; `motion` since the one before, by odometry."""
        config = self._config
        self._rest = max(0, self._rest - 1)
        way_m = motion.distance_m(Pose2()) + config.turn_m * abs(motion.theta_rad)
        self._moved_m = self._moved_m + way_m if self.wary else way_m
        if self.wary:
            self._way_m += way_m
            if self._way_m > config.longest_m:
                self.accept(fit)
                return
        if self._is_odd(fit, surprise):
            self._odd_scans += 1
            self._calm_scans = 0
            self.jumped = self.jumped or surprise > config.jump_sigmas
            return
        self._calm_scans += 1
        if self._calm_scans >= config.calm_scans and not self.jumped:
            self.calm_down()
        if not self.wary:
            self._usual_fit += config.usual_rate * (fit - self._usual_fit)

    @property
    def wary(self) -> bool:
        return self._odd_scans > 0

    @property
    def lasting(self) -> bool:
        return self.jumped or self._odd_scans >= self._config.odd_scans

    @property
    def standing(self) -> bool:
        """By odometry, since the scan before the first odd one."""
        return self._moved_m <= self._config.standing_m

    def _is_odd(self, fit: float, surprise: float) -> bool:
        if surprise > self._config.jump_sigmas:
            return True
        return self._rest == 0 and fit < self._usual_fit - self._config.fit_drop


class Verdict(Enum):
    OPEN = "open"
    UNFOUNDED = "unfounded"
    CARRIED = "carried off"


class Check:
    """Looks round where the robot is followed for a place that fits far better."""

    def __init__(self, config: LocalisationConfig, grid: GridConfig, inner: StoredSlam) -> None:
        """In the map as it is: nothing enters it meanwhile."""
        self._config = config
        self._grid = grid
        self._keyframes, self._poses = inner.keyframes, inner.keyframe_poses()
        self._share = Share()
        self._first_look: Task | None = None
        self._jumped = False
        self._reference: Reference | None = None  # once the first look has found reason
        self._everywhere = False
        self._relocaliser: Relocaliser | None = None  # once the reference is ready
        self._scans = 0
        self._checked_scans = 0  # since the first search has ended

    def of_all(self) -> Relocaliser | None:
        """What looks in the whole map already, if anything does."""
        if self._reference is None or not self._everywhere:
            return None
        return self._relocaliser or Relocaliser(self._config, self._reference)

    def add(self, scan: PointScan, map_from_robot: Pose2, *, jumped: bool, standing: bool) -> Verdict:
        """`map_from_robot`: where the robot is followed; `jumped`: to there, farther than odometry allows.

        In haste where it has jumped while `standing`, or stands on in doubt: then it may well have been carried off.
        """
        self._jumped = jumped
        self._scans += 1
        doubt = self._config.doubt
        in_haste = standing and (jumped or self._scans > doubt.patience_scans)
        units = doubt.hasty_units_per_step if in_haste else doubt.units_per_step
        if self._relocaliser is not None:
            return self._look_for_rival(self._relocaliser, scan, map_from_robot, units)
        if self._reference is not None:
            if self._reference.step(units):
                self._relocaliser = Relocaliser(self._config, self._reference)
            return Verdict.OPEN
        if self._first_look is None:
            self._first_look = self._look_first(scan, map_from_robot)
        if self._share.run(self._first_look, units) and self._reference is None:
            return Verdict.UNFOUNDED
        return Verdict.OPEN

    def _look_first(self, scan: PointScan, robot: Pose2) -> Task:
        """Whether there is reason to look round."""
        lines = to_lines(scan.points_m, scan.origin_m, self._config.trail.normals)
        points_m, normals = lines.points_m.astype(np.float32), lines.normals.astype(np.float32)
        seen = Keyframe(scan.stamp_s, 0, np.zeros(3), points_m, normals, scan.origin_m)
        near = self._near(robot)
        known, poses = [self._keyframes[k] for k in near.tolist()], self._poses[near]
        self._share.take(len(self._poses) // _POSES_PER_UNIT + len(near))
        contradiction = Contradiction(self._config.doubt, known, poses)
        contradicted = not self._jumped and (yield from contradiction.look(seen, robot.as_array(), self._share))
        if contradicted or self._jumped:
            stride = max(1, -(-len(near) // self._config.doubt.max_keyframes))
            self._everywhere = len(near) == len(self._poses)
            self._reference = self._of_places(known[::stride], poses[::stride])

    def _near(self, robot: Pose2) -> NDArray[np.int64]:
        """The keyframes that it may have been carried from, or the nearest one."""
        away_m2 = (self._poses[:, 0] - robot.x_m) ** 2 + (self._poses[:, 1] - robot.y_m) ** 2
        return np.flatnonzero(away_m2 <= max(self._config.doubt.reach_m**2, float(away_m2.min())))

    def _of_places(self, known: Sequence[Keyframe], poses: NDArray[np.float64]) -> Reference:
        return Reference(self._config.reference, self._config.trail.match, self._grid, known, poses)

    def _look_for_rival(self, relocaliser: Relocaliser, scan: PointScan, robot: Pose2, units: int) -> Verdict:
        relocaliser.add(scan, units)
        self._checked_scans += relocaliser.searches > 0
        if self._checked_scans > self._config.doubt.longest_scans:
            return Verdict.UNFOUNDED
        if not relocaliser.settled:
            return Verdict.OPEN
        followed = relocaliser.judged_at(robot)
        if followed is None:
            return Verdict.OPEN
        rival = relocaliser.rival(robot)
        if rival is None:
            carried = self._jumped and not relocaliser.is_believable(followed)
            return Verdict.CARRIED if carried else Verdict.UNFOUNDED
        rival_share = self._config.doubt.rival_share
        better = -rival_share if self._jumped else rival_share
        return Verdict.CARRIED if rival.support >= followed.support + better else Verdict.OPEN
