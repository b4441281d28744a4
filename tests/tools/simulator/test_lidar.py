from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.drivers.base import DriveSetting, RawScan
from shared.geometry.se2 import Pose2, interpolate
from tools.simulator.lidar import RollingScanner, noisy_ranges
from tools.simulator.scenario import Item, ScannerParameters, Scenario, Start
from tools.simulator.world import World

MakeRoom = Callable[..., Scenario]
Quiet = Callable[[Scenario], Scenario]


def distance_to_walls(pose: Pose2, angle_rad: float) -> float:
    """From a scanner pose in an empty room of 3.95 x 4.2 m along one beam."""
    heading = pose.theta_rad + angle_rad
    dx, dy = math.cos(heading), math.sin(heading)
    along_x = ((3.95 if dx > 0 else 0.0) - pose.x_m) / dx if dx else math.inf
    along_y = ((4.2 if dy > 0 else 0.0) - pose.y_m) / dy if dy else math.inf
    return min(along_x, along_y)


def next_scan(world: World, scanner: RollingScanner) -> RawScan:
    scanner.scans.take(0.0)
    while True:
        world.advance_to(world.time_s + 0.002)
        if (scan := scanner.scans.take(0.0)) is not None:
            return scan


def attached(scenario: Scenario, seed: int = 1) -> tuple[World, RollingScanner]:
    world = World(scenario, seed)
    scanner = RollingScanner(world)
    world.add_observer(scanner)
    return world, scanner


def expected(poses: list[Pose2], scanner: RollingScanner) -> NDArray[np.float64]:
    angles = scanner.geometry.angles_rad(len(poses))
    return np.array(
        [distance_to_walls(p @ scanner.geometry.robot_from_scanner, a) for p, a in zip(poses, angles, strict=True)]
    )


def test_the_geometry_is_that_of_the_ubg_04lx(room: MakeRoom) -> None:
    geometry = attached(room())[1].geometry
    assert math.degrees(geometry.first_angle_rad) == pytest.approx(-119.53, abs=0.01)
    assert math.degrees(geometry.first_angle_rad + 681 * geometry.step_rad) == pytest.approx(119.88, abs=0.01)
    assert geometry.beam_interval_s == pytest.approx(0.040 / 1024)


def test_ranges_at_rest_are_exact_to_the_millimetre(room: MakeRoom, quiet: Quiet) -> None:
    world, scanner = attached(quiet(room(start=Start((1.3, 1.7), 33.0))))
    scan = next_scan(world, scanner)
    truth = expected([world.room_from_robot()] * 682, scanner)
    seen = truth <= 3.999
    assert np.nanmax(np.abs(scan.ranges_m[seen] - truth[seen])) < 0.0012
    assert np.isnan(scan.ranges_m[truth > 4.001]).all()


def test_a_box_10_cm_high_is_seen(room: MakeRoom, quiet: Quiet) -> None:
    box = Item("low_box", (2.0, 2.0), (0.2, 0.4, 0.10))
    world, scanner = attached(quiet(room(box)))
    assert next_scan(world, scanner).ranges_m[340] == pytest.approx(1.9 - 1.25, abs=0.002)


def test_scans_come_at_25_hz_with_the_stamp_of_their_first_beam(room: MakeRoom) -> None:
    world, scanner = attached(room())
    first, second = next_scan(world, scanner), next_scan(world, scanner)
    assert second.stamp_s - first.stamp_s == pytest.approx(0.040)
    assert 0.0266 <= world.time_s - second.stamp_s <= 0.0287


def test_a_turning_robot_bends_its_scan(room: MakeRoom, quiet: Quiet) -> None:
    world, scanner = attached(quiet(room(start=Start((1.8, 1.5)))))
    world.set_drive(DriveSetting(1.0, 0.5))
    world.advance_to(1.0)
    path: list[tuple[float, Pose2]] = []

    class Recorder:
        def after_step(self) -> None:
            path.append((world.time_s, world.room_from_robot()))

    world.add_observer(Recorder())
    world.advance_to(1.05)
    scan = next_scan(world, scanner)
    beam_s = scan.stamp_s + np.arange(682) * scanner.geometry.beam_interval_s
    moving = [pose_at(path, float(t)) for t in beam_s]
    with_motion = expected(moving, scanner)
    without_motion = expected([moving[0]] * 682, scanner)
    usable = (with_motion < 3.9) & (without_motion < 3.9)
    assert np.nanpercentile(np.abs(scan.ranges_m - with_motion)[usable], 99) < 0.003
    assert np.nanmax(np.abs(scan.ranges_m - without_motion)[usable]) > 0.02


def pose_at(path: list[tuple[float, Pose2]], time_s: float) -> Pose2:
    for (t0, p0), (t1, p1) in itertools.pairwise(path):
        if t0 <= time_s <= t1:
            return interpolate(p0, p1, (time_s - t0) / (t1 - t0))
    raise AssertionError(time_s)


@pytest.mark.parametrize(("true_m", "sigma_m"), [(1.0, 0.004), (3.0, 0.007)])
def test_the_spread_is_that_of_the_recordings(true_m: float, sigma_m: float) -> None:
    ranges = np.full(20_000, true_m)
    parameters = ScannerParameters(bias_m=0.0)
    measured = noisy_ranges(ranges, np.full(20_000, 0.8), parameters, 0.0, np.random.default_rng(1))
    assert np.nanstd(measured) == pytest.approx(sigma_m, rel=0.03)
    assert np.nanmean(measured) == pytest.approx(true_m, abs=3e-4)
    assert np.isnan(measured).mean() == pytest.approx(0.005, abs=0.003)
    millimetres = measured[~np.isnan(measured)] * 1000
    assert np.abs(millimetres - np.round(millimetres)).max() < 1e-3


def test_beams_at_an_edge_are_mixed_or_lost_and_no_others_are() -> None:
    parameters = ScannerParameters(sigma_m=0.0, sigma_fraction=0.0, bias_m=0.0, dropout=0.0)
    ranges = np.where(np.arange(20_000) % 20 < 10, 1.0, 2.0)
    measured = noisy_ranges(ranges, np.full(20_000, 0.8), parameters, 0.0, np.random.default_rng(2))
    edge = np.isin(np.arange(20_000) % 10, (0, 9))
    assert np.array_equal(measured[~edge], ranges[~edge].astype(np.float32))
    assert np.isnan(measured[edge]).mean() == pytest.approx(0.25, abs=0.03)
    between = (measured[edge] > 1.005) & (measured[edge] < 1.995)
    assert between.mean() == pytest.approx(0.25, abs=0.03)


def test_dark_and_grazing_surfaces_far_away_are_lost() -> None:
    rng = np.random.default_rng(3)
    dark_far = noisy_ranges(np.full(1000, 3.8), np.full(1000, 0.05), ScannerParameters(), 0.0, rng)
    dark_near = noisy_ranges(np.full(1000, 1.0), np.full(1000, 0.05), ScannerParameters(), 0.0, rng)
    assert np.isnan(dark_far).all()
    assert np.isnan(dark_near).mean() < 0.02


def test_out_of_range_is_nan() -> None:
    ranges = np.array([0.03, 0.5, 4.5, 8.0])
    parameters = ScannerParameters(dropout=0.0, edge_lost=0.0, edge_mixed=0.0)
    measured = noisy_ranges(ranges, np.full(4, 0.8), parameters, 0.0, np.random.default_rng(4))
    assert np.isnan(measured).tolist() == [True, False, True, True]


def test_the_bias_stays_within_its_bound_and_depends_on_the_range_alone() -> None:
    ranges = np.repeat(np.linspace(0.2, 3.8, 40), 500)
    measured = noisy_ranges(ranges, np.full(len(ranges), 0.8), ScannerParameters(), 1.0, np.random.default_rng(5))
    bias_m = np.nanmean((measured - ranges).reshape(40, 500), axis=1)
    assert np.abs(bias_m).max() == pytest.approx(0.004, abs=0.001)
    assert np.abs(np.diff(bias_m)).max() < 0.003
