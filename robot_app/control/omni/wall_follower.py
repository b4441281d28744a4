"""Fuzzy wall follower of a robot that can move sideways: once round the room or the corridor.

It looks round on the spot first. Then it keeps beside the way along the wall by sliding, and turns to face where the
way leads, so that scanner and camera look ahead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from robot_app.control.fuzzy import RuleTable, Variable
from robot_app.control.omni.lap import Lap, LapConfig
from robot_app.control.wall_follower import WallState
from robot_app.control.wall_trace import WallTraceConfig, WallTracer
from shared.geometry.omni3 import Twist
from shared.geometry.se2 import Pose2, wrap_angle


def _trace_of_disc() -> WallTraceConfig:
    return WallTraceConfig(distance_m=0.50, pass_radius_m=0.24, tightest_m=0.20, middle_m=0.0)


@dataclass(frozen=True, slots=True)
class OmniWallConfig:
    side: int = -1  # where the wall is kept: -1 right, +1 left
    trace: WallTraceConfig = field(default_factory=_trace_of_disc)
    sure_radius_m: float = 0.30  # into gaps between twice trace.pass_radius_m and twice this it goes on as it began
    lap: LapConfig = field(default_factory=LapConfig)
    look_ahead_m: float = 0.45  # to the point of the way that it faces and heads for
    faces_rad: float = 1.2  # one that faces the way by this knows the wall's side by its heading, else by the way
    slow_mps: float = 0.09  # paper 1, section 4: slow is below 0.1, medium 0.2, fast above 0.4
    medium_mps: float = 0.20
    fast_mps: float = 0.42
    slide_mps: float = 0.15  # to the side, at most
    turn_radps: float = 1.2
    look_round_radps: float = 0.8
    crossed_m: float = 0.5  # an island is left when something else is so near ahead
    leave_limit_m: float = 4.0


@dataclass(frozen=True, slots=True)
class OmniWallStep:
    """`offset_m`: of the robot from the way, positive left of it; `angle_rad`: of the way ahead, from its heading."""

    twist: Twist
    state: WallState
    offset_m: float = 0.0
    angle_rad: float = 0.0


ANGLE = Variable.partition(
    "angle of the way ahead", behind_right=-1.6, right=-0.7, bit_right=-0.2, ahead=0.0, bit_left=0.2, left=0.7,
    behind_left=1.6,
)  # fmt: skip
OFFSET = Variable.partition("offset from the way", right=-0.20, bit_right=-0.05, on_it=0.0, bit_left=0.05, left=0.20)
CLEARANCE = Variable.partition("clearance ahead", none=0.08, little=0.25, some=0.55, much=0.85)
TURN = Variable.partition("turn", RR=-1.0, R=-0.6, r=-0.25, o=0.0, l=0.25, L=0.6, LL=1.0)
TURN_RULES = RuleTable(
    ANGLE,
    CLEARANCE,
    TURN,
    # clearance:   none little some much
    """
    behind_right   RR   RR     RR   RR
    right          RR   RR     R    R
    bit_right      R    r      r    r
    ahead          o    o      o    o
    bit_left       L    l      l    l
    left           LL   LL     L    L
    behind_left    LL   LL     LL   LL
    """,
)
SLIDE = Variable.partition("slide", RR=-1.0, R=-0.5, o=0.0, L=0.5, LL=1.0)
SLIDE_RULES = RuleTable(
    ANGLE,
    OFFSET,
    SLIDE,
    # offset:      right bit_right on_it bit_left left
    """
    behind_right   o     o         o     o        o
    right          L     o         o     o        R
    bit_right      LL    L         o     R        RR
    ahead          LL    L         o     R        RR
    bit_left       LL    L         o     R        RR
    left           L     o         o     o        R
    behind_left    o     o         o     o        o
    """,
)
BEND = Variable.partition("angle of the way ahead, either side", straight=0.15, bend=0.5, sharp=1.0, behind=1.7)
SPEED = Variable.partition("speed", stop=0.0, slow=1.0, medium=2.0, fast=3.0)
SPEED_RULES = RuleTable(
    CLEARANCE,
    BEND,
    SPEED,
    # angle: straight bend   sharp behind
    """
    none     slow     slow   slow  stop
    little   medium   slow   slow  stop
    some     medium   medium slow  stop
    much     fast     medium slow  stop
    """,
)


class OmniWallFollower:
    """Turns the obstacles near the robot into a wish."""

    def __init__(self, config: OmniWallConfig) -> None:
        self._config = config
        radii_m = (config.trace.pass_radius_m, config.sure_radius_m)
        self._tracers = [WallTracer(replace(config.trace, pass_radius_m=r), config.side) for r in radii_m]
        self.reset()

    def reset(self) -> None:
        """Begin a new lap wherever the robot is."""
        self._state = WallState.SEARCH
        self._lap = Lap(self._config.lap, self._config.side)
        self._has_looked_round = False
        self._carrot_m: NDArray[np.float64] | None = None  # odom frame, of the last step
        self._course_rad: float | None = None  # odom frame, where the way leads that it does not face yet
        self._leave_heading_rad = 0.0
        self._left_at_m = 0.0

    def step(self, points_m: NDArray[np.float64], odom_from_robot: Pose2, clearance_ahead_m: float) -> OmniWallStep:
        """`points_m`: (N, 2) obstacles, odom frame; `clearance_ahead_m`: how far the robot can go as it goes now."""
        config, lap = self._config, self._lap
        lap.travel(odom_from_robot)
        if not self._has_looked_round:
            self._has_looked_round = abs(lap.heading_turned_rad) >= math.tau
            return OmniWallStep(Twist(0.0, 0.0, -config.side * config.look_round_radps), self._state)
        if self._state is WallState.LEAVE and not self._has_crossed(odom_from_robot, clearance_ahead_m):
            return self._cross(odom_from_robot, clearance_ahead_m)
        way_m = self._way(points_m, odom_from_robot)
        if way_m is None:
            self._enter(WallState.SEARCH)
            speed = min(self._speed_mps(clearance_ahead_m, 0.0), config.medium_mps)
            return OmniWallStep(Twist(speed, 0.0, 0.0), self._state)
        self._enter(WallState.FOLLOW)
        step = self._follow(way_m, clearance_ahead_m)
        faces = abs(step.angle_rad) < config.faces_rad
        self._course_rad = None if faces else odom_from_robot.theta_rad + course_rad(way_m)
        self._judge_lap(odom_from_robot)
        return step

    def _way(self, points_m: NDArray[np.float64], pose: Pose2) -> NDArray[np.float64] | None:
        """(N, 2), robot frame. A gap as wide as the disc is a way in one scan and none in the next: of both ways it
        takes the one that leads on to where it was heading. While it turns round to face the way, what is beside its
        heading is now this wall and now that one."""
        along = pose if self._course_rad is None else Pose2(pose.x_m, pose.y_m, self._course_rad)
        traces = [tracer.trace(points_m, along) for tracer in self._tracers]
        ways = [pose.inverse().apply(trace.way_m) for trace in traces if trace is not None]
        if not ways:
            self._carrot_m = self._course_rad = None
            return None
        carrots_m = pose.apply(np.array([way_ahead(way, self._config.look_ahead_m)[0] for way in ways]))
        kept = 0 if self._carrot_m is None else int(np.argmin(np.hypot(*(carrots_m - self._carrot_m).T)))
        self._carrot_m = carrots_m[kept]
        return ways[kept]

    def _enter(self, state: WallState) -> None:
        """Who is round once stays so, and goes on along the wall."""
        if self._state is not WallState.DONE:
            self._state = state

    def _follow(self, way_m: NDArray[np.float64], clearance_ahead_m: float) -> OmniWallStep:
        """`way_m`: (N, 2), robot frame."""
        ahead, offset = way_ahead(way_m, self._config.look_ahead_m)
        angle = math.atan2(ahead[1], ahead[0])
        speed = self._speed_mps(clearance_ahead_m, abs(angle))
        slide = SLIDE_RULES(angle, offset) * self._config.slide_mps
        c, s = math.cos(angle), math.sin(angle)
        turn = TURN_RULES(angle, clearance_ahead_m) * self._config.turn_radps
        return OmniWallStep(Twist(speed * c - slide * s, speed * s + slide * c, turn), self._state, offset, angle)

    def _speed_mps(self, clearance_ahead_m: float, angle_rad: float) -> float:
        config = self._config
        level = SPEED_RULES(clearance_ahead_m, angle_rad)
        return float(np.interp(level, (0, 1, 2, 3), (0.0, config.slow_mps, config.medium_mps, config.fast_mps)))

    def _judge_lap(self, pose: Pose2) -> None:
        """A lap of the room turns its way once towards the open side; a lap of an island the other way.

        It leaves an island as it came there, or across, where it has not come from afar.
        """
        turns = 0.0 if self._state is WallState.DONE else self._lap.turns_round()
        if turns > 0:
            self._state = WallState.DONE
        elif turns < 0:
            self._state = WallState.LEAVE
            came_rad = self._lap.leave_out()
            across_rad = pose.theta_rad - self._config.side * math.pi / 2
            self._leave_heading_rad = across_rad if came_rad is None else came_rad
            self._left_at_m = self._lap.distance_m

    def _has_crossed(self, pose: Pose2, clearance_ahead_m: float) -> bool:
        """Facing what stands at the other side; in any case after some way, however it went."""
        faces = abs(wrap_angle(self._leave_heading_rad - pose.theta_rad)) < 0.5
        reached = faces and 0.0 < clearance_ahead_m < self._config.crossed_m
        return reached or self._lap.distance_m - self._left_at_m > self._config.leave_limit_m

    def _cross(self, pose: Pose2, clearance_ahead_m: float) -> OmniWallStep:
        off = wrap_angle(self._leave_heading_rad - pose.theta_rad)
        speed = self._speed_mps(clearance_ahead_m, abs(off))
        turn = TURN_RULES(off, clearance_ahead_m) * self._config.turn_radps
        return OmniWallStep(Twist(speed * math.cos(off), speed * math.sin(off), turn), self._state, 0.0, off)


def way_ahead(way_m: NDArray[np.float64], look_ahead_m: float) -> tuple[NDArray[np.float64], float]:
    """The point of a way, (N, 2), robot frame, to head for, and how far left of the way the robot is."""
    gaps, nearest = _nearest(way_m)
    beyond = np.flatnonzero(gaps[nearest:] >= look_ahead_m)
    ahead = way_m[nearest + int(beyond[0])] if len(beyond) else way_m[-1]
    course = course_rad(way_m)
    return ahead, float(math.sin(course) * way_m[nearest][0] - math.cos(course) * way_m[nearest][1])


def course_rad(way_m: NDArray[np.float64]) -> float:
    """Where a way, (N, 2), robot frame, leads beside the robot."""
    nearest = _nearest(way_m)[1]
    dx, dy = way_m[min(nearest + 1, len(way_m) - 1)] - way_m[max(nearest - 1, 0)]
    return math.atan2(dy, dx)


def _nearest(way_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
    gaps = np.hypot(*way_m.T)
    return gaps, int(np.argmin(gaps[: max(2, len(way_m) // 2)]))
