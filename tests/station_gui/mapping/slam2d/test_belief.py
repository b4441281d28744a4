from __future__ import annotations

import math

import numpy as np
import pytest

from station_gui.mapping.slam2d.belief import needed_share, odometry_sigma, surprise
from station_gui.mapping.slam2d.config import MatchConfig
from station_gui.mapping.slam2d.matching.scan_matcher import ScanMatcher


def test_odometry_is_worth_less_the_farther_it_leads() -> None:
    still, driven = (odometry_sigma(MatchConfig(), np.array(motion)) for motion in ((0, 0, 0), (0.3, 0.4, -0.1)))
    config = MatchConfig()
    assert still.tolist() == [config.odometry_shift_m, config.odometry_shift_m, config.odometry_turn_rad]
    assert driven == pytest.approx(still + np.array([0.1, 0.1, 0.02]))


def test_surprise_counts_standard_deviations_in_the_robots_frame() -> None:
    predicted, sigma = np.array([1.0, 2.0, math.pi / 2]), np.array([0.1, 0.2, 0.1])
    assert surprise(predicted, np.array([1.0, 2.3, math.pi / 2]), sigma) == pytest.approx(3.0)
    assert surprise(predicted, np.array([1.0, 2.0, math.pi / 2 - math.tau + 0.5]), sigma) == pytest.approx(5.0)


def test_a_match_far_off_has_to_fit_better() -> None:
    assert needed_share(0.6, 0.9, 0.0) == 0.6
    assert needed_share(0.6, 0.9, 0.5) == pytest.approx(0.75)
    assert needed_share(0.6, 0.9, 7.0) == pytest.approx(0.9)


def test_a_robot_that_was_lost_for_longer_may_be_farther_off() -> None:
    matcher = ScanMatcher(MatchConfig(), 8, 0.05)
    assert not matcher.believes(0.8, 5.0, 0)
    assert matcher.believes(0.8, 5.0, 3)
    assert not matcher.believes(0.8, math.nan, 3)
