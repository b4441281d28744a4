from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.saved_map import SavedMap, decode, encode
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.closures.closure import Closure
from station_gui.mapping.slam2d.config import GraphSlamConfig
from station_gui.mapping.slam2d.graph_slam import GraphSlam
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.particle.blocks.block_maps import BlockMapConfig
from station_gui.mapping.slam2d.particle.closing.config import BendConfig
from station_gui.mapping.slam2d.particle.closing.course import Course
from station_gui.mapping.slam2d.particle.config import ParticleSlamConfig
from station_gui.mapping.slam2d.particle.particle_slam import ParticleSlam
from station_gui.mapping.slam2d.particle.stored import Joints, to_saved
from station_gui.mapping.slam2d.se2_arrays import between

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]
LapMaker = Callable[[int], list[Pose2]]
_CONFIG = ParticleSlamConfig(particles=5, maps=BlockMapConfig(max_places=16_000, max_blocks=80_000))


def _slam() -> ParticleSlam:
    return ParticleSlam(_CONFIG, np.random.default_rng(0))


def _scans(walls: FloatArray, way: list[Pose2], make: ScanMaker, begin_s: float = 0.0) -> list[PointScan]:
    rng = np.random.default_rng(4)
    return [make(walls, pose, rng, stamp_s=begin_s + 0.1 * k) for k, pose in enumerate(way)]


def _sigma_m(information: FloatArray) -> float:
    """The widest one."""
    return 1.0 / math.sqrt(float(np.linalg.eigvalsh(information).min()))


@pytest.fixture
def given(lab: FloatArray, lap: LapMaker, scan_from: ScanMaker) -> SavedMap:
    """One lap by graph SLAM, with a closure that is made up."""
    slam = GraphSlam(GraphSlamConfig())
    for scan in _scans(lab, lap(80), scan_from):
        slam.add(scan)
    saved = slam.saved()
    last = len(saved.nodes) - 1
    return replace(
        saved,
        ends=np.vstack((saved.ends, [[0, last]])).astype(np.int32),
        measured=np.vstack((saved.measured, between(saved.nodes[0], saved.nodes[last]))),
        information=np.concatenate((saved.information, saved.information[:1])),
        robust=np.append(saved.robust, True),
        length_m=np.append(saved.length_m, 0.5),
    )


def test_edges_and_closures_of_a_map_that_was_given_are_kept(
    given: SavedMap, lab: FloatArray, lap: LapMaker, scan_from: ScanMaker
) -> None:
    slam = _slam()
    slam.load(given)
    assert slam.saved() is given
    scans = _scans(lab, lap(80), scan_from, 100.0)
    slam.resume(scans[30], lap(80)[30])
    for scan in scans[31:60]:
        slam.add(scan)
    saved = decode(encode(slam.saved()))

    edges = len(given.ends)
    np.testing.assert_array_equal(saved.ends[:edges], given.ends)
    np.testing.assert_array_equal(saved.information[:edges], given.information)
    np.testing.assert_allclose(saved.nodes[: len(given.nodes)], given.nodes, atol=1e-9)
    assert saved.robust.tolist()[:edges] == given.robust.tolist()
    assert len(saved.keyframes) > len(given.keyframes)
    assert saved.ends[edges][1] == len(given.nodes)  # to the node where the robot was found, from the nearest one
    away_m = np.hypot(*(given.nodes[:, :2] - saved.nodes[len(given.nodes), :2]).T)
    assert saved.ends[edges][0] == int(np.argmin(away_m))
    assert _sigma_m(saved.information[edges]) < 0.1


def test_the_other_method_goes_on_with_it(
    given: SavedMap, lab: FloatArray, lap: LapMaker, scan_from: ScanMaker
) -> None:
    slam = _slam()
    slam.load(given)
    scans = _scans(lab, lap(80), scan_from, 100.0)
    slam.resume(scans[30], lap(80)[30])
    for scan in scans[31:60]:
        slam.add(scan)
    graph = GraphSlam(GraphSlamConfig())
    graph.load(slam.saved())
    poses = [graph.resume(scans[60], lap(80)[60]), *(graph.add(scan) for scan in scans[61:])]
    graph.finish()

    assert max(a.distance_m(b) for a, b in zip(poses, lap(80)[60:], strict=True)) < 0.05
    assert len(graph.closures()) >= 1


def test_a_piece_that_hangs_by_odometry_alone_is_saved_as_such(
    lab: FloatArray, lap: LapMaker, scan_from: ScanMaker
) -> None:
    way = lap(80)
    rng = np.random.default_rng(1)
    elsewhere = np.array([(0.0, 0.0, 9.0, 0.0), (9.0, 0.0, 9.0, 7.0), (9.0, 7.0, 0.0, 7.0), (0.0, 7.0, 0.0, 0.0)])
    slam = _slam()
    for scan in _scans(lab, way[:30], scan_from):
        slam.add(scan)
    for k in range(80):  # carried off, and odometry says that it went on
        odom = way[29] @ Pose2(0.04 * k, 0.0, 0.0)
        slam.add(scan_from(elsewhere, Pose2(2.0 + 0.04 * k, 3.0, 0.2), rng, odom, stamp_s=10 + 0.1 * k))
    saved = slam.saved()

    loose = [e for e in range(len(saved.ends)) if _sigma_m(saved.information[e]) > 0.25]
    assert len(loose) == 1
    assert saved.length_m[loose[0]] >= 50.0
    first = int(saved.ends[loose[0], 1])
    assert saved.pieces.tolist() == [0] * first + [1] * (len(saved.nodes) - first)
    stamps = np.array([keyframe.stamp_s for keyframe in saved.keyframes])
    assert (stamps[saved.keyframe_nodes() >= saved.ends[loose[0], 1]] >= 10.0).all()


def test_closures_of_the_path_come_along() -> None:
    course = Course(BendConfig())
    way = [Pose2(0.5 * k, 0.0, 0.0).as_array() for k in range(12)]
    for k in range(12):
        course.add_step(k, between(way[max(k - 1, 0)], way[k]), np.eye(3) * 1e4, 0.0)
    new = course.nodes - 1
    at = course.first_steps
    closure = Closure(1, new, between(way[at[1]], way[at[new]]), np.diag((1e3, 2e3, 3e3)), searched=True)
    course.closures.append(closure)
    hit = np.ones((1, 2), np.float32)
    steps = [Keyframe(0.1 * k, 0, np.zeros(3), hit, hit * 0, np.zeros(2)) for k in range(12)]
    saved = to_saved(steps, np.array(way), Joints(None, {}, course, np.zeros(12, np.int32)))

    assert saved.robust.sum() == 1
    np.testing.assert_array_equal(saved.ends[saved.robust], [(1, new)])
    np.testing.assert_array_equal(saved.information[saved.robust], [closure.information])
    for e in np.flatnonzero(~saved.robust).tolist():
        np.testing.assert_array_equal(saved.information[e], course.information_to(e + 1))
    placed = [saved.nodes[k.node] + k.in_node for k in saved.keyframes]
    np.testing.assert_allclose(placed, way)
