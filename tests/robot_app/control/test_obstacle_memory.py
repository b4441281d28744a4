import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.control.obstacle_memory import ObstacleMemory, ObstacleMemoryConfig
from robot_app.control.seen_ground import SeenGround, SeenGroundConfig
from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry

BEAMS = 682


def _scan(range_m: float) -> NDArray[np.float32]:
    return np.full(BEAMS, range_m, np.float32)


def _memory(geometry: ScanGeometry, *ranges_m: float) -> ObstacleMemory:
    memory = ObstacleMemory(ObstacleMemoryConfig())
    for k, range_m in enumerate(ranges_m):
        memory.add_scan(0.04 * k, _scan(range_m), geometry, Pose2())
    return memory


def test_what_was_hit_twice_is_remembered_where_it_is(scan_geometry: ScanGeometry) -> None:
    points = _memory(scan_geometry, 1.0, 1.0, 1.0).points_m(0.1, Pose2())
    assert len(points) > 100
    np.testing.assert_allclose(np.hypot(points[:, 0] - 0.25, points[:, 1]), 1.0, atol=0.005)


def test_a_single_hit_is_not_believed(scan_geometry: ScanGeometry) -> None:
    memory = ObstacleMemory(ObstacleMemoryConfig())
    ranges = np.full(BEAMS, np.nan, np.float32)
    ranges[340] = 1.0
    memory.add_scan(0.0, ranges, scan_geometry, Pose2())
    assert len(memory.points_m(0.0, Pose2())) == 0


def test_what_beams_pass_through_is_forgotten(scan_geometry: ScanGeometry) -> None:
    memory = _memory(scan_geometry, 1.0, 1.0, 1.0, *[3.0] * 10)
    points = memory.points_m(1.0, Pose2())
    assert len(points[np.abs(np.arctan2(points[:, 1], points[:, 0] - 0.25)) < 1.5]) == 0


def test_beams_that_measure_nothing_forget_nothing(scan_geometry: ScanGeometry) -> None:
    before = len(_memory(scan_geometry, 1.0, 1.0).points_m(0.1, Pose2()))
    assert len(_memory(scan_geometry, 1.0, 1.0, *[np.nan] * 20).points_m(1.0, Pose2())) == before


def test_what_is_old_or_far_away_is_not_given_out(scan_geometry: ScanGeometry) -> None:
    memory = _memory(scan_geometry, 1.0, 1.0)
    assert len(memory.points_m(100.0, Pose2())) == 0
    assert len(memory.points_m(0.1, Pose2(10.0, 0.0, 0.0))) == 0


def test_a_scan_is_straightened_by_how_the_robot_slides_sideways(scan_geometry: ScanGeometry) -> None:
    memory, angles = ObstacleMemory(ObstacleMemoryConfig()), scan_geometry.angles_rad(BEAMS)
    scanner, late_s = scan_geometry.robot_from_scanner, scan_geometry.beam_interval_s * np.arange(BEAMS)
    beside = np.abs(angles - 1.5) < 0.4
    ranges = np.where(beside, (1.0 - scanner.y_m - 0.5 * late_s) / np.sin(angles), np.nan).astype(np.float32)
    for k in range(3):  # it comes nearer to a wall at its left, 1 m away at first
        memory.add_scan(0.04 * k, ranges, scan_geometry, Pose2(), lateral_mps=0.5)
    points = memory.points_m(0.1, Pose2())
    assert len(points) > 10
    np.testing.assert_allclose(points[:, 1], 1.0, atol=0.002)


def test_everything_can_be_forgotten(scan_geometry: ScanGeometry) -> None:
    memory = _memory(scan_geometry, 1.0, 1.0)
    memory.forget()
    assert len(memory.points_m(0.1, Pose2())) == 0


def test_a_scan_made_on_the_move_is_straightened(scan_geometry: ScanGeometry) -> None:
    memory = ObstacleMemory(ObstacleMemoryConfig())
    ranges = np.full(BEAMS, np.nan, np.float32)
    ranges[660:664] = 1.0
    late_s = 661.5 * scan_geometry.beam_interval_s
    for _ in range(3):
        memory.add_scan(0.0, ranges, scan_geometry, Pose2(), 0.4, 0.8)
    angle = scan_geometry.first_angle_rad + 661.5 * scan_geometry.step_rad
    then = Pose2(0.4 * late_s, 0.0, 0.8 * late_s) @ scan_geometry.robot_from_scanner
    expected = then.apply(np.array([[np.cos(angle), np.sin(angle)]]))[0]
    np.testing.assert_allclose(memory.points_m(0.0, Pose2()).mean(axis=0), expected, atol=0.003)


def test_ground_behind_a_car_that_never_moved_is_unseen(scan_geometry: ScanGeometry, car: CarGeometry) -> None:
    ground = SeenGround(car, SeenGroundConfig())
    ground.add_scan(_scan(2.0), scan_geometry, Pose2())
    unseen = ground.unseen_m(Pose2())
    straight_behind = unseen[np.abs(unseen[:, 1]) < 0.08]
    assert straight_behind[:, 0].max() < -car.rear_m
    assert straight_behind[:, 0].min() == pytest.approx(-0.7, abs=0.05)


def test_ground_that_the_car_has_driven_over_is_seen(scan_geometry: ScanGeometry, car: CarGeometry) -> None:
    ground = SeenGround(car, SeenGroundConfig())
    for x in np.arange(0.0, 1.0, 0.02):
        ground.add_scan(_scan(2.0), scan_geometry, Pose2(float(x), 0.0, 0.0))
    unseen = ground.unseen_m(Pose2(0.98, 0.0, 0.0))
    assert not (np.abs(unseen[:, 1]) < 0.08).any()
