"""SLAM by a Rao-Blackwellized particle filter (Grisetti, Stachniss and Burgard 2007, "GMapping").

Every particle is a path and the map that follows from it. Once in a while all of them move, by a proposal that is
matched on their own map, are weighted, and resampled when their effective number is low. The scans in between are
matched on the best particle's map, and ride on its last step. Where the odometry says little, or the best particle's
match contradicts it, each particle also begins from a draw of its own, so that several places are kept that fit.

Where the robot comes back after a long way the particles do not spread over the error, and no resampling finds a path
that none of them went. Such a loop is looked for, and closed by moving the paths as a whole (resample-move, Gilks and
Berzuini 2001): see `closing`. Until then what is far back along the way does not count in the particles' maps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.base import Admits, admit_all
from station_gui.mapping.slam2d.belief import surprise
from station_gui.mapping.slam2d.grid.following_grid import FollowingGrid
from station_gui.mapping.slam2d.keyframes import Keyframe, Placed
from station_gui.mapping.slam2d.lines import lines_of
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan
from station_gui.mapping.slam2d.particle.ancestry import Ancestry
from station_gui.mapping.slam2d.particle.blocks.block_maps import BlockMaps
from station_gui.mapping.slam2d.particle.closing.loop_closer import LoopCloser
from station_gui.mapping.slam2d.particle.closing.loop_finder import Way
from station_gui.mapping.slam2d.particle.closing.path_bender import Bent
from station_gui.mapping.slam2d.particle.config import ParticleSlamConfig
from station_gui.mapping.slam2d.particle.proposal.deviates import Deviates
from station_gui.mapping.slam2d.particle.proposal.proposer import Proposer
from station_gui.mapping.slam2d.particle.resampling import Weights
from station_gui.mapping.slam2d.particle.stored import Break, Joints, steps_of, to_saved
from station_gui.mapping.slam2d.pieces import Pieces
from station_gui.mapping.slam2d.rehearsal import rehearse
from station_gui.mapping.slam2d.se2_arrays import between, compose, compose_all
from station_gui.mapping.snapshot import GridMap

FloatArray = NDArray[np.float64]


class ParticleSlam:
    """See `Slam`. The same scans and the same generator give the same poses bit for bit."""

    def __init__(self, config: ParticleSlamConfig, rng: np.random.Generator) -> None:
        rehearse()
        self._config = config
        self._rng = rng
        self._maps = BlockMaps(config.maps, config.particles)
        self._proposer = Proposer(config.proposal, self._maps)
        self._closer = LoopCloser(config.closing, self._maps)
        self._ancestry = Ancestry()
        self._ends = np.full(config.particles, -1, np.int64)  # the particles' newest nodes
        self._poses = np.zeros((config.particles, 3))  # at the last step
        update = config.update
        self._weights = Weights(config.particles, update.independent_share, update.resample_share)
        self._deviates = Deviates(config.particles, config.proposal.alike_m)
        self._best = 0
        self._scans = Placed()
        self._steps: list[Keyframe] = []
        self._pieces = Pieces()  # of the steps
        self._rel = np.zeros(3)  # the robot, in the frame of the last step
        self._odometry_rel = np.zeros(3)  # the same by odometry alone
        self._odometry = Pose2()
        self._lost_scans = 0
        self._fit = 1.0
        self._surprise = 0.0
        self._misfit = 0.0  # of the scans since the last step, shares of points that did not fit
        self._misfit_scans = 0
        self._admits: Admits = admit_all
        self._revision = 0
        self._in_map: list[bool] = []  # of each step, whether its scan is
        self._given: SavedMap | None = None
        self._breaks: dict[int, Break] = {}
        self._path_end = -1
        self._path = np.zeros((0, 3))  # to that end
        self._grid = FollowingGrid(config.grid)

    def add(self, scan: PointScan) -> Pose2:
        """See `Slam.add`. Raises MappingError for a scan that holds anything but finite numbers."""
        lines = lines_of(scan, self._config.normals, self._config.proposal.max_range_m)
        if not any(self._in_map):
            self._begin(scan, lines)
        else:
            self._track(scan, lines)
        return self._added(scan)

    def load(self, saved: SavedMap) -> None:
        """Begin with this map, the same for all particles; the next scan has to come by `resume`."""
        steps, poses = steps_of(saved)
        self._steps = [replace(step, node=0) for step in steps]
        self._pieces.load(saved.pieces[saved.keyframe_nodes()])
        end = np.full(1, -1, np.int64)
        for step, pose in zip(self._steps, poses, strict=True):
            self._maps.insert(0, step.lines(), pose)
            end = self._ancestry.extend(end, pose[None])
        self._maps.adopt(np.zeros(len(self._poses), np.int64))
        self._ends[:] = end[0]
        self._poses[:] = poses[-1]
        self._in_map = [True] * len(self._steps)
        self._closer.course.begin_given()
        self._given = saved

    def saved(self) -> SavedMap:
        """The map of the best particle."""
        joints = Joints(self._given, self._breaks, self._closer.course, self._pieces.of_node)
        return to_saved(self._steps, self._step_poses(), joints)

    def resume(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        """As `add`, for a robot that somebody else has found to be at this place of the map."""
        lines = lines_of(scan, self._config.normals, self._config.proposal.max_range_m)
        self._poses[:] = map_from_robot.as_array()
        self._lost_scans = 0
        self._breaks[len(self._steps)] = "found"
        self._pieces.go_to(int(np.argmin(np.hypot(*(self._step_poses()[:, :2] - self._poses[0, :2]).T))))
        self._record(scan, lines, np.ones(len(self._poses), bool), np.eye(3))
        return self._added(scan)

    def begin_piece(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        """See `StoredSlam`."""
        lines = lines_of(scan, self._config.normals, self._config.proposal.max_range_m)
        self._poses[:] = map_from_robot.as_array()
        self._lost_scans = 0
        self._breaks[len(self._steps)] = "apart"
        self._pieces.begin()
        self._record(scan, lines, np.ones(len(self._poses), bool), np.eye(3))
        return self._added(scan)

    def join(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        """The piece stays where it is, apart: the robot goes on in the old part."""
        return self.resume(scan, map_from_robot)

    @property
    def apart(self) -> bool:
        return self._pieces.apart

    def keyframe_pieces(self) -> NDArray[np.int32]:
        return self._pieces.of_node

    @property
    def resamplings(self) -> int:
        """How often particles have died out in favour of likelier ones."""
        return self._weights.resamplings

    @property
    def effective_share(self) -> float:
        """Mean of the particles' effective number, as a share of all (Grisetti et al. 2007, eq. 20)."""
        return self._weights.effective_share

    @property
    def lost_scans(self) -> int:
        """How many scans in a row have not fitted."""
        return self._lost_scans

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
        return self._steps

    def _added(self, scan: PointScan) -> Pose2:
        self._odometry = scan.odom_from_robot
        self._close()
        self._scans.append(len(self._steps) - 1, self._rel)
        return Pose2.from_array(compose(self._poses[self._best], self._rel))

    def finish(self) -> None:
        """Close the last loops, and draw the grid afresh, so that it depends on the scans alone."""
        if self._steps:
            self._closer.look_from_last(self._way())
            while self._closer.busy:
                self._close(last=True)
        self._grid = FollowingGrid(self._config.grid)

    def pose_of_scan(self, index: int) -> Pose2:
        return Pose2.from_array(compose(self._step_poses()[self._scans.node_of(index)], self._scans.in_node(index)))

    def scan_poses(self) -> FloatArray:
        """(scans, 3): every scan's pose on the best particle's path, map frame."""
        return self._scans.poses(self._step_poses())

    @property
    def revision(self) -> int:
        return self._revision

    def trajectory(self) -> FloatArray:
        return np.column_stack((np.array([step.stamp_s for step in self._steps]), self.keyframe_poses()))

    def keyframe_poses(self) -> FloatArray:
        return self._step_poses()

    def closures(self) -> NDArray[np.int32]:
        return self._closer.closures()

    def grid(self) -> GridMap:
        """After paths have moved much it follows within some seconds of calls, or by `finish`."""
        return self._grid.picture(self._steps, self._step_poses(), self._revision)

    def _begin(self, scan: PointScan, lines: LineScan) -> None:
        """The map begins with the first scan of enough points; until then the robot is where odometry says."""
        enough = len(lines.points_m) >= self._config.proposal.min_points
        at = scan.odom_from_robot.as_array()
        if self._steps and not enough:
            self._rel = between(self._poses[self._best], at)
            return
        self._poses[:] = at
        self._record(scan, lines, np.full(len(self._poses), enough), np.eye(3))

    def _track(self, scan: PointScan, lines: LineScan) -> None:
        """Predict by odometry, correct on the best particle's map, and step when the robot has gone far enough."""
        motion = (self._odometry.inverse() @ scan.odom_from_robot).as_array()
        self._odometry_rel = compose(self._odometry_rel, motion)
        predicted = compose(self._rel, motion)
        believed = self._correct(lines, predicted, motion)
        if len(lines.points_m) < self._config.proposal.min_points:
            return
        self._misfit += 1.0 - self._fit
        self._misfit_scans += 1
        self._lost_scans = 0 if believed else self._lost_scans + 1
        patient = not believed and self._lost_scans <= self._config.update.patience_scans
        if self._gone_far() and not patient and self._admits(self._fit, self._surprise):
            self._step(scan, lines)

    def _correct(self, lines: LineScan, predicted: FloatArray, motion: FloatArray) -> bool:
        """Moves the robot; False where the prediction stands because the match does not deserve belief."""
        self._rel = predicted
        if len(lines.points_m) < self._config.proposal.min_points:
            return False
        base = self._poses[self._best]
        sigma = self._proposer.odometry_sigma(motion)
        expected = compose(base, predicted)
        match = self._proposer.track(self._best, lines, expected, sigma)
        self._fit = 0.0
        self._surprise = surprise(expected, match.pose, sigma)
        if not self._proposer.believes(match, expected, sigma):
            return False
        self._rel = between(base, match.pose)
        self._fit = match.share
        return True

    def _gone_far(self) -> bool:
        config = self._config.update
        way_m = max(float(np.hypot(*self._rel[:2])), float(np.hypot(*self._odometry_rel[:2])))
        return way_m >= config.distance_m or abs(float(self._rel[2])) >= config.turn_rad

    def _step(self, scan: PointScan, lines: LineScan) -> None:
        """Algorithm 1: propose, weigh, resample, extend the maps."""
        log_factors, matched, information = self._propose(lines)
        wanting = self._weights.weigh(log_factors)
        best_before = int(self._ends[self._best])
        if wanting or self._maps.crowded:
            parents = self._weights.parents(float(self._rng.random()))
            self._take_over(parents)
            matched, information = matched[parents], information[parents]
        self._best = self._weights.best()
        if int(self._ends[self._best]) != best_before:
            self._revision += 1
        self._record(scan, lines, matched, information[self._best])

    def _propose(self, lines: LineScan) -> tuple[FloatArray, NDArray[np.bool_], FloatArray]:
        """(N,) factors of the weights, (N,) whether the match was believed, (N, 3, 3) its information.

        The particles move.
        """
        sigma = self._proposer.odometry_sigma(self._odometry_rel)
        deviates = self._deviates.draw(self._rng, self._rel)
        others = self._other_motions(sigma)
        log_factors = np.zeros(len(self._poses))
        matched = np.zeros(len(self._poses), bool)
        information = np.zeros((len(self._poses), 3, 3))
        for particle, base in enumerate(self._poses.copy()):
            start, prior = compose(base, self._rel), compose(base, self._odometry_rel)
            drawn = None if others is None else compose(base, others[particle])
            proposed = self._proposer.propose(particle, lines, start, prior, sigma, deviates[particle], drawn)
            self._poses[particle] = proposed.pose
            log_factors[particle] = proposed.log_weight
            matched[particle] = proposed.matched
            information[particle] = proposed.information
        return log_factors, matched, information

    def _other_motions(self, sigma: FloatArray) -> FloatArray | None:
        """(N, 3): each particle's own draw of the motion since the last step (algorithm 1, line 4).

        None where the motion of the best particle is as good a start: it lies within what the others can be matched
        from.
        """
        if not self._proposer.may_mislead(between(self._odometry_rel, self._rel), sigma):
            return None
        return self._odometry_rel + sigma * self._rng.standard_normal(self._poses.shape)

    def _take_over(self, parents: NDArray[np.int64]) -> None:
        """Particle i becomes a copy of `parents[i]`."""
        self._maps.adopt(parents)
        self._poses = self._poses[parents]
        self._ends = self._ends[parents]
        self._weights.adopt(parents)
        self._deviates.adopt(parents)

    def _record(self, scan: PointScan, lines: LineScan, matched: NDArray[np.bool_], information: FloatArray) -> None:
        """A new node for every particle; a scan that does not fit stays out of the map for a while."""
        self._ends = self._ancestry.extend(self._ends, self._poses)
        self._path_end = -1
        patient = self._lost_scans <= self._config.update.patience_scans
        in_map = matched | (not patient)
        if not patient:
            self._breaks[len(self._steps)] = "lost"
            self._pieces.begin()
        self._closer.add_step(self._way(), information, self._misfit / max(self._misfit_scans, 1))
        self._misfit, self._misfit_scans = 0.0, 0
        age = self._closer.course.nodes - 1
        for particle in np.flatnonzero(in_map).tolist():
            self._maps.insert(particle, lines, self._poses[particle], age)
        points, normals = lines.points_m.astype(np.float32), lines.normals.astype(np.float32)
        mapped = bool(in_map[self._best])
        kept = len(points) if mapped else 0
        self._steps.append(Keyframe(scan.stamp_s, age, np.zeros(3), points[:kept], normals[:kept], scan.origin_m))
        self._in_map.append(mapped)
        self._pieces.add_node()
        self._rel = np.zeros(3)
        self._odometry_rel = np.zeros(3)

    def _close(self, last: bool = False) -> None:
        """A bounded share of what closing loops takes; `last`: nothing is worth waiting for."""
        bent = self._closer.work(self._way(), self._ancestry, int(self._ends[self._best]), last)
        if bent is not None:
            self._move(bent)

    def _move(self, bent: Bent) -> None:
        """All particles move to the bent path and its map; those that parted late keep what they differ in."""
        steps, trunk = len(self._steps), bent.trunk
        heirs = self._of_one_stem(trunk.steps, trunk.name)
        if not heirs.any():
            self._closer.failed(bent)
            return
        self._best = self._weights.best(heirs)
        corrections = bent.of_steps(self._closer.course.node_of_steps(steps))
        self._ancestry.bend(corrections)
        self._poses = compose_all(np.tile(corrections[-1], (len(self._poses), 1)), self._poses)
        self._path_end = -1
        late = self._draw_bent(bent)
        parents = np.where(late, np.arange(len(late)), self._best)
        self._take_over(parents)
        self._revision += 1

    def _draw_bent(self, bent: Bent) -> NDArray[np.bool_]:
        """The rest of the map, the last steps for each particle that shares the ones before: (N,), which do."""
        steps, end = len(self._steps), int(self._ends[self._best])
        split = max(bent.trunk.steps, steps - self._config.closing.bend.tail_steps)
        path = self._ancestry.path(end)
        for step in range(bent.trunk.steps, split):
            if self._in_map[step]:
                self._maps.draw_spare(self._steps[step].lines(), path[step], self._steps[step].node, bent.joined)
        self._maps.adopt_spare()
        self._closer.made(bent)
        late = self._of_one_stem(split, self._ancestry.name_of_ancestor(end, split - 1))
        for particle in np.flatnonzero(late).tolist():
            path = self._ancestry.path(int(self._ends[particle]))
            for step in range(split, steps):
                if self._in_map[step]:
                    self._maps.insert(particle, self._steps[step].lines(), path[step], self._steps[step].node)
        return late

    def _of_one_stem(self, steps: int, name: int) -> NDArray[np.bool_]:
        """(N,): whose path of so many steps ends in the node with this name."""
        names = [self._ancestry.name_of_ancestor(int(end), steps - 1) for end in self._ends]
        return np.asarray(np.array(names) == name)

    def _way(self) -> Way:
        return Way(self._closer.course, self._step_poses(), self._steps, self._in_map)

    def _step_poses(self) -> FloatArray:
        """(steps, 3): the best particle's path."""
        end = int(self._ends[self._best])
        if self._path_end != end:
            self._path_end, self._path = end, self._ancestry.path(end)
        return self._path
