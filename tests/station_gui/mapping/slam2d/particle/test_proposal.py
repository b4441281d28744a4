from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.config import NormalConfig
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, to_lines
from station_gui.mapping.slam2d.particle.blocks.block_maps import BlockMapConfig, BlockMaps
from station_gui.mapping.slam2d.particle.matching import _kernels
from station_gui.mapping.slam2d.particle.proposal.proposer import ProposalConfig, Proposer

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]
_SIGMA = np.array([0.05, 0.05, 0.03])
_POSE = np.array([1.0, 2.0, 0.4])


def _lines(scan: PointScan) -> LineScan:
    return to_lines(scan.points_m, scan.origin_m, NormalConfig())


def _known_room(walls: FloatArray, make: ScanMaker) -> tuple[BlockMaps, LineScan]:
    """A map of ten scans, and one more scan of the same place."""
    maps = BlockMaps(BlockMapConfig(max_places=4000, max_blocks=8000), 1)
    rng = np.random.default_rng(2)
    for _ in range(10):
        maps.insert(0, _lines(make(walls, Pose2.from_array(_POSE), rng)), _POSE)
    return maps, _lines(make(walls, Pose2.from_array(_POSE), rng))


def _twin(points: FloatArray, surfels: FloatArray, pose: FloatArray, kernel_m: float) -> float:
    turn = np.array([[math.cos(pose[2]), -math.sin(pose[2])], [math.sin(pose[2]), math.cos(pose[2])]])
    away = points @ turn.T + pose[:2] - surfels[:, 1:3]
    along_normal = np.sum(away * surfels[:, 3:5], axis=1) ** 2
    r2 = np.where(surfels[:, 0] == 1.0, along_normal, np.sum(away**2, axis=1))
    k2 = kernel_m**2
    return float(np.where(surfels[:, 0] == 0.0, k2, k2 * r2 / (k2 + r2)).sum())


def _some_surfels(points: FloatArray, rng: np.random.Generator) -> FloatArray:
    angle = rng.uniform(0.0, math.tau, len(points))
    kind = rng.integers(0, 3, len(points)).astype(np.float64)
    return np.column_stack((kind, points + rng.normal(0.0, 0.05, points.shape), np.cos(angle), np.sin(angle)))


def test_the_cost_and_its_gradient_are_those_of_the_numpy_twin() -> None:
    rng = np.random.default_rng(8)
    points = rng.uniform(-3.0, 3.0, (80, 2))
    surfels, pose = _some_surfels(points, rng), np.array([0.02, -0.01, 0.005])
    hessian, gradient = np.zeros((3, 3)), np.zeros(3)

    assert _kernels.cost(points, surfels, pose, 0.1) == pytest.approx(_twin(points, surfels, pose, 0.1), rel=1e-12)
    _kernels.linearise(points, surfels, pose, 0.1, 0.1, 1.0, hessian, gradient)

    steps = 1e-6 * np.eye(3)
    slopes = [(_twin(points, surfels, pose + d, 0.1) - _twin(points, surfels, pose - d, 0.1)) / 2e-6 for d in steps]
    np.testing.assert_allclose(2.0 * gradient, slopes, rtol=1e-5, atol=1e-7)
    assert np.linalg.eigvalsh(hessian).min() > 0.0


def test_what_is_drawn_lies_round_the_match_as_widely_as_the_match_is_uncertain(
    lab: FloatArray, scan_from: ScanMaker
) -> None:
    maps, scan = _known_room(lab, scan_from)
    config = ProposalConfig(spread=1.0)
    proposer = Proposer(config, maps)
    start = _POSE + np.array([0.03, -0.02, 0.01])
    rng = np.random.default_rng(0)

    match = proposer.track(0, scan, start, _SIGMA)
    drawn = [proposer.propose(0, scan, start, start, _SIGMA, rng.standard_normal(3)) for _ in range(1500)]
    poses = np.array([one.pose for one in drawn])

    expected = np.sqrt(np.diag(np.linalg.inv(match.system / config.noise_m**2)))
    assert all(one.matched for one in drawn)
    np.testing.assert_allclose(match.pose, _POSE, atol=0.005)
    np.testing.assert_allclose(poses.mean(axis=0), match.pose, atol=0.003)
    assert (poses.std(axis=0) > 0.5 * expected).all()
    assert (poses.std(axis=0) < 1.5 * expected).all()


def test_a_particle_whose_map_fits_weighs_more(lab: FloatArray, scan_from: ScanMaker) -> None:
    maps, scan = _known_room(lab, scan_from)
    proposer = Proposer(ProposalConfig(), maps)
    far = _POSE + np.array([1.0, 0.0, 0.5])
    right = proposer.propose(0, scan, _POSE, _POSE, _SIGMA, np.zeros(3))
    wrong = proposer.propose(0, scan, far, far, _SIGMA / 100, np.zeros(3))
    assert right.log_weight > wrong.log_weight + 10.0


def test_without_a_map_the_odometry_is_drawn_from(lab: FloatArray, scan_from: ScanMaker) -> None:
    _, scan = _known_room(lab, scan_from)
    proposer = Proposer(ProposalConfig(), BlockMaps(BlockMapConfig(max_places=10, max_blocks=10), 1))
    proposed = proposer.propose(0, scan, _POSE, _POSE, _SIGMA, np.array([1.0, -1.0, 2.0]))
    assert not proposed.matched
    np.testing.assert_allclose(proposed.pose, _POSE + _SIGMA * [1.0, -1.0, 2.0])


def test_a_wrong_prediction_is_searched_for(lab: FloatArray, scan_from: ScanMaker) -> None:
    maps, scan = _known_room(lab, scan_from)
    match = Proposer(ProposalConfig(), maps).track(0, scan, _POSE + np.array([0.4, -0.3, 0.25]), 10 * _SIGMA)
    np.testing.assert_allclose(match.pose, _POSE, atol=0.01)


def test_a_draw_from_the_motion_model_is_taken_where_the_map_fits_better_there(
    lab: FloatArray, scan_from: ScanMaker
) -> None:
    maps, scan = _known_room(lab, scan_from)
    proposer = Proposer(ProposalConfig(), maps)
    far, near = _POSE + np.array([0.8, 0.6, 0.5]), _POSE + np.array([0.03, 0.02, 0.01])
    for start, drawn in ((far, near), (near, far)):
        proposed = proposer.propose(0, scan, start, start, _SIGMA, np.zeros(3), drawn)
        assert proposed.matched
        np.testing.assert_allclose(proposed.pose, _POSE, atol=0.01)


def test_the_best_match_may_mislead_where_odometry_is_vague_or_says_otherwise() -> None:
    proposer = Proposer(ProposalConfig(), BlockMaps(BlockMapConfig(max_places=10, max_blocks=10), 1))
    sigma = proposer.odometry_sigma(np.array([0.1, 0.0, 0.0]))
    assert not proposer.may_mislead(2.0 * sigma, sigma)
    assert proposer.may_mislead(4.0 * sigma, sigma)
    assert proposer.may_mislead(np.zeros(3), proposer.odometry_sigma(np.array([3.0, 0.0, 0.0])))
