"""Wall follower and obstacle avoidance together, in a simulated room."""

import math

import numpy as np
import pytest

from robot_app.control.motion import Motion
from robot_app.control.obstacle_avoidance import AvoidanceConfig, AvoidanceState, ObstacleAvoidance, Wish
from robot_app.control.obstacle_memory import ObstacleMemory, ObstacleMemoryConfig
from robot_app.control.seen_ground import SeenGround, SeenGroundConfig
from robot_app.control.wall_follower import WallFollower, WallFollowerConfig, WallState
from shared.geometry.se2 import Pose2

STARTS = [Pose2(1.0, 0.5, 0.0), Pose2(2.9, 2.6, 1.57), Pose2(3.2, 2.9, -1.0)]


class _Robot:
    """The controllers around the simulated car, as the robot app composes them."""

    def __init__(self, simulated, car, geometry, side: int = -1) -> None:  # type: ignore[no-untyped-def]
        self.simulated = simulated
        self._geometry = geometry
        self._memory = ObstacleMemory(ObstacleMemoryConfig())
        self._ground = SeenGround(car, SeenGroundConfig())
        self.wall = WallFollower(car, WallFollowerConfig(side=side))
        self._avoidance = ObstacleAvoidance(car, AvoidanceConfig())
        self._steering_rad = 0.0
        self._ahead_m = 0.3
        self.blocked = False

    def step(self, wish: Wish | None = None) -> WallState:
        s = self.simulated
        scan = s.scan()
        self._memory.add_scan(s.now_s, scan, self._geometry, s.odom)
        self._ground.add_scan(scan, self._geometry, s.odom)
        points = self._memory.points_m(s.now_s, s.odom)
        step = self.wall.step(points, s.odom, self._ahead_m)
        wish = wish or Wish(step.motion, 0.6, step.carrot_m, may_reverse=True)
        unseen = self._ground.unseen_m(s.odom)
        avoided = self._avoidance.step(s.now_s, wish, points, s.odom, s.speed_mps, self._steering_rad, unseen)
        self._steering_rad, self._ahead_m = avoided.motion.steering_rad, avoided.clearance_ahead_m
        self.blocked = avoided.state is AvoidanceState.BLOCKED
        s.drive(avoided.motion, 0.04)
        return step.state

    def lap(self, limit_s: float) -> WallState:
        state = WallState.SEARCH
        while self.simulated.now_s < limit_s and state is not WallState.DONE:
            state = self.step()
        return state


@pytest.fixture(name="robot")
def _robot(simulated_car, car, scan_geometry):  # type: ignore[no-untyped-def]
    def make(segments_m, pose, seed=0, side=-1):  # type: ignore[no-untyped-def]
        return _Robot(simulated_car(segments_m, pose, np.random.default_rng(seed)), car, scan_geometry, side)

    return make


@pytest.mark.parametrize(("seed", "start"), [(0, STARTS[0]), (1, STARTS[1]), (2, STARTS[2]), (1, STARTS[0])])
def test_the_robot_goes_once_round_a_cluttered_room_without_touching_anything(seed, start, robot, lab) -> None:  # type: ignore[no-untyped-def]
    r = robot(lab(seed), start, seed)
    assert r.lap(90.0) is WallState.DONE
    assert r.simulated.clearance_m > 0.02
    assert r.simulated.distance_m > 6.0


def test_the_wall_can_be_kept_at_the_left(robot, lab) -> None:  # type: ignore[no-untyped-def]
    r = robot(lab(1), Pose2(2.0, 0.8, math.pi), 1, side=1)
    assert r.lap(100.0) is WallState.DONE
    assert r.simulated.clearance_m > 0.02


def test_a_robot_that_went_round_an_island_crosses_over_and_goes_round_the_room(robot, rectangle) -> None:  # type: ignore[no-untyped-def]
    room = np.vstack((rectangle(0, 0, 4.4, 4.4), rectangle(0, 0, 1.0, 1.0)))
    r = robot(room, Pose2(-1.0, -0.3, math.pi / 2))
    assert r.lap(150.0) is WallState.DONE
    assert r.simulated.distance_m > 12.0
    assert r.simulated.clearance_m > 0.02


def test_a_robot_in_an_open_place_goes_straight_on_until_it_finds_a_wall(robot, rectangle) -> None:  # type: ignore[no-untyped-def]
    r = robot(rectangle(0, 0, 8.0, 8.0), Pose2(-1.0, 0.2, 0.0))
    assert r.step() is WallState.SEARCH
    while r.simulated.now_s < 40.0 and r.wall.state is WallState.SEARCH:
        r.step()
    assert r.simulated.pose.x_m > 1.0
    assert abs(r.simulated.pose.y_m - 0.2) < 0.1


def test_a_robot_that_faces_a_wall_at_10_cm_gets_away(robot, rectangle) -> None:  # type: ignore[no-untyped-def]
    r = robot(rectangle(0, 0, 3.0, 3.0), Pose2(1.5 - 0.305 - 0.10, 0.0, 0.0))
    r.lap(15.0)
    assert r.simulated.pose.distance_m(Pose2(1.095, 0.0)) > 0.5
    assert r.simulated.clearance_m > 0.02


def test_a_robot_in_a_dead_end_comes_out_again(robot, rectangle) -> None:  # type: ignore[no-untyped-def]
    dead_end = np.array([[0.0, -0.4, 1.6, -0.4], [1.6, -0.4, 1.6, 0.4], [1.6, 0.4, 0.0, 0.4]])
    r = robot(np.vstack((dead_end, rectangle(0, 0, 6.0, 6.0))), Pose2(0.2, 0.0, 0.0))
    while r.simulated.now_s < 90.0 and r.simulated.pose.x_m > -0.2:
        r.step()
    assert r.simulated.pose.x_m <= -0.2
    assert r.simulated.clearance_m > 0.02


def test_a_gap_that_is_too_narrow_is_passed_by(robot, rectangle) -> None:  # type: ignore[no-untyped-def]
    wall = np.array([[-2.0, -0.5, 0.0, -0.5], [0.3, -0.5, 3.0, -0.5]])
    r = robot(np.vstack((wall, rectangle(0, 0, 8.0, 6.0))), Pose2(-1.5, 0.0, 0.0))
    while r.simulated.now_s < 30.0 and r.simulated.pose.x_m < 1.5:
        r.step()
    assert r.simulated.pose.x_m >= 1.5
    assert abs(r.simulated.pose.y_m) < 0.25


def test_the_operator_cannot_drive_into_a_wall(robot, rectangle) -> None:  # type: ignore[no-untyped-def]
    r = robot(rectangle(0, 0, 3.0, 3.0), Pose2(0.0, 0.0, 0.3))
    for _ in range(300):
        r.step(Wish(Motion(0.4, 0.0)))
    assert r.blocked
    assert r.simulated.speed_mps == 0.0
    assert 0.01 < r.simulated.clearance_m < 0.15


def test_the_same_seed_gives_the_same_lap_to_the_last_bit(robot, lab) -> None:  # type: ignore[no-untyped-def]
    first, second = robot(lab(0), STARTS[0], 5), robot(lab(0), STARTS[0], 5)
    first.lap(8.0)
    second.lap(8.0)
    assert first.simulated.pose == second.simulated.pose
