from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan, to_points
from station_gui.mapping.slam2d.base import MappingError, Slam
from station_gui.mapping.slam2d.config import GraphSlamConfig, LoopConfig
from station_gui.mapping.slam2d.graph_slam import GraphSlam
from station_gui.mapping.slam2d.se2_arrays import between
from tools.evaluate.slam import read_relations, relation_errors
from tools.logs.carmen import CarmenReader

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]
LapMaker = Callable[[int], list[Pose2]]
_SLAM_DATA = Path(__file__).resolve().parents[4] / ".." / "shared" / "data" / "slam"


def _drive(walls: FloatArray, way: list[Pose2], make: ScanMaker, seed: int = 0) -> list[PointScan]:
    """Scans along the way with the odometry of a robot whose wheels slip by 5 % and whose gyro drifts."""
    rng = np.random.default_rng(seed)
    odom = way[0]
    scans = [make(walls, way[0], rng, odom)]
    for k in range(1, len(way)):
        step = way[k - 1].inverse() @ way[k]
        slip = 1.05 + rng.normal(0, 0.02)
        odom = odom @ Pose2(slip * step.x_m, slip * step.y_m, step.theta_rad + math.radians(0.05))
        scans.append(make(walls, way[k], rng, odom, 0.1 * k))
    return scans


def _run(scans: list[PointScan], config: GraphSlamConfig | None = None) -> GraphSlam:
    slam = GraphSlam(config or GraphSlamConfig())
    for scan in scans:
        slam.add(scan)
    slam.finish()
    return slam


def test_three_laps_of_the_lab_are_tracked_within_a_centimetre(
    lab: FloatArray, scan_from: ScanMaker, lap: LapMaker
) -> None:
    way = lap(120) * 3
    slam = _run(_drive(lab, way, scan_from))

    truth = np.array([pose.as_array() for pose in way])
    error = np.hypot(*(slam.scan_poses() - truth)[:, :2].T)

    assert float(np.sqrt(np.mean(error**2))) < 0.01
    assert float(error.max()) < 0.03


def test_the_same_scans_give_the_same_map_bit_for_bit(lab: FloatArray, scan_from: ScanMaker, lap: LapMaker) -> None:
    scans = _drive(lab, lap(80) * 2, scan_from)
    one, two = _run(scans), _run(scans)
    assert one.trajectory().tobytes() == two.trajectory().tobytes()
    assert one.grid().probability.tobytes() == two.grid().probability.tobytes()
    assert one.revision == two.revision


def test_reading_the_map_between_scans_changes_nothing(lab: FloatArray, scan_from: ScanMaker, lap: LapMaker) -> None:
    scans = _drive(lab, lap(60), scan_from)
    watched = GraphSlam(GraphSlamConfig())
    for scan in scans:
        watched.add(scan)
        watched.grid()
        watched.trajectory()
    watched.finish()
    assert watched.trajectory().tobytes() == _run(scans).trajectory().tobytes()


def test_a_long_loop_is_closed_and_counted_as_a_revision(scan_from: ScanMaker) -> None:
    """A ring of corridors, seen by a scanner that does not see across; the odometry turns too far."""
    walls, way = _ring()
    rng = np.random.default_rng(4)
    odom, scans = way[0], []
    for k, pose in enumerate(way):
        if k:
            step = way[k - 1].inverse() @ pose
            odom = odom @ Pose2(step.x_m, step.y_m, step.theta_rad * 1.01)
        scans.append(scan_from(walls, pose, rng, odom, 0.1 * k, noise_m=0.02))
    slam = _run(scans, GraphSlamConfig(loops=LoopConfig(min_graph_distance_m=8.0)))

    last = slam.pose_of_scan(len(way) - 1)
    assert len(slam.closures()) > 0
    assert last.distance_m(way[-1]) < 0.05
    assert slam.closures().max() < len(slam.trajectory())


def _ring() -> tuple[FloatArray, list[Pose2]]:
    """Outer square 14 m, inner 10 m, with niches so that places differ; one lap and a quarter."""
    corners = {14.0: 0.0, 10.0: 2.0}
    walls = []
    for side, low in corners.items():
        high = low + side
        walls += [(low, low, high, low), (high, low, high, high), (high, high, low, high), (low, high, low, low)]
    rng = np.random.default_rng(2)
    for along in (1.0, 2.2, 3.9, 5.1, 7.3, 8.6, 10.4, 12.1):
        depth = float(rng.uniform(0.2, 0.5))
        walls += [(along, 0.0, along, depth), (14.0, along, 14.0 - depth, along)]
        walls += [(along + 0.4, 14.0, along + 0.4, 14.0 - depth), (0.0, along + 0.7, depth, along + 0.7)]
    straight = np.arange(1.0, 13.0, 0.12)
    legs = [(straight, 1.0, 0.0), (13.0, straight, 0.5), (14 - straight, 13.0, 1.0), (1.0, 14 - straight, -0.5)]
    way = []
    for number in range(5):
        x, y, quarter = legs[number % 4]
        for a, b in zip(*np.broadcast_arrays(x, y), strict=True):
            way.append(Pose2(float(a), float(b), quarter * math.pi))
        turn = np.linspace(0, math.pi / 2, 12)[1:-1]
        end = way[-1]
        way += [Pose2(end.x_m, end.y_m, math.remainder(end.theta_rad + float(t), math.tau)) for t in turn]
    return np.array(walls), way


def test_a_scan_that_fits_nowhere_leaves_the_map_alone(lab: FloatArray, scan_from: ScanMaker, lap: LapMaker) -> None:
    scans = _drive(lab, lap(120), scan_from)
    rng = np.random.default_rng(9)
    confused = [*scans]
    for k in (40, 41, 42):  # somebody stands right before the scanner
        confused[k] = PointScan(
            scans[k].stamp_s, scans[k].odom_from_robot, scans[k].origin_m, rng.uniform(-0.3, 0.3, (200, 2))
        )
    slam = _run(confused)
    truth = np.array([pose.as_array() for pose in lap(120)])
    error = np.hypot(*(slam.scan_poses() - truth)[:, :2].T)
    assert float(np.delete(error, [40, 41, 42]).max()) < 0.03


@pytest.mark.parametrize(
    "points", [np.zeros((0, 2)), np.ones((1, 2)), np.ones((300, 2)), np.full((50, 2), 1e12)], ids=str
)
def test_scans_of_nothing_or_of_one_place_do_no_harm(
    lab: FloatArray, scan_from: ScanMaker, lap: LapMaker, points: FloatArray
) -> None:
    scans = _drive(lab, lap(60), scan_from)
    bad = PointScan(0.0, scans[0].odom_from_robot, np.zeros(2), points)
    slam = GraphSlam(GraphSlamConfig())
    for scan in [bad, *scans[:20], bad, *scans[20:]]:
        assert np.isfinite(slam.add(scan).as_array()).all()
    slam.finish()
    assert slam.grid().probability.size < 16_000_000


@pytest.mark.parametrize("points", [0, 8])
def test_the_map_begins_with_the_first_scan_of_enough_points(
    lab: FloatArray, scan_from: ScanMaker, lap: LapMaker, points: int
) -> None:
    way = lap(80)
    scans = _drive(lab, way, scan_from)
    for k in range(6):
        scans[k] = replace(scans[k], points_m=scans[k].points_m[:points])
    slam = _run(scans)

    assert slam.trajectory()[0, 0] == scans[6].stamp_s
    assert slam.lost_scans == 0
    steps = np.array([between(a, b) for a, b in itertools.pairwise(slam.scan_poses()[6:])])
    true_steps = np.array([between(a.as_array(), b.as_array()) for a, b in itertools.pairwise(way[6:])])
    assert float(np.abs(steps - true_steps).max()) < 0.06
    assert slam.pose_of_scan(3) == scans[3].odom_from_robot


def test_numbers_that_are_not_finite_are_refused() -> None:
    slam = GraphSlam(GraphSlamConfig())
    with pytest.raises(MappingError, match="not finite"):
        slam.add(PointScan(1.0, Pose2(), np.zeros(2), np.array([[np.nan, 0.0]])))
    with pytest.raises(MappingError, match="not finite"):
        slam.add(PointScan(1.0, Pose2(math.inf, 0.0, 0.0), np.zeros(2), np.zeros((3, 2))))


def test_an_empty_map_is_a_map() -> None:
    slam: Slam = GraphSlam(GraphSlamConfig())
    slam.finish()
    assert slam.trajectory().shape == (0, 4)
    assert slam.closures().shape == (0, 2)
    assert (slam.grid().probability == 0.5).all()


@pytest.mark.skipif(not _SLAM_DATA.is_dir(), reason="the folder shared/data is not there")
def test_the_first_part_of_the_intel_log_agrees_with_the_relations_made_by_hand() -> None:
    observations = list(islice(CarmenReader(_SLAM_DATA / "intel.clf.bz2"), 600))
    slam = _run([to_points(observation) for observation in observations])
    stamps = np.array([observation.stamp_s for observation in observations])
    translation_m, rotation_rad = relation_errors(
        stamps, slam.scan_poses(), read_relations(_SLAM_DATA / "intel.relations.gz")
    )
    assert len(translation_m) > 40
    assert translation_m.mean() < 0.02
    assert np.degrees(rotation_rad).mean() < 0.35


def test_a_robot_that_was_carried_off_begins_a_new_piece_of_map(
    lab: FloatArray, scan_from: ScanMaker, lap: LapMaker
) -> None:
    """Its wheels did not turn meanwhile; the other room shares no shape with the lab."""
    angle = np.linspace(0, math.tau, 40)
    ring = np.column_stack((1.95 + 3 * np.cos(angle), 2.1 + 3.2 * np.sin(angle)))
    other_room = np.vstack((np.hstack((ring[:-1], ring[1:])), [[3.4, 0.5, 4.0, 1.4], [0.2, 2.0, -0.4, 3.0]]))
    first = _drive(lab, lap(60), scan_from)
    second = _drive(other_room, lap(120) * 2, scan_from, seed=3)
    slam = _run([*first, *second])

    poses = slam.scan_poses()
    truth = [pose.as_array() for pose in lap(120) * 2]
    settled = len(first) + 60
    for k in (80, 120, 200, 239):  # seen from a scan after the new piece began
        moved = between(poses[settled], poses[len(first) + k])
        np.testing.assert_allclose(moved, between(truth[60], truth[k]), atol=0.03)
    before = np.array([pose.as_array() for pose in lap(60)])
    assert float(np.hypot(*(poses[: len(first)] - before)[:, :2].T).max()) < 0.03


def test_the_way_where_scans_fit_badly_is_held_loosely(lab: FloatArray, scan_from: ScanMaker, lap: LapMaker) -> None:
    scans = _drive(lab, lap(80), scan_from)
    rng = np.random.default_rng(1)

    def with_a_crowd(scan: PointScan) -> PointScan:
        points = scan.points_m.copy()
        points[: len(points) // 4] *= rng.uniform(0.3, 0.7, (len(points) // 4, 1))
        return PointScan(scan.stamp_s, scan.odom_from_robot, scan.origin_m, points)

    empty, crowded = _run(scans), _run([scans[0], *(with_a_crowd(scan) for scan in scans[1:])])

    def held(slam: GraphSlam) -> FloatArray:
        saved = slam.saved()
        return np.asarray(saved.information[~saved.robust].mean(axis=0).diagonal())

    assert (held(crowded) < 0.5 * held(empty)).all()
