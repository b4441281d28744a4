from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shared.geometry.se2 import Pose2, interpolate, wrap_angle

metres = st.floats(-100, 100)
angles = st.floats(-10, 10)
poses = st.builds(Pose2, metres, metres, angles)


def same(a: Pose2, b: Pose2) -> bool:
    return a.distance_m(b) < 1e-9 and abs(wrap_angle(a.theta_rad - b.theta_rad)) < 1e-9


@given(poses)
def test_a_pose_and_its_inverse_cancel(pose: Pose2) -> None:
    assert same(pose @ pose.inverse(), Pose2())
    assert same(pose.inverse() @ pose, Pose2())


@given(poses, poses, st.tuples(metres, metres))
def test_composition_moves_points_as_both_in_turn(a: Pose2, b: Pose2, point: tuple[float, float]) -> None:
    points = np.array([point])
    np.testing.assert_allclose((a @ b).apply(points), a.apply(b.apply(points)), atol=1e-9)


@given(angles)
def test_a_wrapped_angle_is_the_same_angle_within_half_a_turn(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


def test_a_quarter_turn_takes_forward_to_the_left() -> None:
    moved = Pose2(1.0, 2.0, math.pi / 2).apply(np.array([[1.0, 0.0]]))
    np.testing.assert_allclose(moved, [[1.0, 3.0]], atol=1e-12)


def test_heights_stay_as_they_are() -> None:
    moved = Pose2(1.0, 2.0, math.pi / 2).apply_3d(np.array([[1.0, 0.0, 0.7]]))
    np.testing.assert_allclose(moved, [[1.0, 3.0, 0.7]], atol=1e-12)


def test_interpolation_takes_the_short_way_round() -> None:
    middle = interpolate(Pose2(0, 0, 3.0), Pose2(2, 0, -3.0), 0.5)
    assert middle.x_m == 1.0
    assert abs(middle.theta_rad) == pytest.approx(math.pi)
