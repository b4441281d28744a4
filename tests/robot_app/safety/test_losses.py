from __future__ import annotations

from typing import Any

import pytest

from robot_app.safety.losses import LossConfig, LossWatch
from shared.messages import StopReason

NONE, STALE = StopReason.NONE, StopReason.SENSOR_STALE


@pytest.fixture
def watch() -> LossWatch:
    return LossWatch(LossConfig())


def step(watch: LossWatch, reason: StopReason, start_s: float, seconds: float) -> StopReason:
    stands = NONE
    for i in range(round(50 * seconds)):
        stands = watch.update(start_s + i / 50, reason)
    return stands


def test_a_loss_stands_at_once_and_until_all_was_well_for_a_while(watch: LossWatch) -> None:
    assert watch.update(0.0, STALE) is STALE
    assert step(watch, NONE, 0.02, 0.3) is STALE
    assert step(watch, NONE, 0.32, 0.1) is NONE
    assert not watch.ends_mission(0.42)


def test_three_brief_losses_in_a_row_are_waited_out(watch: LossWatch) -> None:
    for i in range(3):
        assert step(watch, STALE, 0.5 * i, 0.3) is STALE
        assert step(watch, NONE, 0.5 * i + 0.3, 0.2) is STALE
        assert not watch.ends_mission(0.5 * i + 0.5)
    assert step(watch, NONE, 1.5, 0.2) is NONE


def test_what_stays_away_ends_the_mission(watch: LossWatch) -> None:
    step(watch, STALE, 0.0, 1.9)
    assert not watch.ends_mission(1.9)
    step(watch, STALE, 1.9, 0.2)
    assert watch.ends_mission(2.1)


def test_what_comes_and_goes_for_long_ends_the_mission(watch: LossWatch) -> None:
    for i in range(21):
        step(watch, STALE, 0.5 * i, 0.3)
        step(watch, NONE, 0.5 * i + 0.3, 0.2)
    assert watch.ends_mission(10.5)


def test_a_computer_that_stood_still_has_lost_nothing(watch: LossWatch) -> None:
    watch.update(0.0, NONE)
    watch.update(60.0, STALE)
    assert not watch.ends_mission(60.0)


def test_a_loss_before_the_mission_does_not_count(watch: LossWatch) -> None:
    step(watch, STALE, 0.0, 30.0)
    watch.forgive(30.0)
    assert not watch.ends_mission(31.0)
    assert watch.ends_mission(32.1)


@pytest.mark.parametrize("settings", [{"steady_s": 0.0}, {"gone_s": 0.2}, {"unsteady_s": 1.0}, {"unsteady_s": 100.0}])
def test_settings_that_would_switch_it_off_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="steady_s"):
        LossConfig(**settings)
