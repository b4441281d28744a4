from __future__ import annotations

import math

import pytest

from robot_app.drivers.base import OmniCount, OmniSetting
from robot_app.safety.bands import SafetyConfig
from robot_app.safety.motion import Alarm, MotionWatch
from robot_app.safety.omni_wheels import OmniWheelWatch, OmniWheelWatchConfig
from robot_app.safety.wheels import WheelFault
from shared.geometry.omni3 import OmniGeometry, Twist
from shared.messages import StopReason

OMNI = OmniGeometry(0.13, 0.04, 0.17)
TICK_M = math.tau * 0.04 / 320
FORWARD = Twist(0.3, 0.0, 0.0)


def told(
    twist: Twist, gyro_radps: float, dead: int | None = None, seconds: float = 2.0
) -> tuple[float, WheelFault | None]:
    """After how long which fault is found, when the encoder of the wheel `dead` counts nothing from 1 s on."""
    watch, ways = OmniWheelWatch(OmniWheelWatchConfig(), OMNI, TICK_M), [0.0, 0.0, 0.0]
    speeds = OMNI.wheels_mps(twist)
    duties = tuple(speed / 0.7 for speed in speeds)
    for k in range(round((1.0 + seconds) * 100)):
        for i in range(3):
            ways[i] += 0.0 if i == dead and k >= 100 else 0.01 * speeds[i]
        ticks = [math.floor(way / TICK_M) for way in ways]
        count = OmniCount(k / 100, (ticks[0], ticks[1], ticks[2]))
        rate = twist.turn_radps + (gyro_radps if k >= 100 else 0.0)
        fault = watch.update(count, rate, max(map(abs, speeds)), OmniSetting((duties[0], duties[1], duties[2])))
        if fault is not None:
            return k / 100 - 1.0, fault
    return math.inf, None


@pytest.mark.parametrize("twist", [FORWARD, Twist(0.0, 0.2, 0.0), Twist(0.0, 0.0, 1.2), Twist(0.2, -0.1, 0.8)])
def test_what_agrees_is_believed(twist: Twist) -> None:
    assert told(twist, 0.0) == (math.inf, None)
    assert told(twist, 0.04) == (math.inf, None)  # a bias


@pytest.mark.parametrize(("twist", "dead"), [(FORWARD, 0), (FORWARD, 1), (Twist(0.0, 0.3, 0.0), 2)])
def test_an_encoder_that_fails_is_noticed_before_the_robot_has_gone_6_cm(twist: Twist, dead: int) -> None:
    after_s, fault = told(twist, 0.0, dead)
    assert fault is WheelFault.LONE
    assert after_s * 0.3 < 0.06


def test_a_gyro_that_drifts_is_noticed() -> None:
    after_s, fault = told(FORWARD, 0.5)
    assert fault is WheelFault.GYRO
    assert after_s < 0.4


def test_a_dead_encoder_ends_the_mission_and_a_drifted_gyro_costs_a_rest() -> None:
    watch, alarms = MotionWatch(SafetyConfig(), OMNI, TICK_M), list[Alarm]()
    for k in range(300):
        rate = 0.5 if 100 <= k < 150 else 0.0
        way = 0.01 * k * 0.3 * math.sin(math.radians(60)) / TICK_M
        right = math.floor(min(way, 250 * 0.003 * math.sin(math.radians(60)) / TICK_M))  # stands still from 2.5 s on
        count = OmniCount(k / 100, (right, math.floor(-way), 0))
        alarm = watch.update(k / 100, count, None, (0.26, rate), OmniSetting((0.4, -0.4, 0.0)))
        alarms += [alarm] if alarm is not None else []
    assert [(a.reason, a.ends_mission) for a in alarms[:2]] == [
        (StopReason.SENSORS_DISAGREE, False),
        (StopReason.ENCODER_FAULT, True),
    ]
    assert alarms[1].speed_mps == pytest.approx(0.26)
