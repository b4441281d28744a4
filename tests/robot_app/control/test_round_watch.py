from __future__ import annotations

from robot_app.control.round_watch import RoundConfig, RoundWatch
from shared.geometry.se2 import Pose2


def test_a_round_that_gets_on_and_sees_new_floor_goes_on() -> None:
    watch = RoundWatch(RoundConfig())
    assert not any(watch.is_over(k, Pose2(0.2 * k, 0.0, 0.0), 0.2 * k, False, 0.02 * k) for k in range(60))


def test_a_round_that_is_blocked_for_two_seconds_is_over() -> None:
    watch = RoundWatch(RoundConfig())
    told = [watch.is_over(0.5 * k, Pose2(), 0.0, k > 1, 1.0) for k in range(8)]
    assert told == [False] * 6 + [True] * 2


def test_a_round_that_gets_nowhere_is_over() -> None:
    watch = RoundWatch(RoundConfig())
    told = [watch.is_over(k, Pose2(0.1 * (k % 2), 0.0, 0.0), 0.1 * k, False, 0.1 * k) for k in range(25)]
    assert told.index(True) == 13


def test_a_round_that_sees_nothing_new_is_over_after_six_metres() -> None:
    watch = RoundWatch(RoundConfig())
    told = [watch.is_over(k, Pose2(k, 0.0, 0.0), 0.5 * k, False, 5.0) for k in range(16)]
    assert told.index(True) == 13


def test_a_pause_is_no_time_without_getting_anywhere_but_what_was_driven_for_nothing_counts() -> None:
    watch = RoundWatch(RoundConfig())
    assert not any(watch.is_over(k, Pose2(k, 0.0, 0.0), 0.5 * k, False, 5.0) for k in range(11))
    watch.go_on()
    told = [watch.is_over(100.0 + k, Pose2(k, 0.0, 0.0), 0.5 * k, False, 5.0) for k in range(11, 15)]
    assert told == [False, False, True, True]
