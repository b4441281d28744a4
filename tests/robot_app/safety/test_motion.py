from __future__ import annotations

import math

import pytest

from robot_app.drivers.base import DriveSetting, EncoderCount, ImuSample
from robot_app.safety.bands import SafetyConfig
from robot_app.safety.motion import STANDS_S, Alarm, MotionWatch
from robot_app.safety.tilt import TiltConfig, TiltWatch
from shared.geometry.ackermann import CarGeometry
from shared.messages import StopReason

CAR = CarGeometry(0.26, 0.17, 0.04, 0.5, 0.305, 0.045, 0.2)
TICK_M = 0.00314
PUSHING = DriveSetting(0.3, 0.0)


def imu(stamp_s: float, tilt_rad: float) -> ImuSample:
    return ImuSample(stamp_s, (0.0, 0.0, 0.0), (0.0, 9.81 * math.sin(tilt_rad), 9.81 * math.cos(tilt_rad)))


@pytest.fixture
def watch() -> MotionWatch:
    return MotionWatch(SafetyConfig(), CAR, TICK_M)


def alarms(watch: MotionWatch, start_s: float, seconds: float, gyro_radps: float) -> list[Alarm]:
    """Straight on at 0.2 m/s, while the gyro says `gyro_radps`."""
    found = []
    for i in range(round(start_s * 100), round((start_s + seconds) * 100)):
        ticks = int(0.002 * i / TICK_M)
        alarm = watch.update(i / 100, EncoderCount(i / 100, ticks, ticks), None, (0.2, gyro_radps), PUSHING)
        found += [alarm] if alarm is not None else []
    return found


def test_a_robot_on_its_side_is_noticed_in_a_tenth_of_a_second(watch: MotionWatch) -> None:
    assert watch.update(0.0, None, imu(0.0, 0.0), (0.2, 0.0), PUSHING) is None
    seen = [watch.update(i / 100, None, imu(i / 100, math.pi / 2), (0.2, 0.0), PUSHING) for i in range(1, 11)]
    assert seen[-1] is not None
    assert seen[-1].reason is StopReason.TILTED


def test_a_bump_and_hard_braking_are_no_tilt() -> None:
    tilt = TiltWatch(TiltConfig())
    assert not any(tilt.update(ImuSample(i / 100, (0, 0, 0), (-2.5, 0.0, 9.81))) for i in range(100))
    assert not tilt.update(ImuSample(1.0, (0, 0, 0), (20.0, 0.0, 9.81)))


def test_a_gyro_that_drifts_costs_a_rest_and_one_that_goes_on_ends_the_mission(watch: MotionWatch) -> None:
    first = alarms(watch, 0.0, 1.0, 0.5)
    assert [(a.reason, a.ends_mission) for a in first] == [(StopReason.SENSORS_DISAGREE, False)]
    assert alarms(watch, 1.0, STANDS_S - 1.0, 0.0) == []
    again = alarms(watch, STANDS_S, 2 * STANDS_S + 1.0, 0.5)
    assert again[-1].ends_mission


def test_what_was_long_ago_does_not_end_a_mission(watch: MotionWatch) -> None:
    for start_s in (0.0, 20.0, 40.0, 60.0):
        assert [a.ends_mission for a in alarms(watch, start_s, 1.0, 0.5)] == [False]


def test_encoders_that_fall_silent_tell_the_last_speed(watch: MotionWatch) -> None:
    alarm = None
    for i in range(12):
        alarm = alarm or watch.update(i / 100, EncoderCount(i / 100, 0, 0), None, (0.2, 0.0), PUSHING)
    assert alarm is not None
    assert (alarm.reason, alarm.speed_mps, alarm.ends_mission) == (StopReason.STALLED, 0.2, False)


def held(watch: MotionWatch, start_s: float) -> Alarm | None:
    """The wheels stand for 0.12 s while the motor pushes."""
    alarm = None
    for i in range(12):
        now_s = start_s + i / 100
        alarm = alarm or watch.update(now_s, EncoderCount(now_s, 0, 0), None, (0.2, 0.0), PUSHING)
    return alarm


def test_wheels_that_are_held_now_and_again_are_driven_on_and_the_second_time_soon_ends_the_mission(
    watch: MotionWatch,
) -> None:
    found = [held(watch, start_s) for start_s in (0.0, 4.0, 8.0, 9.0)]
    assert [alarm is not None and alarm.ends_mission for alarm in found] == [False, False, False, True]
