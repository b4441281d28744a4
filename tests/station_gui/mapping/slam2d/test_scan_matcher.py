from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.config import LocalMapConfig, MatchConfig, NormalConfig
from station_gui.mapping.slam2d.matching import _kernels
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, ScanMatcher, to_lines

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]
_CONFIG = LocalMapConfig(size_m=12.8)


def _lines(scan: PointScan) -> LineScan:
    return to_lines(scan.points_m, scan.origin_m, NormalConfig())


@pytest.fixture
def matcher() -> ScanMatcher:
    return ScanMatcher(MatchConfig(), _CONFIG.reach_cells, _CONFIG.cell_m)


@pytest.fixture
def lab_map(lab: FloatArray, scan_from: ScanMaker) -> LocalMap:
    """Made of twenty noisy scans at known poses."""
    rng = np.random.default_rng(7)
    local_map = LocalMap(_CONFIG.size_m, _CONFIG.cell_m, _CONFIG.reach_cells, 10_000, _CONFIG.max_count)
    for _ in range(20):
        pose = Pose2(rng.uniform(0.9, 1.5), rng.uniform(0.9, 1.5), rng.uniform(-0.5, 2.0))
        lines = _lines(scan_from(lab, pose, rng))
        local_map.insert(lines.points_m, lines.normals, pose.as_array())
    return local_map


@pytest.mark.parametrize("offset", [(0.1, -0.05, 0.05), (-0.15, 0.1, -0.1), (0.0, 0.2, 0.0)])
def test_a_scan_is_found_within_five_millimetres(
    lab: FloatArray, scan_from: ScanMaker, lab_map: LocalMap, matcher: ScanMatcher, offset: tuple[float, float, float]
) -> None:
    truth = np.array([1.2, 1.3, 0.7])
    scan = _lines(scan_from(lab, Pose2.from_array(truth), np.random.default_rng(3)))

    match = matcher.match(scan, lab_map, truth + offset, np.zeros(3))

    assert math.hypot(*(match.pose - truth)[:2]) < 0.005
    assert abs(match.pose[2] - truth[2]) < math.radians(0.2)
    assert match.share > 0.9


def test_a_prediction_far_off_is_rescued_by_the_search(
    lab: FloatArray, scan_from: ScanMaker, lab_map: LocalMap, matcher: ScanMatcher
) -> None:
    truth = np.array([1.2, 1.3, 0.7])
    scan = _lines(scan_from(lab, Pose2.from_array(truth), np.random.default_rng(3)))

    match = matcher.match(scan, lab_map, truth + np.array([0.35, -0.3, 0.3]), np.zeros(3))

    assert math.hypot(*(match.pose - truth)[:2]) < 0.01


def test_a_match_too_far_from_the_prediction_for_how_it_fits_is_doubted(
    lab: FloatArray, scan_from: ScanMaker, lab_map: LocalMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = MatchConfig(doubtful_share=0.0)  # so that only the distance is reason to search
    matcher, truth = ScanMatcher(config, _CONFIG.reach_cells, _CONFIG.cell_m), np.array([1.2, 1.3, 0.7])
    scan = _lines(scan_from(lab, Pose2.from_array(truth), np.random.default_rng(3)))
    hidden = LineScan(
        np.vstack((scan.points_m, 0.3 * scan.points_m[::5])), np.vstack((scan.normals, scan.normals[::5]))
    )
    searched, search = [], ScanMatcher.search

    def counting_search(*args: Any) -> FloatArray:
        searched.append(args)
        return search(*args)

    monkeypatch.setattr(ScanMatcher, "search", counting_search)
    for sigma in (1.0, 0.005):
        matcher.match(hidden, lab_map, truth + np.array([0.05, 0.0, 0.0]), np.full(3, sigma**-2))
    assert len(searched) == 1


def test_the_information_says_what_a_repetition_of_the_match_shows(
    lab: FloatArray, scan_from: ScanMaker, lab_map: LocalMap, matcher: ScanMatcher
) -> None:
    rng = np.random.default_rng(5)
    truth = Pose2(1.2, 1.3, 0.7)
    matches = [matcher.refine(_lines(scan_from(lab, truth, rng)), lab_map, truth.as_array()) for _ in range(40)]

    spread = np.std([match.pose for match in matches], axis=0)
    claimed = np.sqrt(np.diag(np.linalg.inv(matches[0].information)))

    assert (spread < 1.5 * claimed).all()
    assert (claimed < 10 * spread).all()


def test_along_a_corridor_the_odometry_decides(scan_from: ScanMaker) -> None:
    walls = np.array([[-30.0, 1.0, 30.0, 1.0], [-30.0, -1.0, 30.0, -1.0]])
    rng = np.random.default_rng(1)
    local_map = LocalMap(_CONFIG.size_m, _CONFIG.cell_m, _CONFIG.reach_cells, 10_000, _CONFIG.max_count)
    for x in np.linspace(-1, 1, 11):
        lines = _lines(scan_from(walls, Pose2(float(x), 0.0, 0.0), rng))
        local_map.insert(lines.points_m, lines.normals, np.array([x, 0.0, 0.0]))
    matcher = ScanMatcher(MatchConfig(), _CONFIG.reach_cells, _CONFIG.cell_m)
    predicted = np.array([0.3, 0.05, 0.03])
    weight = 1 / np.square([0.05, 0.05, 0.03])

    match = matcher.match(_lines(scan_from(walls, Pose2(0.3, 0.0, 0.0), rng)), local_map, predicted, weight)

    assert abs(match.pose[0] - 0.3) < 0.03
    assert abs(match.pose[1]) < 0.005
    assert match.information[0, 0] < 0.01 * match.information[1, 1]


def test_the_gradient_is_the_slope_of_the_residuals(lab: FloatArray, scan_from: ScanMaker, lab_map: LocalMap) -> None:
    """Half the sum of w r² with the weights held fixed, against central differences."""
    pose = np.array([1.21, 1.28, 0.71])
    scan = _lines(scan_from(lab, Pose2(1.2, 1.3, 0.7), np.random.default_rng(3)))

    _, gradient = _linearised(scan, lab_map, pose)
    weights = _weights(scan, lab_map, pose)
    numeric = [_slope(scan, lab_map, pose, axis, weights) for axis in range(3)]

    np.testing.assert_allclose(gradient, numeric, rtol=1e-4, atol=1e-6)


def _linearised(scan: LineScan, local_map: LocalMap, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    hessian, gradient, figures = np.zeros((3, 3)), np.zeros(3), np.zeros(4)
    _kernels.linearise(
        scan.points_m, scan.normals, pose, 0.05, 0.1, 0.3, local_map.origin_x_m, local_map.origin_y_m,
        local_map.cell_m, local_map.nearest, local_map.surfels, hessian, gradient, figures,
    )  # fmt: skip
    return hessian, gradient


def _residuals(scan: LineScan, local_map: LocalMap, at: FloatArray, moved: FloatArray) -> list[tuple[float, float]]:
    """Numpy twin: (residual at `moved`, share of the point weight), associations taken at `at`."""
    found = []
    here, there = Pose2.from_array(at), Pose2.from_array(moved)
    turned = Pose2(0.0, 0.0, here.theta_rad).apply(scan.normals)
    for near, far, normal in zip(here.apply(scan.points_m), there.apply(scan.points_m), turned, strict=True):
        column = math.floor((near[0] - local_map.origin_x_m) / local_map.cell_m)
        row = math.floor((near[1] - local_map.origin_y_m) / local_map.cell_m)
        index = local_map.nearest[row, column]
        if index < 0:
            continue
        count, x, y, nx, ny = local_map.surfels[index]
        difference = far - (x / count, y / count)
        length = math.hypot(nx, ny)
        if length > 0.5 * count:
            axis = np.array([nx, ny]) / length
            if axis @ normal >= 0:
                found.append((float(axis @ difference), 1.0))
        else:
            found.extend((float(d), 0.3) for d in difference)
    return found


def _weights(scan: LineScan, local_map: LocalMap, pose: FloatArray) -> FloatArray:
    rows = _residuals(scan, local_map, pose, pose)
    weights, k = [], 0
    while k < len(rows):
        pair = rows[k][1] < 1
        squared = rows[k][0] ** 2 + (rows[k + 1][0] ** 2 if pair else 0.0)
        weights += [rows[k][1] * (0.0025 / (0.0025 + squared)) ** 2] * (2 if pair else 1)
        k += 2 if pair else 1
    return np.array(weights)


def _slope(scan: LineScan, local_map: LocalMap, pose: FloatArray, axis: int, weights: FloatArray) -> float:
    step = np.zeros(3)
    step[axis] = 1e-6
    high = np.array([r for r, _ in _residuals(scan, local_map, pose, pose + step)])
    low = np.array([r for r, _ in _residuals(scan, local_map, pose, pose - step)])
    return float(0.5 * (weights @ high**2 - weights @ low**2) / 2e-6)


def test_normals_point_to_the_scanner_and_corners_have_none() -> None:
    along = np.linspace(-1, 1, 41)
    wall = np.column_stack((np.full(41, 2.0), along))
    normals = to_lines(wall, np.zeros(2), NormalConfig()).normals
    np.testing.assert_allclose(normals, np.tile([-1.0, 0.0], (41, 1)), atol=1e-12)


def test_points_far_from_each_other_are_left_out() -> None:
    lonely = np.array([[1.0, 0.0], [3.0, 1.0], [1.0, 2.0]])
    assert len(to_lines(lonely, np.zeros(2), NormalConfig()).points_m) == 0


@pytest.mark.parametrize("count", [0, 1, 2, 50])
def test_scans_of_nothing_or_of_one_place_do_no_harm(lab_map: LocalMap, matcher: ScanMatcher, count: int) -> None:
    lines = to_lines(np.full((count, 2), 0.5), np.zeros(2), NormalConfig())
    match = matcher.match(lines, lab_map, np.array([1.2, 1.3, 0.7]), np.ones(3))
    assert np.isfinite(match.pose).all()
    assert np.isfinite(match.information).all()


def test_hits_at_the_end_of_the_world_stay_out_of_the_window() -> None:
    local_map = LocalMap(_CONFIG.size_m, _CONFIG.cell_m, _CONFIG.reach_cells, 10_000, _CONFIG.max_count)
    far = np.array([[1e12, 0.0], [-1e300, 1e300], [6.39, 6.39]])
    local_map.insert(far, np.zeros_like(far), np.zeros(3))
    assert local_map.used == 0
