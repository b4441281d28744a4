"""Walls and revisits of maps that are known to be good or bad, since they are made here."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan
from tools.evaluate.urg import command as urg
from tools.evaluate.urg.cloud import Cloud, cloud_of, line_normals, range_noise_m, still_stretches
from tools.evaluate.urg.command import wall_figures
from tools.evaluate.urg.free_poses import free_poses
from tools.evaluate.urg.revisit import Revisit, revisit, visits
from tools.evaluate.urg.walls import Wall, find_walls

SIGMA_M = 0.005
ROOM_M = np.array([[-3.0, -2.0], [3.0, 2.0]])
Poses = NDArray[np.float64]


def scan_of_room(pose: Pose2, rng: np.random.Generator) -> PointScan:
    """240° of a room of 6 by 4 m with a wall that ends in its middle, by casting rays."""
    angle = np.radians(np.linspace(-120.0, 120.0, 341)) + pose.theta_rad
    direction = np.column_stack((np.cos(angle), np.sin(angle)))
    origin = np.array([pose.x_m, pose.y_m])
    with np.errstate(divide="ignore", invalid="ignore"):
        to_walls = np.where(direction > 0, ROOM_M[1] - origin, ROOM_M[0] - origin) / direction
        to_middle = (0.0 - origin[0]) / direction[:, 0]
    hits_middle = (to_middle > 0) & (origin[1] + to_middle * direction[:, 1] > 0.4)
    range_m = np.minimum(to_walls.min(axis=1), np.where(hits_middle, to_middle, np.inf))
    range_m = range_m + rng.normal(0.0, SIGMA_M, len(range_m))
    points = pose.inverse().apply(origin + range_m[:, None] * direction)
    return PointScan(0.0, pose, np.zeros(2), points)


def way_round() -> list[Pose2]:
    """From the left through the passage to the right and back, looking forward."""
    angle = np.linspace(0.0, math.tau, 60)
    x, y = -1.8 * np.cos(angle), -0.9 + 0.5 * np.sin(angle)
    heading = np.arctan2(np.gradient(y), np.gradient(x))
    return [Pose2(*row) for row in np.column_stack((x, y, heading)).tolist()]


def mapped(rng: np.random.Generator, believed: list[Pose2] | None = None) -> tuple[Cloud, Poses]:
    """The cloud of a map that took the robot to be where `believed` says."""
    scans = [scan_of_room(pose, rng) for pose in way_round()]
    poses = np.array([pose.as_array() for pose in believed or way_round()])
    return cloud_of(scans, poses, 4.0), poses


def test_a_true_map_has_straight_single_walls_as_thick_as_the_scanners_noise(rng: np.random.Generator) -> None:
    walls = find_walls(mapped(rng)[0])
    figures = wall_figures(walls)
    assert figures.wall_length_m > 18.0  # both sides of the middle wall and most of the outer ones
    assert figures.wall_thickness_m == pytest.approx(SIGMA_M, rel=0.4)
    assert figures.wall_scanner_m == pytest.approx(SIGMA_M, rel=0.4)
    assert figures.wall_bend_m < 0.01
    assert figures.double_walls == 0


def test_a_map_that_drifts_has_double_walls(rng: np.random.Generator) -> None:
    half = len(way_round()) // 2
    believed = [p if k < half else Pose2(0.0, 0.15, 0.0) @ p for k, p in enumerate(way_round())]
    figures = wall_figures(find_walls(mapped(rng, believed)[0]))
    assert figures.double_walls >= 1
    assert figures.double_length_m > 1.0


def test_doubles_of_a_bad_trajectory_go_when_every_scan_may_move(rng: np.random.Generator) -> None:
    ways = way_round()[::2]
    scans = [scan_of_room(pose, rng) for pose in ways]
    drift = Pose2(0.0, 0.15, 0.0)
    astray = np.array([(p if k < len(ways) // 2 else drift @ p).as_array() for k, p in enumerate(ways)])
    free = free_poses(scans, astray, 4.0)
    assert wall_figures(find_walls(cloud_of(scans, astray, 4.0))).double_length_m > 1.0
    figures = wall_figures(find_walls(cloud_of(scans, free, 4.0)))
    assert figures.double_length_m == 0.0
    assert figures.wall_thickness_m == pytest.approx(SIGMA_M, rel=0.4)


def test_poses_that_tremble_make_walls_thicker_than_the_scanner_does(rng: np.random.Generator) -> None:
    believed = [Pose2(*rng.normal(0.0, 0.02, 2), 0.0) @ p for p in way_round()]
    figures = wall_figures(find_walls(mapped(rng, believed)[0]))
    assert figures.wall_thickness_m > 2.5 * figures.wall_scanner_m
    assert figures.wall_scanner_m == pytest.approx(SIGMA_M, rel=0.5)


def test_two_walls_that_one_scan_sees_at_once_are_two_walls(rng: np.random.Generator) -> None:
    """A low board before a wall: both are seen in every scan."""
    x = np.tile(np.arange(0.0, 2.0, 0.02), 40)
    y = np.where(np.arange(len(x)) % 2 == 0, 0.0, 0.15) + rng.normal(0.0, SIGMA_M, len(x))
    scan = np.repeat(np.arange(40), 100)
    normals = np.tile([0.0, 1.0], (len(x), 1))
    points, origins = np.column_stack((x, y)), np.tile([1.0, 2.0], (len(x), 1))
    assert find_walls(Cloud(points, normals, scan, origins))[0].double_m == 0.0
    by_turns = np.where(np.arange(len(x)) % 2 == 0, scan, scan + 40)
    assert find_walls(Cloud(points, normals, by_turns, origins))[0].double_m > 1.0


def wall_seen(
    rng: np.random.Generator, scan: int, wall_from_scanned: Pose2, bow_m: float = 0.0, scanner_y_m: float = 2.0
) -> Cloud:
    """5 m of a wall along x that faces +y, by 40 scans, moved as a whole; `bow_m`: how far its middle stands out."""
    x = rng.uniform(0.0, 5.0, 3000)
    y = 4 * bow_m * (x / 5) * (1 - x / 5) + rng.normal(0.0, SIGMA_M, len(x))
    slope = 4 * bow_m / 5 * (1 - 2 * x / 5)
    normals = np.column_stack((-slope, np.ones(len(x)))) / np.hypot(slope, 1)[:, None]
    number = rng.integers(0, 40, len(x))
    origins = np.column_stack((0.5 + 0.1 * number, np.full(len(x), scanner_y_m)))
    turn = Pose2(0.0, 0.0, wall_from_scanned.theta_rad)
    return Cloud(
        wall_from_scanned.apply(np.column_stack((x, y))), turn.apply(normals), scan + number,
        wall_from_scanned.apply(origins),
    )  # fmt: skip


def both(one: Cloud, other: Cloud) -> Cloud:
    return Cloud(
        np.concatenate((one.points_m, other.points_m)), np.concatenate((one.normals, other.normals)),
        np.concatenate((one.scan, other.scan)), np.concatenate((one.origins_m, other.origins_m)),
    )  # fmt: skip


@pytest.mark.parametrize("apart_m", [0.1, 0.25, 0.32, 0.4, 0.6, 0.9])
def test_a_wall_that_is_mapped_twice_is_double_however_far_its_copy(rng: np.random.Generator, apart_m: float) -> None:
    walls = find_walls(both(wall_seen(rng, 0, Pose2()), wall_seen(rng, 100, Pose2(0.0, -apart_m, 0.0))))
    assert sum(wall.double_m for wall in walls) == pytest.approx(5.0, abs=1.0)


def test_a_wall_that_is_mapped_twice_is_double_when_its_copy_is_turned(rng: np.random.Generator) -> None:
    turned = Pose2(0.0, -0.05, math.radians(-18.0))
    walls = find_walls(both(wall_seen(rng, 0, Pose2()), wall_seen(rng, 100, turned)))
    assert sum(wall.double_m for wall in walls) > 1.5


def test_the_wall_of_an_aisle_behind_a_partition_is_a_wall_of_its_own(rng: np.random.Generator) -> None:
    partition, wall = wall_seen(rng, 0, Pose2()), wall_seen(rng, 100, Pose2(0.0, -0.8, 0.0), scanner_y_m=0.4)
    walls = find_walls(both(partition, wall))
    assert len(walls) == 2
    assert [found.double_m for found in walls] == [0.0, 0.0]


@pytest.mark.parametrize(("bow_m", "bend_m"), [(0.0, 0.0), (0.05, 0.033), (0.1, 0.067), (0.2, 0.133), (0.4, 0.267)])
def test_a_bent_wall_is_followed_as_far_as_it_goes(rng: np.random.Generator, bow_m: float, bend_m: float) -> None:
    """A parabola is farthest from its straight line at its ends, by two thirds of how far its middle stands out."""
    walls = find_walls(wall_seen(rng, 0, Pose2(), bow_m))
    assert max(wall.bend_m for wall in walls) == pytest.approx(bend_m, rel=0.15, abs=0.006)


def test_no_point_gives_no_wall_and_figures_that_are_no_numbers() -> None:
    empty = Cloud(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros((0, 2)))
    walls: list[Wall] = find_walls(empty)
    assert walls == []
    assert math.isnan(wall_figures(walls).wall_thickness_m)


def test_back_at_the_start_a_true_map_lies_on_itself(rng: np.random.Generator) -> None:
    found = revisit(*mapped(rng))
    assert isinstance(found, Revisit)
    assert found.overlap > 0.8
    assert found.median_m < 2 * SIGMA_M
    assert found.offset_m < 0.005
    assert abs(found.offset_deg) < 0.1


def test_the_offset_of_a_map_that_drifted_is_found(rng: np.random.Generator) -> None:
    drift = Pose2(0.16, -0.11, math.radians(4.0))
    ways = way_round()
    middle = Pose2(ways[-1].x_m, ways[-1].y_m, 0.0)
    moved = middle @ drift @ middle.inverse()
    found = revisit(*mapped(rng, [p if k < 30 else moved @ p for k, p in enumerate(ways)]))
    assert found is not None
    assert found.offset_m == pytest.approx(math.hypot(0.16, 0.11), abs=0.04)
    assert found.offset_deg == pytest.approx(-4.0, abs=0.3)
    assert found.aligned_median_m < 2 * SIGMA_M < found.median_m


def test_a_map_that_misses_its_own_start_by_metres_is_compared_all_the_same(rng: np.random.Generator) -> None:
    """Its poses say that the robot never came back; the marks know better."""
    ways = way_round()
    astray = Pose2(2.0, 3.0, 2.0)
    cloud, poses = mapped(rng, [p if k < 30 else astray @ p for k, p in enumerate(ways)])
    assert revisit(cloud, poses) is None
    found = revisit(cloud, poses, ((0, 5), (55, 59)))
    assert found is not None
    assert math.isnan(found.median_m)
    expected = astray.apply(np.array([[ways[-1].x_m, ways[-1].y_m]]))[0] - [ways[-1].x_m, ways[-1].y_m]
    assert found.offset_m == pytest.approx(float(np.hypot(*expected)), abs=0.15)
    assert found.offset_deg == pytest.approx(-math.degrees(2.0), abs=1.0)
    assert found.aligned_median_m < 2 * SIGMA_M
    assert revisit(cloud, poses, ((0, 5), (55, 60))) is None  # the log ends before


def test_a_robot_that_does_not_come_back_has_no_revisit() -> None:
    out = np.column_stack((np.linspace(0.0, 9.0, 50), np.zeros(50), np.zeros(50)))
    assert visits(out) is None
    assert visits(out[:3]) is None
    first, last = visits(np.concatenate((out, out[::-1]))) or (np.zeros(0), np.zeros(0))
    assert first[0] == 0
    assert last[-1] == 99
    assert last[0] > 50


def test_a_points_direction_is_that_of_its_neighbours_on_the_same_surface() -> None:
    corner = np.concatenate(
        (np.column_stack((np.full(20, 2.0), np.linspace(-0.5, 0.5, 20))), [[9.0, 9.0]], np.full((3, 2), 5.0))
    )
    normals = line_normals(corner, np.zeros(2))
    assert normals[10] == pytest.approx([-1.0, 0.0], abs=1e-9)
    assert np.isnan(normals[20:]).all()


def test_noise_is_measured_while_the_robot_stands(rng: np.random.Generator) -> None:
    odometry = np.zeros((40, 3))
    odometry[20:, 0] = 0.1 * np.arange(20)
    assert still_stretches(odometry) == [slice(0, 21)]
    ranges = (2.0 + rng.normal(0.0, 0.004, (40, 50))).astype(np.float32)
    ranges[3, 7] = np.nan
    assert range_noise_m(ranges, odometry) == pytest.approx(0.004, rel=0.15)
    assert math.isnan(range_noise_m(ranges, odometry + np.arange(40)[:, None]))


_DATA = Path(__file__).resolve().parents[4] / ".." / "shared" / "data" / "urg04lx"


@pytest.mark.skipif(not _DATA.is_dir(), reason="the folder shared/data is not there")
def test_a_recorded_log_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    urg.add_arguments(parser)
    assert urg.run(parser.parse_args([str(_DATA / "test_lab2.dat.gz"), "--json"])) == 2  # its last line is cut
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])["logs"]["test_lab2"]
    assert figures["scans"] == 404
    assert figures["wall_length_m"] > 15.0
    assert 0.003 < figures["scanner_noise_m"] < 0.008
    assert figures["revisit_overlap"] > 0.1
