from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation, ScanGeometry
from station_gui.mapping.scan import to_points

WALL_M = 2.0
GEOMETRY = ScanGeometry(-2.0, 4.0 / 200, 1e-4, 0.06, 10.0, Pose2(0.25, 0.0, 0.0))


def look_at_wall(speed_mps: float, yaw_rate_radps: float) -> Observation:
    """A wall at x = 2 m, swept by a scanner that moves with the robot."""
    ranges = np.full(201, np.nan, np.float32)
    for i, angle in enumerate(GEOMETRY.angles_rad(201)):
        late_s = i * GEOMETRY.beam_interval_s
        turned = yaw_rate_radps * late_s
        chord = speed_mps * late_s * float(np.sinc(turned / (2 * math.pi)))
        robot = Pose2(chord * math.cos(turned / 2), chord * math.sin(turned / 2), turned)
        scanner = robot @ GEOMETRY.robot_from_scanner
        forward = math.cos(scanner.theta_rad + angle)
        if forward > 0.3:
            ranges[i] = (WALL_M - scanner.x_m) / forward
    return Observation(0, 1.0, Pose2(), speed_mps, yaw_rate_radps, GEOMETRY, ranges, ObjectNetwork(), has_objects=False)


@pytest.mark.parametrize(("speed", "yaw_rate"), [(0.0, 0.0), (0.5, 0.0), (0.0, 2.0), (-0.3, -1.5), (0.4, 1.0)])
def test_a_straight_wall_stays_straight_however_the_robot_moves(speed: float, yaw_rate: float) -> None:
    points = to_points(look_at_wall(speed, yaw_rate)).points_m
    assert len(points) > 50
    np.testing.assert_allclose(points[:, 0], WALL_M, atol=1e-5)


def test_beams_out_of_range_are_left_out() -> None:
    seen = look_at_wall(0.0, 0.0)
    short = dataclasses.replace(seen, geometry=dataclasses.replace(GEOMETRY, range_max_m=1.8))
    assert 0 < len(to_points(short).points_m) < len(to_points(seen).points_m)


def test_the_scan_knows_where_the_scanner_stood() -> None:
    np.testing.assert_allclose(to_points(look_at_wall(0.0, 0.0)).origin_m, [0.25, 0.0])
