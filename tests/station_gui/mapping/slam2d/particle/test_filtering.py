"""What more than one particle is good for, shown with loop closing switched off."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.config import LoopConfig
from station_gui.mapping.slam2d.particle.blocks.block_maps import BlockMapConfig
from station_gui.mapping.slam2d.particle.closing.config import BendConfig
from station_gui.mapping.slam2d.particle.closing.loop_closer import ClosingConfig
from station_gui.mapping.slam2d.particle.config import ParticleSlamConfig
from station_gui.mapping.slam2d.particle.particle_slam import ParticleSlam

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]
_CLOSING_OFF = ClosingConfig(loops=LoopConfig(max_candidates=0), bend=BendConfig(reach_m=math.inf))


def _run(scans: list[PointScan], particles: int, seed: int) -> ParticleSlam:
    maps = BlockMapConfig(max_places=16_000, max_blocks=60_000)
    config = ParticleSlamConfig(particles=particles, maps=maps, closing=_CLOSING_OFF)
    slam = ParticleSlam(config, np.random.default_rng(seed))
    for scan in scans:
        slam.add(scan)
    slam.finish()
    return slam


def _errors_m(slam: ParticleSlam, way: list[Pose2]) -> FloatArray:
    truth = np.array([pose.as_array() for pose in way])
    return np.asarray(np.hypot(*(slam.scan_poses() - truth)[:, :2].T))


def _aisle() -> tuple[FloatArray, list[Pose2]]:
    """An aisle with the same pier every 1.5 m, and two others near its beginning; 20 m along it and backwards."""
    walls = [(-1, 0, 24, 0), (24, 2, -1, 2), (-1, 0, -1, 2), (24, 0, 24, 2), (5.2, 0, 5.2, 0.7), (4.4, 2, 4.4, 1.3)]
    for along in 1.5 * np.arange(15) + 0.75:
        walls += [(along, 0, along, 0.4), (along, 2, along, 1.6)]
    there = [Pose2(float(x), 1.0, 0.0) for x in np.arange(0.2, 20.0, 0.12)]
    return np.array(walls, np.float64), there + there[-2::-1]


def _dazzled_drive(make: ScanMaker) -> tuple[list[PointScan], list[Pose2]]:
    """4 m of the way back without a scan, of which the odometry leaves out half the distance of two piers."""
    walls, way = _aisle()
    rng, odom = np.random.default_rng(0), way[0]
    scans = [make(walls, way[0], rng)]
    dazzled = range(len(way) // 2 + 20, len(way) // 2 + 54)
    for k in range(1, len(way)):
        share = (1.0 + rng.normal(0.0, 0.02)) * (1.0 - 0.75 / 4.08 if k in dazzled else 1.0)
        odom = odom @ Pose2(share * (way[k].x_m - way[k - 1].x_m), 0.0, 0.0)
        scan = make(walls, way[k], rng, odom, 0.1 * k)
        scans.append(replace(scan, points_m=np.zeros((0, 2))) if k in dazzled else scan)
    return scans, way


def _ring(make: ScanMaker) -> tuple[list[PointScan], list[Pose2]]:
    """Once and a quarter round a corridor of 80 m with a few niches; the odometry turns and slips."""
    rng = np.random.default_rng(4)
    walls: list[tuple[float, ...]] = [(0, 0, 20, 0), (20, 0, 20, 20), (20, 20, 0, 20), (0, 20, 0, 0)]
    walls += [(2, 2, 18, 2), (18, 2, 18, 18), (18, 18, 2, 18), (2, 18, 2, 2)]
    for _ in range(10):
        a, b, c, d = rng.uniform(1.0, 19.0, 4)
        deep = float(rng.uniform(0.15, 0.4))
        walls += [(a, 0, a, deep), (20, b, 20 - deep, b), (c, 20, c, 20 - deep), (0, d, deep, d)]
    ahead, way = np.arange(1.0, 19.0, 0.12), []
    for number in range(5):
        corner = Pose2(10.0, 10.0, number * math.pi / 2)
        way += [corner @ Pose2(float(x) - 10.0, -9.0, 0.0) for x in ahead]
        way += [way[-1] @ Pose2(0.0, 0.0, float(turn)) for turn in np.linspace(0.0, math.pi / 2, 12)[1:-1]]
    odom, scans = way[0], [make(np.array(walls), way[0], rng)]
    for k in range(1, len(way)):
        step, slip = way[k - 1].inverse() @ way[k], 1.05 + rng.normal(0.0, 0.02)
        odom = odom @ Pose2(slip * step.x_m, slip * step.y_m, 1.02 * step.theta_rad)
        scans.append(make(np.array(walls), way[k], rng, odom, 0.1 * k))
    return scans, way


def test_thirty_particles_find_out_of_a_wrong_place_that_one_stays_in(scan_from: ScanMaker) -> None:
    scans, way = _dazzled_drive(scan_from)
    one = [float(_errors_m(_run(scans, 1, seed), way)[-20:].max()) for seed in range(3)]
    many = [float(_errors_m(_run(scans, 30, seed), way)[-20:].max()) for seed in range(3)]
    assert min(one) > 0.5
    assert max(many) < 0.05


def _rms_m(slam: ParticleSlam, way: list[Pose2]) -> float:
    return float(np.sqrt(np.mean(_errors_m(slam, way) ** 2)))


def test_thirty_particles_drift_less_than_one_that_takes_each_match_and_are_resampled_now_and_then(
    scan_from: ScanMaker,
) -> None:
    scans, way = _ring(scan_from)
    one_m = _rms_m(_run(scans, 1, 0), way)
    slams = [_run(scans, 30, seed) for seed in range(2)]
    assert np.mean([_rms_m(slam, way) for slam in slams]) < 0.9 * one_m
    for slam in slams:
        assert 5 <= slam.resamplings <= 60  # of 800 steps
        assert 0.5 < slam.effective_share < 0.95
