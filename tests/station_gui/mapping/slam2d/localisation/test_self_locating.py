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
from station_gui.mapping.slam2d.base import StoredSlam
from station_gui.mapping.slam2d.config import GraphSlamConfig, GridConfig
from station_gui.mapping.slam2d.graph_slam import GraphSlam
from station_gui.mapping.slam2d.localisation.config import LocalisationConfig
from station_gui.mapping.slam2d.localisation.map_tracker import MapTracker
from station_gui.mapping.slam2d.localisation.self_locating import SelfLocatingSlam
from station_gui.mapping.slam2d.particle.config import ParticleSlamConfig
from station_gui.mapping.slam2d.particle.particle_slam import ParticleSlam
from station_gui.mapping.snapshot import Tracking

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]
LapMaker = Callable[[int], list[Pose2]]

_SOMEWHERE = Pose2(-7.0, 3.0, 2.0)  # where the odometry of another session began
_CONFIG = LocalisationConfig()


def _graph() -> StoredSlam:
    return GraphSlam(GraphSlamConfig())


def _particles() -> StoredSlam:
    return ParticleSlam(ParticleSlamConfig(particles=5), np.random.default_rng(0))


def _tracker() -> StoredSlam:
    return MapTracker(GraphSlamConfig())


def _slam(
    inner: StoredSlam, given: SavedMap | None, *, fixed: bool = False, config: LocalisationConfig = _CONFIG
) -> SelfLocatingSlam:
    return SelfLocatingSlam(config, GridConfig(), inner, given, fixed=fixed)


def _follow(
    slam: SelfLocatingSlam, walls: FloatArray, way: list[Pose2], make: ScanMaker, odom_from_room: Pose2, began: int = 0
) -> list[Pose2]:
    rng = np.random.default_rng(began)
    return [slam.add(make(walls, pose, rng, odom_from_room @ pose, 0.1 * (began + k))) for k, pose in enumerate(way)]


def _error_m(poses: list[Pose2], way: list[Pose2]) -> float:
    return max(pose.distance_m(truth) for pose, truth in zip(poses, way, strict=True))


@pytest.mark.parametrize("make_inner", [_graph, _particles, _tracker])
def test_a_session_goes_on_in_the_frame_of_the_map(
    make_inner: Callable[[], StoredSlam], lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker
) -> None:
    slam = _slam(make_inner(), decode(encode(lab_map)), fixed=make_inner is _tracker)
    assert slam.tracking is Tracking.SEARCHING
    way = lap(100)[30:80]
    poses = _follow(slam, lab, way, scan_from, _SOMEWHERE)
    slam.finish()

    assert slam.tracking is Tracking.LOCATED
    assert _error_m(poses[20:], way[20:]) < 0.05
    assert _error_m([slam.pose_of_scan(k) for k in range(50)], way) < 0.06
    grown = len(slam.trajectory()) - len(lab_map.keyframes)
    assert grown == 0 if slam.fixed else grown > 10


def test_a_fixed_map_is_not_changed(lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker) -> None:
    slam = _slam(_tracker(), lab_map, fixed=True)
    before = slam.grid()
    _follow(slam, lab, lap(100)[:40], scan_from, _SOMEWHERE)
    assert slam.fixed
    assert slam.grid() is before
    assert slam.saved() is lab_map
    assert encode(slam.saved()) == encode(lab_map)


def test_new_scans_close_loops_with_old_places(
    lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker
) -> None:
    slam = _slam(_graph(), lab_map)
    _follow(slam, lab, lap(120), scan_from, _SOMEWHERE)
    slam.finish()
    old = len(lab_map.keyframes)
    assert ((slam.closures().min(axis=1) < old) & (slam.closures().max(axis=1) >= old)).sum() >= 2
    assert len(slam.saved().nodes) > len(lab_map.nodes)


@pytest.mark.parametrize("make_inner", [_graph, _particles])
def test_what_one_method_saved_the_other_goes_on_with(
    make_inner: Callable[[], StoredSlam], lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker
) -> None:
    first = _slam(_particles(), lab_map)
    _follow(first, lab, lap(100)[:50], scan_from, _SOMEWHERE)
    second = _slam(make_inner(), decode(encode(first.saved())))
    way = lap(100)[50:90]
    poses = _follow(second, lab, way, scan_from, Pose2(2.0, 2.0, -1.0))
    assert second.tracking is Tracking.LOCATED
    assert _error_m(poses[20:], way[20:]) < 0.06


@pytest.mark.parametrize("make_inner", [_graph, _particles, _tracker])
def test_a_robot_that_is_carried_off_is_missed_and_found_again(
    make_inner: Callable[[], StoredSlam], lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker
) -> None:
    slam = _slam(make_inner(), lab_map, fixed=make_inner is _tracker)
    way = lap(100)
    _follow(slam, lab, way[:30], scan_from, _SOMEWHERE)
    assert slam.tracking is Tracking.LOCATED
    elsewhere = way[62:100]
    carried = _SOMEWHERE @ way[29] @ elsewhere[0].inverse()  # the odometry feels nothing of it
    states = []
    rng = np.random.default_rng(9)
    for k, pose in enumerate(elsewhere):
        pose_now = slam.add(scan_from(lab, pose, rng, carried @ pose, 3.0 + 0.1 * k))
        states.append(slam.tracking)

    assert Tracking.SEARCHING in states or Tracking.LOST in states
    assert states[-1] is Tracking.LOCATED
    assert pose_now.distance_m(elsewhere[-1]) < 0.05


def test_in_a_room_that_is_not_the_map_it_stays_lost_and_the_map_as_it_is(
    lab_map: SavedMap, other_room: FloatArray, scan_from: ScanMaker
) -> None:
    slam = _slam(_graph(), lab_map, config=replace(_CONFIG, give_up_m=100.0))
    way = [Pose2(0.6 + 0.05 * k, 1.5, 0.0) for k in range(50)]
    _follow(slam, other_room, way, scan_from, Pose2())
    assert slam.tracking in {Tracking.SEARCHING, Tracking.LOST}
    assert len(slam.trajectory()) == len(lab_map.keyframes)


def test_a_robot_that_is_not_found_again_begins_a_new_piece(
    lab: FloatArray, lap: LapMaker, other_room: FloatArray, scan_from: ScanMaker
) -> None:
    slam = _slam(_graph(), None, config=replace(_CONFIG, give_up_m=0.5))
    way = lap(100)[:40]
    assert _error_m(_follow(slam, lab, way, scan_from, Pose2()), way) < 0.05
    there = [Pose2(0.6 + 0.04 * k, 1.5, 0.0) for k in range(70)]
    carried = way[-1] @ there[0].inverse()
    keyframes = len(slam.trajectory())
    _follow(slam, other_room, there, scan_from, carried, began=40)
    assert slam.tracking is Tracking.APART
    assert len(slam.trajectory()) > keyframes + 10

    back = way[10:40]
    _follow(slam, lab, back[:25], scan_from, carried @ there[-1] @ back[0].inverse(), began=110)
    assert slam.tracking is Tracking.LOCATED
    assert slam.pose_of_scan(len(slam) - 1).distance_m(back[24]) < 0.05


def test_a_blink_of_the_scanner_is_no_reason_to_be_lost(lab: FloatArray, lap: LapMaker, scan_from: ScanMaker) -> None:
    slam = _slam(_graph(), None)
    way = lap(100)
    _follow(slam, lab, way[:20], scan_from, Pose2())
    near = np.array([(0.3, -0.3, 0.3, 0.3), (-0.3, 0.3, 0.3, 0.3), (-0.3, -0.3, 0.3, -0.3)])
    for k in range(5):  # somebody stands round the robot
        rng = np.random.default_rng(k)
        shut_in = scan_from(near, Pose2(), rng, way[20 + k], 2.0 + 0.1 * k)
        slam.add(shut_in)
        assert slam.tracking is Tracking.LOCATED
    poses = _follow(slam, lab, way[25:40], scan_from, Pose2(), began=25)
    assert slam.tracking is Tracking.LOCATED
    assert _error_m(poses, way[25:40]) < 0.05


def test_the_same_scans_give_the_same_poses_bit_for_bit(
    lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker
) -> None:
    way = lap(100)[10:45]
    first, second = (_follow(_slam(_graph(), lab_map), lab, way, scan_from, _SOMEWHERE) for _ in range(2))
    assert first == second


def test_while_it_is_lost_its_place_is_by_odometry(
    lab_map: SavedMap, other_room: FloatArray, scan_from: ScanMaker
) -> None:
    slam = _slam(_graph(), lab_map)
    start = Pose2(1.0, 1.5, 0.2)
    way = [start @ Pose2(0.02 * k, 0.0, 0.01 * k) for k in range(8)]
    poses = _follow(slam, other_room, way, scan_from, _SOMEWHERE)
    moved = poses[0].inverse() @ poses[-1]
    assert moved.distance_m(way[0].inverse() @ way[-1]) < 1e-9
    assert math.isclose(moved.theta_rad, 0.07, abs_tol=1e-9)


class _Deceived(MapTracker):
    """Follows the robot where it stood, by scans that seem to fit a little worse than usual."""

    deceived = False
    jumps = False

    def add(self, scan: PointScan) -> Pose2:
        pose = super().add(scan)
        if not self.deceived:
            return pose
        self._lost_scans, self._fit, self._pose = 0, 0.85, self.believed.as_array()
        self._surprise = 50.0 if self.jumps else 0.5
        return self.believed

    believed = Pose2()


def _deceived(lab_map: SavedMap, lab: FloatArray, way: list[Pose2], make: ScanMaker) -> SelfLocatingSlam:
    inner = _Deceived(GraphSlamConfig())
    slam = _slam(inner, lab_map, fixed=True)
    inner.believed = _follow(slam, lab, way, make, _SOMEWHERE)[-1]
    inner.deceived = True
    assert slam.tracking is Tracking.LOCATED
    return slam


def test_a_place_that_fits_by_chance_gives_way_to_the_one_that_fits(
    lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker
) -> None:
    way = lap(100)
    slam = _deceived(lab_map, lab, way[:25], scan_from)
    rng = np.random.default_rng(5)
    there = way[70]
    for k in range(25):
        pose = slam.add(scan_from(lab, there, rng, _SOMEWHERE @ way[24], 3.0 + 0.1 * k))
        if pose.distance_m(there) < 0.03:
            break
    assert pose.distance_m(there) < 0.03
    assert slam.tracking is Tracking.LOCATED


def test_a_jump_to_where_the_map_says_otherwise_is_a_loss_even_if_no_other_place_fits(
    lab: FloatArray, lab_map: SavedMap, lap: LapMaker, other_room: FloatArray, scan_from: ScanMaker
) -> None:
    way = lap(100)
    slam = _deceived(lab_map, lab, way[:25], scan_from)
    rng, inner = np.random.default_rng(5), slam.inner
    assert isinstance(inner, _Deceived)
    inner.jumps = True
    for k in range(25):
        slam.add(scan_from(other_room, Pose2(2.5, 1.5, 0.3), rng, _SOMEWHERE @ way[24], 3.0 + 0.1 * k))
    assert slam.tracking in {Tracking.LOST, Tracking.SEARCHING}


def test_scans_that_fit_worse_at_the_right_place_change_nothing(
    lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker
) -> None:
    way = lap(100)
    slam = _deceived(lab_map, lab, way[:25], scan_from)
    rng = np.random.default_rng(5)
    before = slam.revision
    for k in range(40):
        slam.add(scan_from(lab, way[24], rng, _SOMEWHERE @ way[24], 3.0 + 0.1 * k))
        assert slam.tracking is Tracking.LOCATED
    assert slam.revision == before


@pytest.mark.parametrize("drawn_at", [Pose2(20.0, 2.0, 0.0), Pose2(1.5, 1.0, 2.8)])
def test_a_robot_found_in_the_old_map_brings_its_new_piece_along(
    lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker, drawn_at: Pose2
) -> None:
    slam, rng, way = GraphSlam(GraphSlamConfig()), np.random.default_rng(0), lap(100)
    slam.load(lab_map)
    odom = [_SOMEWHERE @ pose for pose in way]
    slam.begin_piece(scan_from(lab, way[30], rng, odom[30], 3.0), drawn_at)
    for k in range(31, 80):
        slam.add(scan_from(lab, way[k], rng, odom[k], 0.1 * k))
    assert slam.apart
    assert slam.pose_of_scan(20).distance_m(way[50]) > 0.3

    pose = slam.join(scan_from(lab, way[80], rng, odom[80], 8.0), way[80])

    assert not slam.apart
    assert not slam.keyframe_pieces().any()
    assert pose.distance_m(way[80]) < 0.03
    assert slam.pose_of_scan(20).distance_m(way[50]) < 0.05
    old = len(lab_map.keyframes)
    pairs = slam.closures()
    assert ((pairs.min(axis=1) < old) & (pairs.max(axis=1) >= old)).any()
    slam.finish()
    assert slam.pose_of_scan(20).distance_m(way[50]) < 0.05


def test_a_piece_whose_loop_closes_at_the_very_end_is_joined_too(
    lab: FloatArray, lap: LapMaker, scan_from: ScanMaker
) -> None:
    slam, rng, way = GraphSlam(GraphSlamConfig()), np.random.default_rng(0), 2 * lap(100)
    scans = [scan_from(lab, pose, rng, pose, 0.1 * k) for k, pose in enumerate(way)]
    for scan in scans:
        slam.add(scan)
    slam.begin_piece(scans[30], way[30])
    for scan in scans[31:36]:
        slam.add(scan)
    assert slam.apart
    slam.finish()
    assert not slam.apart
    assert not slam.saved().pieces.any()


def _outside(lab: FloatArray, other_room: FloatArray) -> tuple[FloatArray, list[Pose2]]:
    """Walls of the lab and of another room that a door joins to it, and the way from there into the lab."""
    room = other_room + np.array([4.1, 0.0, 4.1, 0.0])
    solid = [wall for wall in np.vstack((lab, room)).tolist() if not (wall[0] == wall[2] and wall[0] in (3.95, 4.1))]
    door = [(x, a, x, b) for x in (3.95, 4.1) for a, b in ((0.0, 1.2), (2.2, 3.3))] + [(3.95, 3.3, 3.95, 4.2)]
    jambs = [(3.95, y, 4.1, y) for y in (1.2, 2.2)]
    way = [Pose2(8.4 - 0.06 * k, 1.5, math.pi) for k in range(130)]
    return np.array(solid + door + jambs), way


def test_a_robot_put_down_outside_its_map_begins_a_piece_that_joins_when_it_comes_home(
    lab: FloatArray, other_room: FloatArray, scan_from: ScanMaker
) -> None:
    walls, home = _outside(lab, other_room)
    known = GraphSlam(GraphSlamConfig())
    for k in range(60):
        pose = Pose2(0.7 + 0.02 * k, 1.6, 0.6 * math.sin(0.3 * k))
        known.add(scan_from(walls, pose, np.random.default_rng(k), stamp_s=0.1 * k))
    slam = _slam(_graph(), known.saved(), config=replace(_CONFIG, give_up_m=1.0))
    there = [Pose2(5.0 + 0.06 * k, 1.5, 0.0) for k in range(56)]
    states = []
    for k, pose in enumerate(there + home):
        slam.add(scan_from(walls, pose, np.random.default_rng(k), _SOMEWHERE @ pose, 0.1 * k))
        states.append(slam.tracking)

    assert states[5] in {Tracking.LOST, Tracking.SEARCHING}
    assert Tracking.APART in states
    assert states[-1] is Tracking.LOCATED
    poses = [slam.pose_of_scan(k) for k in range(len(slam))]
    assert _error_m(poses, there + home) < 0.15
    assert not slam.saved().pieces.any()


def test_a_robot_put_down_outside_a_fixed_map_stays_lost(
    lab_map: SavedMap, other_room: FloatArray, scan_from: ScanMaker
) -> None:
    slam = _slam(_tracker(), lab_map, fixed=True, config=replace(_CONFIG, give_up_m=0.5))
    _follow(slam, other_room, [Pose2(0.6 + 0.05 * k, 1.5, 0.0) for k in range(70)], scan_from, Pose2())
    assert slam.tracking is Tracking.LOST


def test_a_robot_that_sees_nothing_begins_no_piece(lab_map: SavedMap) -> None:
    slam = _slam(_graph(), lab_map, config=replace(_CONFIG, give_up_m=0.5))
    for k in range(60):
        slam.add(PointScan(0.1 * k, Pose2(0.05 * k, 0.0, 0.0), np.zeros(2), np.zeros((0, 2))))
    assert slam.tracking in {Tracking.LOST, Tracking.SEARCHING}


@pytest.mark.parametrize("make_inner", [_graph, _particles])
def test_a_piece_that_is_not_joined_is_saved_and_comes_back_as_such(
    make_inner: Callable[[], StoredSlam], lab_map: SavedMap, other_room: FloatArray, scan_from: ScanMaker
) -> None:
    first = _slam(make_inner(), lab_map, config=replace(_CONFIG, give_up_m=0.5))
    way = [Pose2(0.6 + 0.05 * k, 1.5, 0.4 * math.sin(0.1 * k)) for k in range(70)]
    _follow(first, other_room, way, scan_from, Pose2())
    assert first.tracking is Tracking.APART
    saved = decode(encode(first.saved()))
    assert set(saved.pieces.tolist()) == {0, 1}

    for fixed in (False, True):
        second = _slam(_tracker() if fixed else make_inner(), saved, fixed=fixed)
        poses = _follow(second, other_room, way[30:60], scan_from, _SOMEWHERE)
        assert second.tracking is Tracking.APART
        apart = first.pose_of_scan(59) @ way[59].inverse()
        assert poses[-1].distance_m(apart @ way[59]) < 0.05


def _person(pose: Pose2, k: int) -> FloatArray:
    """Two legs that walk across in front of the robot."""
    side_m = -0.9 + 0.12 * k
    legs = [pose @ Pose2(0.7, side_m + apart, 0.0) for apart in (-0.12, 0.12)]
    return np.array([(p.x_m - 0.07, p.y_m - 0.07, p.x_m + 0.07, p.y_m + 0.07) for p in legs])


@pytest.mark.parametrize("make_inner", [_graph, _particles, _tracker])
def test_people_who_walk_past_leave_the_robot_where_it_is(
    make_inner: Callable[[], StoredSlam], lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker
) -> None:
    slam = _slam(make_inner(), lab_map, fixed=make_inner is _tracker)
    way = lap(200)
    _follow(slam, lab, way[:30], scan_from, _SOMEWHERE)
    assert slam.tracking is Tracking.LOCATED
    for k, pose in enumerate(way[30:90]):
        walls = np.vstack((lab, _person(pose, k % 16)))
        seen = slam.add(scan_from(walls, pose, np.random.default_rng(k), _SOMEWHERE @ pose, 3.0 + 0.1 * k))
        assert slam.tracking is Tracking.LOCATED
        assert seen.distance_m(pose) < 0.05


@pytest.mark.parametrize("box", [(1.2, 0.2, 0.5, 0.4), (3.2, 1.9, 0.4, 0.6)])
def test_a_box_that_was_moved_leaves_the_robot_where_it_is(
    lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker, box: tuple[float, float, float, float]
) -> None:
    x, y, width, height = box
    a, b = x + width, y + height
    moved = np.vstack((np.delete(lab, slice(4, 8), axis=0), [(x, y, a, y), (a, y, a, b), (a, b, x, b), (x, b, x, y)]))
    slam = _slam(_graph(), lab_map)
    way = lap(200)
    _follow(slam, lab, way[:30], scan_from, _SOMEWHERE)
    for walls, first, last in ((lab, 30, 40), (moved, 40, 110)):
        for k in range(first, last):
            pose = way[k] if k < 60 or k > 80 else way[60]
            seen = slam.add(scan_from(walls, pose, np.random.default_rng(k), _SOMEWHERE @ pose, 0.1 * k))
            assert slam.tracking is Tracking.LOCATED
            assert seen.distance_m(pose) < 0.05


@pytest.mark.parametrize("make", [_graph, _particles, _tracker])
def test_a_match_that_is_not_believed_is_no_fit(
    make: Callable[[], StoredSlam], lab: FloatArray, lab_map: SavedMap, lap: LapMaker, scan_from: ScanMaker
) -> None:
    slam, way, rng = make(), lap(80), np.random.default_rng(3)
    slam.load(lab_map)
    slam.resume(scan_from(lab, way[20], rng), way[20])
    slam.add(scan_from(lab, way[21], rng))
    assert slam.fit > 0.8
    slam.add(PointScan(0.2, way[22], np.zeros(2), rng.uniform(-0.3, 0.3, (200, 2))))
    assert slam.fit == 0.0
    slam.add(scan_from(lab, way[23], rng))
    assert slam.fit > 0.8
