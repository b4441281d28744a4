from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.config import GraphSlamConfig, KeyframeConfig
from station_gui.mapping.slam2d.graph_slam import GraphSlam
from station_gui.mapping.slam2d.held import HeldScan, HeldScans
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan

FloatArray = NDArray[np.float64]

_NOTHING = LineScan(np.zeros((0, 2)), np.zeros((0, 2)))
_ROOM = np.concatenate(
    [np.column_stack((np.linspace(-3, 3, 120), np.full(120, y))) for y in (-2.0, 2.0)]
    + [np.column_stack((np.full(80, x), np.linspace(-2, 2, 80))) for x in (-3.0, 3.0)]
)


def _held(x_m: float) -> HeldScan:
    scan = PointScan(0.0, Pose2(), np.zeros(2), np.zeros((0, 2)))
    return HeldScan(scan, _NOTHING, np.array([x_m, 0.0, 0.0]), 1.0)


def _drive(slam: GraphSlam, first: int, last: int) -> None:
    """0.05 m a scan along the room."""
    for k in range(first, last):
        pose = Pose2(0.05 * k, 0.0, 0.0)
        slam.add(PointScan(0.1 * k, pose, np.zeros(2), pose.inverse().apply(_ROOM)))


def test_of_a_robot_that_stands_one_scan_is_held() -> None:
    held = HeldScans(KeyframeConfig())
    for x_m in (0.0, 0.01, 0.02, 0.06, 0.07):
        held.hold(_held(x_m))
    assert [one.in_node[0] for one in held.release()] == [0.0, 0.06]
    assert held.release() == []


def test_what_is_held_has_a_bound() -> None:
    held = HeldScans(KeyframeConfig())
    for k in range(1000):
        held.hold(_held(0.1 * k))
    assert len(held.release()) < 100


def test_a_doubt_that_ends_leaves_no_gap_in_the_map() -> None:
    doubting, sure = GraphSlam(GraphSlamConfig()), GraphSlam(GraphSlamConfig())
    wary = False
    doubting.guard(lambda fit, surprise: not wary)
    for slam in (doubting, sure):
        _drive(slam, 0, 5)
    keyframes = len(doubting.keyframes)
    wary = True
    _drive(doubting, 5, 11)
    assert len(doubting.keyframes) == keyframes
    wary = False
    _drive(sure, 5, 11)
    for slam in (doubting, sure):
        _drive(slam, 11, 14)
    assert abs(len(doubting.keyframes) - len(sure.keyframes)) <= 1
    poses = doubting.keyframe_poses()
    assert np.diff(poses[:, 0]).max() < 0.21
    assert np.abs(poses[:, 0] - 0.5 * np.array([k.stamp_s for k in doubting.keyframes])).max() < 0.01


def test_what_was_held_of_a_robot_that_was_carried_off_never_enters_the_map() -> None:
    slam = GraphSlam(GraphSlamConfig())
    wary = False
    slam.guard(lambda fit, surprise: not wary)
    _drive(slam, 0, 5)
    wary = True
    _drive(slam, 5, 11)
    wary = False
    home = PointScan(1.1, Pose2(), np.zeros(2), _ROOM)
    slam.resume(home, Pose2())
    _drive(slam, 12, 14)
    assert not [k for k in slam.keyframes if 0.45 < k.stamp_s < 1.05]
