"""Fuzzy path follower: along a planned path with stretches forward and in reverse (paper 1, section 2.2).

The steering is the path's own curvature plus a fuzzy correction of the car's offset and heading; the speed is
fuzzy in the correction and in the way that is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from robot_app.control.fuzzy import paper_speeds
from robot_app.control.motion import Motion
from robot_app.control.path_rules import PathRulesConfig
from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2, wrap_angle


class PathState(IntEnum):
    FOLLOWING = 0
    CUSP = 1  # stands to change between forward and reverse
    DONE = 2  # stands at the last point
    LOST = 3  # too far from the path; stands


@dataclass(frozen=True, slots=True)
class PathFollowerConfig:
    rules: PathRulesConfig = field(default_factory=PathRulesConfig)
    slow_mps: float = 0.07  # paper 1, section 4: slow is below 0.1, medium 0.2, fast above 0.4
    medium_mps: float = 0.20
    fast_mps: float = 0.30  # below the paper's "fast": the room is small
    reverse_mps: float = 0.18  # nothing is seen behind the car
    preview_s: float = 0.16  # the servo's and the loop's delay, at the present speed
    lost_m: float = 0.40
    stop_short_m: float = 0.006  # the way the car rolls on after the motor is off
    deceleration_mps2: float = 0.25  # towards a cusp or the goal
    cusp_s: float = 0.25  # to turn the wheels while standing
    standing_mps: float = 0.015
    window_m: float = 0.40  # how far along the path the car may be from where it was a step ago
    settle_timeout_s: float = 1.0  # after this the car counts as standing

    def __post_init__(self) -> None:
        paper_speeds(self.slow_mps, self.medium_mps, self.fast_mps)


@dataclass(frozen=True, slots=True)
class PathStep:
    """`cross_track_m`: positive left of the path; `left_m`: way to the goal."""

    motion: Motion
    state: PathState
    cross_track_m: float
    heading_error_rad: float
    left_m: float


class _Stretch:
    """A part of a path that is driven in one direction. `poses`: (N, 3), N >= 2, odom frame."""

    def __init__(self, poses: NDArray[np.float64], forward: bool) -> None:
        self.poses = poses
        self.forward = forward
        steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        self.along_m = np.concatenate(([0.0], np.cumsum(steps)))
        headings = np.unwrap(poses[:, 2])
        signed = steps if forward else -steps
        self.headings_rad = headings
        self.curvatures_per_m = np.diff(headings) / np.where(steps > 1e-6, signed, np.inf)

    @property
    def length_m(self) -> float:
        return float(self.along_m[-1])

    def project(self, pose: Pose2, from_m: float, to_m: float) -> float:
        """How far along the stretch the pose is, looked for between `from_m` and `to_m`."""
        first = max(int(np.searchsorted(self.along_m, from_m)) - 1, 0)
        last = min(int(np.searchsorted(self.along_m, to_m)) + 1, len(self.poses) - 1)
        a, b = self.poses[first:last, :2], self.poses[first + 1 : last + 1, :2]
        d = b - a
        lengths = np.maximum((d**2).sum(axis=1), 1e-12)
        t = np.clip(((np.array([pose.x_m, pose.y_m]) - a) * d).sum(axis=1) / lengths, 0.0, 1.0)
        gaps = np.hypot(*(a + t[:, None] * d - (pose.x_m, pose.y_m)).T)
        best = int(np.argmin(gaps))
        return float(self.along_m[first + best] + t[best] * math.sqrt(lengths[best]))

    def at(self, along_m: float) -> Pose2:
        x = np.interp(along_m, self.along_m, self.poses[:, 0])
        y = np.interp(along_m, self.along_m, self.poses[:, 1])
        return Pose2(float(x), float(y), wrap_angle(float(np.interp(along_m, self.along_m, self.headings_rad))))

    def curvature_per_m(self, along_m: float) -> float:
        index = int(np.searchsorted(self.along_m, along_m, side="right")) - 1
        return float(self.curvatures_per_m[min(max(index, 0), len(self.curvatures_per_m) - 1)])

    def overshoot_m(self, pose: Pose2) -> float:
        """How far the pose is beyond the end, in the direction of driving; negative before it."""
        end = Pose2.from_array(self.poses[-1]).inverse() @ pose
        return end.x_m if self.forward else -end.x_m


def split_stretches(path: NDArray[np.floating]) -> list[_Stretch]:
    """`path`: (N, 3) x, y, theta. Where the heading points against the way to the next point, it is in reverse."""
    poses = np.asarray(path, dtype=np.float64)
    if len(poses) < 2:
        return []
    moved = np.concatenate(([True], np.hypot(*np.diff(poses[:, :2], axis=0).T) > 1e-4))
    poses = poses[moved]
    if len(poses) < 2:
        return []
    steps = np.diff(poses[:, :2], axis=0)
    middle = poses[:-1, 2] + 0.5 * np.array([wrap_angle(t) for t in np.diff(poses[:, 2])])
    forward = steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle) >= 0
    cusps = [0, *(np.flatnonzero(np.diff(forward)) + 1).tolist(), len(steps)]
    return [_Stretch(poses[a : b + 1], bool(forward[a])) for a, b in pairwise(cusps)]


class PathFollower:
    """Follows one path. Step it at 25 Hz or more."""

    def __init__(self, car: CarGeometry, config: PathFollowerConfig, path: NDArray[np.floating]) -> None:
        """`path`: (N, 3) as in `GoTo`, odom frame. A path of less than two points is done at once."""
        self._car = car
        self._config = config
        self._steering, self._speed = config.rules.steering, config.rules.speed
        self._stretches = split_stretches(path)
        self._index = 0
        self._along_m = 0.0
        self._state = PathState.FOLLOWING if self._stretches else PathState.DONE
        self._since_s: float | None = None
        self._rest_m = sum(s.length_m for s in self._stretches)

    def step(self, now_s: float, odom_from_robot: Pose2, speed_mps: float) -> PathStep:
        """`speed_mps` as measured. After DONE or LOST the car is to stand."""
        if self._state in {PathState.DONE, PathState.LOST}:
            return PathStep(Motion(0.0, 0.0), self._state, 0.0, 0.0, 0.0)
        if self._state is PathState.CUSP:
            return self._wait_at_cusp(now_s, speed_mps)
        stretch = self._stretches[self._index]
        window = (self._along_m - 0.05, self._along_m + self._config.window_m)
        self._along_m = stretch.project(odom_from_robot, *window)
        off = stretch.at(self._along_m).inverse() @ odom_from_robot
        if math.hypot(off.x_m, off.y_m) > self._config.lost_m and abs(off.y_m) > self._config.lost_m / 2:
            self._state = PathState.LOST
            return PathStep(Motion(0.0, 0.0), self._state, off.y_m, off.theta_rad, self._left_m())
        if stretch.overshoot_m(odom_from_robot) >= -self._config.stop_short_m and self._near_end(stretch):
            return self._end_stretch(now_s, speed_mps, off)
        return self._track(stretch, off, speed_mps)

    def _near_end(self, stretch: _Stretch) -> bool:
        return self._along_m > stretch.length_m - 0.15

    def _left_m(self) -> float:
        done = sum(s.length_m for s in self._stretches[: self._index])
        return max(0.0, self._rest_m - done - self._along_m)

    def _track(self, stretch: _Stretch, off: Pose2, speed_mps: float) -> PathStep:
        config = self._config
        preview_m = self._along_m + abs(speed_mps) * config.preview_s
        bend = self._car.steering_rad(stretch.curvature_per_m(min(preview_m, stretch.length_m)))
        heading = off.theta_rad if stretch.forward else -off.theta_rad  # in reverse it leads to the other side
        correction = self._steering(heading, off.y_m)
        limit = self._car.max_steering_rad
        steering = max(-limit, min(limit, bend + correction * limit))
        speed = self._speed_mps(stretch, abs(correction), abs(bend) / limit)
        motion = Motion(speed if stretch.forward else -speed, steering)
        return PathStep(motion, self._state, off.y_m, off.theta_rad, self._left_m())

    def _speed_mps(self, stretch: _Stretch, correction: float, bend: float) -> float:
        config = self._config
        level = self._speed(correction, bend)
        speed = float(np.interp(level, (1, 2, 3), (config.slow_mps, config.medium_mps, config.fast_mps)))
        if not stretch.forward:
            speed = min(speed, config.reverse_mps)
        rest_m = max(0.0, stretch.length_m - self._along_m)
        return min(speed, 0.03 + math.sqrt(2 * config.deceleration_mps2 * rest_m))

    def _end_stretch(self, now_s: float, speed_mps: float, off: Pose2) -> PathStep:
        """Stand first; then it is a cusp or the goal."""
        self._since_s = now_s if self._since_s is None else self._since_s
        stands = abs(speed_mps) < self._config.standing_mps or now_s - self._since_s > self._config.settle_timeout_s
        if stands:
            self._since_s = None
            last = self._index == len(self._stretches) - 1
            self._state = PathState.DONE if last else PathState.CUSP
        return PathStep(Motion(0.0, 0.0), self._state, off.y_m, off.theta_rad, self._left_m())

    def _wait_at_cusp(self, now_s: float, speed_mps: float) -> PathStep:
        if self._since_s is None:
            self._since_s = now_s
            self._index += 1
            self._along_m = 0.0
        steering = self._car.steering_rad(self._stretches[self._index].curvature_per_m(0.0))
        if now_s - self._since_s >= self._config.cusp_s:
            self._since_s = None
            self._state = PathState.FOLLOWING
        return PathStep(Motion(0.0, steering), self._state, 0.0, 0.0, self._left_m())
