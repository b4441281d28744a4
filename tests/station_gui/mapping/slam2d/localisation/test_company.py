"""People who walk along with the robot, and wheels that count nothing: what a robot has to live with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.build import build_slam
from station_gui.config import load_config
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.localisation.self_locating import SelfLocatingSlam
from station_gui.mapping.snapshot import Tracking

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]
LapMaker = Callable[[int], list[Pose2]]

_TWO_AHEAD = ((0.7, -0.2), (0.7, 0.2))
_FIVE_ROUND = ((0.6, 0.0), (0.5, 0.4), (0.5, -0.4), (0.0, 0.5), (0.0, -0.5))


def _legs(pose: Pose2, people: tuple[tuple[float, float], ...], rng: np.random.Generator) -> FloatArray:
    """(W, 4): two each, at places in the robot's frame that they keep, but for some centimetres."""
    legs = []
    for ahead_m, left_m in people:
        for apart_m in (-0.12, 0.12):
            at = pose @ Pose2(ahead_m + rng.normal(0.0, 0.02), left_m + apart_m + rng.normal(0.0, 0.02), 0.0)
            legs.append((at.x_m - 0.07, at.y_m - 0.07, at.x_m + 0.07, at.y_m + 0.07))
    return np.array(legs)


def _mapping(lab: FloatArray, way: list[Pose2], make: ScanMaker) -> SelfLocatingSlam:
    """Alone along `way`."""
    slam, rng = build_slam(load_config(None)), np.random.default_rng(0)
    for k, pose in enumerate(way):
        slam.add(make(lab, pose, rng, pose, 0.1 * k))
    return slam


def test_two_people_who_walk_ahead_do_not_take_the_robot_along(
    lab: FloatArray, lap: LapMaker, scan_from: ScanMaker
) -> None:
    way, rng = lap(200), np.random.default_rng(1)
    slam = _mapping(lab, way[:40], scan_from)
    for k, pose in enumerate(way[40:], 40):
        walls = np.vstack((lab, _legs(pose, _TWO_AHEAD, rng)))
        seen = slam.add(scan_from(walls, pose, rng, pose, 0.1 * k))
        assert slam.tracking is Tracking.LOCATED
        assert seen.distance_m(pose) < 0.1


def test_a_robot_that_a_crowd_shuts_in_says_so_and_is_found_when_it_has_gone(
    lab: FloatArray, lap: LapMaker, scan_from: ScanMaker
) -> None:
    """It drives on, for what it saw over the last 4 m is looked for in the map."""
    way, rng = lap(150), np.random.default_rng(1)
    slam = _mapping(lab, way, scan_from)
    states = []
    for k, pose in enumerate([*way, *way[:40]], 150):
        walls = np.vstack((lab, _legs(pose, _FIVE_ROUND, rng))) if k < 210 else lab
        seen = slam.add(scan_from(walls, pose, rng, pose, 0.1 * k))
        states.append(slam.tracking)
        assert slam.tracking is not Tracking.LOCATED or seen.distance_m(pose) < 0.05
    assert Tracking.LOCATED not in states[20:60]
    assert states[-1] is Tracking.LOCATED
    assert not slam.saved().pieces.any()


@pytest.mark.parametrize("scans", [200, 70])
def test_a_robot_whose_wheels_count_nothing_is_followed_by_its_scans(
    lab: FloatArray, lap: LapMaker, scan_from: ScanMaker, scans: int
) -> None:
    """With 70 scans it goes 0.11 m between two."""
    way, rng = lap(scans), np.random.default_rng(1)
    slam = _mapping(lab, way[:30], scan_from)
    for k, pose in enumerate(way[30:], 30):
        seen = slam.add(scan_from(lab, pose, rng, way[29], 0.1 * k))
        assert slam.tracking is Tracking.LOCATED
        assert seen.distance_m(pose) < 0.05
