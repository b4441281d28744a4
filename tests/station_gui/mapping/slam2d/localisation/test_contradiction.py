from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.config import NormalConfig
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.localisation.config import DoubtConfig
from station_gui.mapping.slam2d.localisation.contradiction import Contradiction
from station_gui.mapping.slam2d.matching.scan_matcher import to_lines
from station_gui.mapping.slam2d.se2_arrays import compose_all

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]


@pytest.fixture
def contradiction(lab_map: SavedMap) -> Contradiction:
    in_node = np.array([keyframe.in_node for keyframe in lab_map.keyframes])
    poses = compose_all(lab_map.nodes[lab_map.keyframe_nodes()], in_node)
    return Contradiction(DoubtConfig(), lab_map.keyframes, poses)


def _seen(scan: PointScan) -> Keyframe:
    lines = to_lines(scan.points_m, scan.origin_m, NormalConfig())
    points_m, normals = lines.points_m.astype(np.float32), lines.normals.astype(np.float32)
    return Keyframe(0.0, 0, np.zeros(3), points_m, normals, scan.origin_m)


def test_a_scan_at_its_own_place_contradicts_nothing(
    contradiction: Contradiction, lab: FloatArray, lap: Callable[[int], list[Pose2]], scan_from: ScanMaker
) -> None:
    rng = np.random.default_rng(1)
    for pose in lap(9):
        assert not contradiction.found_by(_seen(scan_from(lab, pose, rng)), pose.as_array())


def test_a_scan_from_elsewhere_contradicts_the_map(
    contradiction: Contradiction, lab: FloatArray, places: list[Pose2], scan_from: ScanMaker
) -> None:
    rng = np.random.default_rng(1)
    for truth in places:
        seen = _seen(scan_from(lab, truth, rng))
        for other in places:
            assert contradiction.found_by(seen, other.as_array()) == (other is not truth)


def test_walls_that_are_looked_through_are_a_contradiction_too(
    contradiction: Contradiction, places: list[Pose2]
) -> None:
    angle = np.linspace(0.0, math.tau, 720, endpoint=False)
    hall = 9.0 * np.column_stack((np.cos(angle), np.sin(angle)))
    assert contradiction.found_by(_seen(PointScan(0.0, Pose2(), np.zeros(2), hall)), places[0].as_array())


def test_a_scan_that_saw_nothing_contradicts_nothing(contradiction: Contradiction, places: list[Pose2]) -> None:
    assert not contradiction.found_by(
        _seen(PointScan(0.0, Pose2(), np.zeros(2), np.zeros((0, 2)))), places[0].as_array()
    )
