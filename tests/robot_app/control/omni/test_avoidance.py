from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_app.control.omni.avoidance import OmniAvoidance, OmniAvoidanceConfig, OmniWish, lanes
from shared.geometry.omni3 import Twist

RADIUS_M, MARGIN_M = 0.17, 0.03
NOTHING = np.zeros((0, 2))
AHEAD = OmniWish(Twist(0.4, 0.0, 0.0), 1.3)


def wall(x_m: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.column_stack((np.full(81, x_m), np.linspace(-1.0, 1.0, 81)))


@pytest.fixture
def avoidance() -> OmniAvoidance:
    return OmniAvoidance(RADIUS_M, OmniAvoidanceConfig())


coordinate = st.floats(-0.9, 0.9)


@given(st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=12), st.floats(-math.pi, math.pi))
def test_a_lane_is_free_as_far_as_a_disc_that_is_moved_along_it(
    points: list[tuple[float, float]], direction: float
) -> None:
    """Against stepping: nothing comes within the margin, but what was within it may stay as near as it was."""
    around = np.array(points)
    lane = lanes(around, np.array([direction]), RADIUS_M, MARGIN_M, 0.9)
    near = np.minimum(RADIUS_M + MARGIN_M, np.maximum(np.hypot(*around.T) - 0.004, 0.0))
    unit = np.array([math.cos(direction), math.sin(direction)])
    for way_m in np.linspace(0.0, max(float(lane.free_m[0]) - 1e-6, 0.0), 20):
        assert (np.hypot(*(around - way_m * unit).T) >= near - 1e-9).all()
    if lane.free_m[0] < 0.9:
        beyond = (float(lane.free_m[0]) + 1e-4) * unit
        assert (np.hypot(*(around - beyond).T) < near + 1e-9).any()


def test_in_the_open_it_goes_as_it_is_asked_to(avoidance: OmniAvoidance) -> None:
    avoided = avoidance.step(AHEAD, NOTHING, (0.0, 0.0))
    assert avoided.twist == AHEAD.twist
    assert avoided.clearance_ahead_m == pytest.approx(0.9)


def test_before_a_wall_it_is_as_slow_as_it_can_stop(avoidance: OmniAvoidance) -> None:
    straight = OmniWish(Twist(0.4, 0.0, 0.0))
    speeds = [avoidance.step(straight, wall(0.2 + gap), (0.0, 0.0)).twist.x_mps for gap in (0.5, 0.3, 0.1, 0.05)]
    assert speeds == sorted(speeds, reverse=True)
    for gap, speed in zip((0.5, 0.3, 0.1, 0.05), speeds, strict=True):
        assert speed * 0.2 + speed**2 / (2 * 0.8) <= gap
    assert avoidance.step(straight, wall(0.205), (0.0, 0.0)).is_blocked


def test_it_goes_round_what_stands_in_the_way(avoidance: OmniAvoidance) -> None:
    avoided = avoidance.step(AHEAD, np.array([[0.35, 0.02]]), (0.0, 0.0))
    assert not avoided.is_blocked
    assert avoided.twist.y_mps < -0.05
    assert avoided.twist.x_mps > 0.0


def test_what_is_blocked_still_turns(avoidance: OmniAvoidance) -> None:
    ring = 0.201 * np.array([(math.cos(a), math.sin(a)) for a in np.linspace(-math.pi, math.pi, 90)])
    avoided = avoidance.step(OmniWish(Twist(0.3, 0.1, 0.7), 1.3), ring, (0.0, 0.0))
    assert avoided.is_blocked
    assert avoided.twist == Twist(0.0, 0.0, 0.7)


def test_it_brakes_where_what_is_left_of_its_motion_leads_into_something(avoidance: OmniAvoidance) -> None:
    free = avoidance.step(OmniWish(Twist(0.0, 0.4, 0.0)), wall(0.25), (0.0, 0.0))
    rolling = avoidance.step(OmniWish(Twist(0.0, 0.4, 0.0)), wall(0.25), (0.4, 0.0))
    assert rolling.twist.y_mps < 0.5 * free.twist.y_mps


def test_away_from_what_is_too_near_it_may_go(avoidance: OmniAvoidance) -> None:
    avoided = avoidance.step(OmniWish(Twist(-0.2, 0.0, 0.0)), np.array([[0.18, 0.0]]), (0.0, 0.0))
    assert not avoided.is_blocked
    assert avoided.twist.x_mps < 0


def test_of_its_own_it_does_not_go_where_the_scanner_does_not_see(avoidance: OmniAvoidance) -> None:
    avoided = avoidance.step(OmniWish(Twist(0.0, 0.3, 0.0), 1.3), np.array([[0.0, 0.25]]), (0.0, 0.0))
    direction = math.atan2(avoided.twist.y_mps, avoided.twist.x_mps)
    assert abs(direction) <= OmniAvoidanceConfig().farthest_rad
