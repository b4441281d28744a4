from __future__ import annotations

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
from station_gui.mapping.slam2d.particle.blocks.block_maps import BlockMapConfig
from station_gui.mapping.slam2d.particle.config import ParticleSlamConfig
from station_gui.mapping.slam2d.particle.particle_slam import ParticleSlam
from tools.evaluate.slam import read_relations, relation_errors
from tools.logs.carmen import CarmenReader

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]
LapMaker = Callable[[int], list[Pose2]]
_SLAM_DATA = Path(__file__).resolve().parents[5] / ".." / "shared" / "data" / "slam"
_CONFIG = ParticleSlamConfig(maps=BlockMapConfig(max_places=16_000, max_blocks=80_000))


def _drive(walls: FloatArray, way: list[Pose2], make: ScanMaker, turn_error: float = 0.0) -> list[PointScan]:
    """Scans along the way; the wheels slip by 5 % and the odometry turns too far by the share `turn_error`."""
    rng = np.random.default_rng(4)
    odom, scans = way[0], [make(walls, way[0], rng, way[0])]
    for k in range(1, len(way)):
        step = way[k - 1].inverse() @ way[k]
        slip = 1.05 + rng.normal(0, 0.02)
        odom = odom @ Pose2(slip * step.x_m, slip * step.y_m, step.theta_rad * (1 + turn_error))
        scans.append(make(walls, way[k], rng, odom, 0.1 * k))
    return scans


def _run(scans: list[PointScan], seed: int = 0, config: ParticleSlamConfig = _CONFIG) -> ParticleSlam:
    slam = ParticleSlam(config, np.random.default_rng(seed))
    for scan in scans:
        slam.add(scan)
    slam.finish()
    return slam


def _errors_m(slam: ParticleSlam, way: list[Pose2]) -> FloatArray:
    truth = np.array([pose.as_array() for pose in way])
    return np.asarray(np.hypot(*(slam.scan_poses() - truth)[:, :2].T))


def _ring() -> tuple[FloatArray, list[Pose2]]:
    """A corridor 2 m wide round a square of 6 m with niches, so that places differ; one lap and a quarter."""
    walls = [(0, 0, 10, 0), (10, 0, 10, 10), (10, 10, 0, 10), (0, 10, 0, 0)]
    walls += [(2, 2, 8, 2), (8, 2, 8, 8), (8, 8, 2, 8), (2, 8, 2, 2)]
    for along in (1.3, 2.9, 4.1, 6.2, 7.4, 8.8):
        walls += [(along, 0, along, 0.3), (10, along, 9.6, along), (along + 0.5, 10, along + 0.5, 9.7)]
        walls += [(0, along + 0.3, 0.4, along + 0.3)]
    straight = np.arange(1.0, 9.0, 0.12)
    legs = [(straight, 1.0, 0.0), (9.0, straight, 0.5), (10 - straight, 9.0, 1.0), (1.0, 10 - straight, -0.5)]
    way = []
    for number in range(5):
        x, y, quarter = legs[number % 4]
        for a, b in zip(*np.broadcast_arrays(x, y), strict=True):
            way.append(Pose2(float(a), float(b), quarter * math.pi))
        end = way[-1]
        turn = np.linspace(0, math.pi / 2, 12)[1:-1]
        way += [Pose2(end.x_m, end.y_m, math.remainder(end.theta_rad + float(t), math.tau)) for t in turn]
    return np.array(walls, np.float64), way


def test_three_laps_of_the_lab_are_tracked_within_two_centimetres(
    lab: FloatArray, scan_from: ScanMaker, lap: LapMaker
) -> None:
    way = lap(120) * 3
    error = _errors_m(_run(_drive(lab, way, scan_from)), way)
    assert float(np.sqrt(np.mean(error**2))) < 0.02
    assert float(error.max()) < 0.05


def test_a_loop_of_corridors_closes(scan_from: ScanMaker) -> None:
    """A scanner that does not see across; odometry alone is far off when the robot comes back."""
    walls, way = _ring()
    scans = _drive(walls, way, scan_from, turn_error=0.02)
    slam = _run(scans)
    assert scans[-1].odom_from_robot.distance_m(way[-1]) > 0.5
    assert float(_errors_m(slam, way)[-40:].max()) < 0.1
    steps = slam.trajectory()[slam.closures(), 1:3]
    assert len(steps) > 3
    assert float(np.hypot(*(steps[:, 0] - steps[:, 1]).T).max()) < 3.0  # near enough to see the same


def test_the_same_scans_and_seed_give_the_same_map_bit_for_bit_and_another_seed_another(
    lab: FloatArray, scan_from: ScanMaker, lap: LapMaker
) -> None:
    scans = _drive(lab, lap(80) * 2, scan_from)
    one, two, other = _run(scans, 1), _run(scans, 1), _run(scans, 2)
    assert one.scan_poses().tobytes() == two.scan_poses().tobytes()
    assert one.grid().probability.tobytes() == two.grid().probability.tobytes()
    assert one.revision == two.revision
    assert one.scan_poses().tobytes() != other.scan_poses().tobytes()


def test_reading_the_map_between_scans_changes_nothing(lab: FloatArray, scan_from: ScanMaker, lap: LapMaker) -> None:
    scans = _drive(lab, lap(60), scan_from)
    watched = ParticleSlam(_CONFIG, np.random.default_rng(0))
    for scan in scans:
        watched.add(scan)
        watched.grid()
        watched.trajectory()
    watched.finish()
    assert watched.scan_poses().tobytes() == _run(scans).scan_poses().tobytes()
    assert watched.grid().probability.tobytes() == _run(scans).grid().probability.tobytes()


def test_poses_that_were_given_out_stand_until_the_revision_grows(
    lab: FloatArray, scan_from: ScanMaker, lap: LapMaker
) -> None:
    slam = ParticleSlam(_CONFIG, np.random.default_rng(0))
    given: list[Pose2] = []
    revision = 0
    for k, scan in enumerate(_drive(lab, lap(80) * 2, scan_from)):
        pose = slam.add(scan)
        if slam.revision != revision:
            given, revision = [slam.pose_of_scan(i) for i in range(k)], slam.revision
        given.append(pose)
        for index in (0, k // 2, k):
            np.testing.assert_allclose(slam.pose_of_scan(index).as_array(), given[index].as_array(), atol=1e-12)
    assert revision > 0


def test_a_scan_that_fits_nowhere_leaves_the_map_alone(lab: FloatArray, scan_from: ScanMaker, lap: LapMaker) -> None:
    scans = _drive(lab, lap(120), scan_from)
    rng = np.random.default_rng(9)
    for k in (40, 41, 42):  # somebody stands right before the scanner
        scans[k] = replace(scans[k], points_m=rng.uniform(-0.3, 0.3, (200, 2)))
    error = _errors_m(_run(scans), lap(120))
    assert float(np.delete(error, [40, 41, 42]).max()) < 0.05


@pytest.mark.parametrize(
    "points",
    [np.zeros((0, 2)), np.ones((1, 2)), np.ones((300, 2)), np.full((50, 2), 1e12), np.full((50, 2), 1e300)],
    ids=["none", "one", "one place", "far off", "farther than single precision"],
)
def test_scans_of_nothing_or_of_one_place_do_no_harm(
    lab: FloatArray, scan_from: ScanMaker, lap: LapMaker, points: FloatArray
) -> None:
    scans = _drive(lab, lap(60), scan_from)
    bad = PointScan(0.0, scans[0].odom_from_robot, np.zeros(2), points)
    slam = ParticleSlam(_CONFIG, np.random.default_rng(0))
    for scan in [bad, *scans[:20], bad, *scans[20:]]:
        assert np.isfinite(slam.add(scan).as_array()).all()
    slam.finish()
    assert slam.grid().probability.size < 16_000_000


@pytest.mark.parametrize("points", [0, 8])
def test_the_map_begins_with_the_first_scan_of_enough_points(
    lab: FloatArray, scan_from: ScanMaker, lap: LapMaker, points: int
) -> None:
    scans = _drive(lab, lap(80), scan_from)
    for k in range(6):
        scans[k] = replace(scans[k], points_m=scans[k].points_m[:points])
    slam = _run(scans)

    assert slam.lost_scans == 0
    assert float(_errors_m(slam, lap(80)).max()) < 0.06
    assert slam.saved().keyframes[0].stamp_s == scans[6].stamp_s


def test_what_did_not_fit_is_neither_drawn_nor_saved(lab: FloatArray, scan_from: ScanMaker, lap: LapMaker) -> None:
    scans = _drive(lab, lap(80), scan_from)
    scans[0] = replace(scans[0], points_m=np.array([[-3.0 - 0.1 * k, -3.0] for k in range(8)]))
    slam = _run(scans)

    occupied = slam.grid().occupied_m()
    assert float(occupied.min()) > -0.3
    assert all(len(keyframe.points_m) for keyframe in slam.saved().keyframes)


def test_numbers_that_are_not_finite_are_refused() -> None:
    slam = ParticleSlam(_CONFIG, np.random.default_rng(0))
    with pytest.raises(MappingError, match="not finite"):
        slam.add(PointScan(1.0, Pose2(), np.zeros(2), np.array([[np.nan, 0.0]])))
    with pytest.raises(MappingError, match="not finite"):
        slam.add(PointScan(1.0, Pose2(math.inf, 0.0, 0.0), np.zeros(2), np.zeros((3, 2))))


def test_an_empty_map_is_a_map() -> None:
    slam: Slam = ParticleSlam(_CONFIG, np.random.default_rng(0))
    slam.finish()
    assert slam.trajectory().shape == (0, 4)
    assert (slam.grid().probability == 0.5).all()


def test_a_store_that_is_too_small_costs_map_but_not_the_run(
    lab: FloatArray, scan_from: ScanMaker, lap: LapMaker
) -> None:
    config = ParticleSlamConfig(maps=BlockMapConfig(max_places=200, max_blocks=100))
    slam = _run(_drive(lab, lap(60), scan_from), 0, config)
    assert np.isfinite(slam.scan_poses()).all()


@pytest.mark.skipif(not _SLAM_DATA.is_dir(), reason="the folder shared/data is not there")
def test_the_first_part_of_the_intel_log_agrees_with_the_relations_made_by_hand() -> None:
    observations = list(islice(CarmenReader(_SLAM_DATA / "intel.clf.bz2"), 600))
    slam = _run([to_points(observation) for observation in observations], 0, ParticleSlamConfig())
    stamps = np.array([observation.stamp_s for observation in observations])
    relations = read_relations(_SLAM_DATA / "intel.relations.gz")
    translation_m, rotation_rad = relation_errors(stamps, slam.scan_poses(), relations)
    assert len(translation_m) > 40
    assert translation_m.mean() < 0.02
    assert np.degrees(rotation_rad).mean() < 0.35
