from __future__ import annotations

import math
from typing import Any

import pytest

from robot_app.safety.bands import Band, BandWatch, SafetyConfig
from robot_app.safety.guard import Guard
from shared.messages import StopReason


@pytest.fixture
def guard() -> Guard:
    guard = Guard(SafetyConfig(), 0.2, 0.1, now_s=0.0)
    guard.heard(9.6)
    guard.heard(10.0)
    return guard


def reason(guard: Guard, scan_age_s: float = 0.05, odometry_age_s: float = 0.01, now_s: float = 10.1) -> StopReason:
    return guard.reason_to_stand(now_s, scan_age_s, odometry_age_s)


def test_nothing_speaks_against_moving_when_all_is_well(guard: Guard) -> None:
    assert reason(guard) is StopReason.NONE


def test_a_station_that_says_nothing_stops_the_car(guard: Guard) -> None:
    assert reason(guard, now_s=11.1) is StopReason.COMMAND_SILENCE
    guard.heard(11.1)
    assert reason(guard, now_s=11.3) is StopReason.COMMAND_SILENCE, "one word may be an old one"
    guard.heard(11.5)
    assert reason(guard, now_s=11.6) is StopReason.NONE


def test_a_change_to_a_path_that_allows_a_longer_silence_is_no_word(guard: Guard) -> None:
    assert reason(guard, now_s=11.1) is StopReason.COMMAND_SILENCE
    guard.silence_limit_s = 2.0
    assert reason(guard, now_s=11.2) is StopReason.COMMAND_SILENCE
    guard.heard(11.3)
    assert reason(guard, now_s=11.4) is StopReason.COMMAND_SILENCE, "one word may be an old one"
    guard.heard(11.7)
    assert reason(guard, now_s=11.8) is StopReason.NONE


@pytest.mark.parametrize(("scan", "odometry"), [(0.3, 0.01), (0.05, 0.2), (math.inf, 0.01)])
def test_stale_sensors_stop_the_car(guard: Guard, scan: float, odometry: float) -> None:
    assert reason(guard, scan, odometry) is StopReason.SENSOR_STALE


def test_a_hot_processor_stops_the_car_until_it_has_cooled_down(guard: Guard) -> None:
    guard.take_temperature(86.0)
    assert reason(guard) is StopReason.OVER_TEMPERATURE
    guard.take_temperature(80.0)
    assert reason(guard) is StopReason.OVER_TEMPERATURE
    guard.take_temperature(74.0)
    assert reason(guard) is StopReason.NONE


def test_a_battery_that_empties_warns_goes_home_and_stops(guard: Guard) -> None:
    guard.take_battery(6.15)
    assert (guard.warnings, guard.is_home_due) == (("battery low",), False)
    for _ in range(40):
        guard.take_battery(5.9)
    assert guard.is_home_due
    guard.sent_home()
    guard.take_battery(5.9)
    assert not guard.is_home_due, "it is sent once"
    assert reason(guard) is StopReason.NONE
    for _ in range(40):
        guard.take_battery(5.4)
    assert reason(guard) is StopReason.LOW_BATTERY


def test_a_voltage_that_sags_for_a_moment_is_no_empty_battery(guard: Guard) -> None:
    guard.take_battery(6.5)
    for _ in range(4):
        guard.take_battery(5.2)
    assert reason(guard) is StopReason.NONE


def test_another_battery_lets_the_car_stay_out(guard: Guard) -> None:
    for volts in (5.9, 7.4):
        for _ in range(40):
            guard.take_battery(volts)
    assert not guard.is_home_due


def test_a_warm_processor_is_spared_until_it_has_cooled_down(guard: Guard) -> None:
    guard.take_temperature(79.0)
    assert (guard.spares_processor, reason(guard)) == (True, StopReason.NONE)
    guard.take_temperature(74.0)
    assert guard.spares_processor
    guard.take_temperature(72.0)
    assert not guard.spares_processor


def test_what_holds_the_processor_back_is_told(guard: Guard) -> None:
    guard.take_temperature(50.0, ("under-voltage",))
    assert guard.warnings == ("processor: under-voltage",)


def test_an_empty_battery_stops_the_car(guard: Guard) -> None:
    guard.take_battery(5.5)
    assert reason(guard) is StopReason.LOW_BATTERY
    for _ in range(40):
        guard.take_battery(6.0)
    assert reason(guard) is StopReason.LOW_BATTERY
    for _ in range(40):
        guard.take_battery(6.3)
    assert reason(guard) is StopReason.NONE


def test_a_failed_task_stops_the_car_until_it_works_again(guard: Guard) -> None:
    guard.fault_began("scan", StopReason.DEVICE_FAULT, "scanner: no answer")
    assert reason(guard) is StopReason.DEVICE_FAULT
    assert guard.faults == ("scanner: no answer",)
    guard.fault_ended("scan")
    assert reason(guard, now_s=10.2) is StopReason.DEVICE_FAULT
    assert reason(guard, now_s=10.6) is StopReason.NONE


def test_what_is_waited_for_is_told_and_ends_the_mission_when_it_does_not_come(guard: Guard) -> None:
    assert reason(guard, scan_age_s=0.3) is StopReason.SENSOR_STALE
    assert guard.warnings == ("waiting for the scanner",)
    assert not guard.has_lost(11.0, is_running=True)
    assert guard.has_lost(12.2, is_running=True)
    assert not guard.has_lost(12.2, is_running=False)


def test_a_value_that_is_not_known_leaves_the_band_as_it_is() -> None:
    watch = BandWatch(Band(enter=85.0, leave=75.0))
    watch.update(90.0)
    assert watch.update(math.nan)


def test_a_band_without_hysteresis_is_refused() -> None:
    with pytest.raises(ValueError, match="differ"):
        Band(80.0, 80.0)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"over_temperature_c": Band(75.0, 85.0)}, "above"),
        ({"low_battery_v": Band(6.2, 5.6)}, "below"),
        ({"over_temperature_c": Band(1e9, 75.0)}, "never stop"),
        ({"over_temperature_c": Band(76.0, 70.0)}, "warm_c.enter, 78.0"),
        ({"low_battery_v": Band(0.0, 6.2)}, "at least 3.3"),
        ({"low_battery_v": Band(6.1, 6.2)}, "in this order"),
        ({"command_silence_s": 60.0}, "at most"),
        ({"resume_within_s": 0.0}, "above 0"),
        ({"min_beams": 0}, "at least"),
    ],
)
def test_settings_that_would_switch_safety_off_are_refused(settings: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        SafetyConfig(**settings)
