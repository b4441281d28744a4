from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from robot_app.drivers.base import DriveSetting, EncoderCount, ImuSample
from robot_app.safety.bands import SafetyConfig
from robot_app.safety.gyro_jump import GyroJumpConfig, GyroJumpWatch
from robot_app.safety.motion import Alarm, MotionWatch
from shared.geometry.ackermann import CarGeometry
from shared.messages import StopReason

CAR = CarGeometry(0.26, 0.17, 0.04, 0.5, 0.305, 0.045, 0.2)
NOISE_RADPS = 0.002
STEP_RADPS = math.radians(15)


def noticed_s(rate_radps: Callable[[float], float], speed_mps: float, rng: np.random.Generator) -> float:
    """After how long from 1 s on; NaN where it is not. `rate_radps`: by the time."""
    watch = GyroJumpWatch(GyroJumpConfig())
    for i in range(300):
        now_s = i / 100
        if watch.update(now_s, rate_radps(now_s) + NOISE_RADPS * rng.standard_normal(), speed_mps):
            return now_s - 1.0
    return math.nan


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("speed_mps", [0.0, 0.3, 0.46])
def test_a_zero_that_jumps_is_noticed_within_a_tenth_of_a_second(
    sign: int, speed_mps: float, rng: np.random.Generator
) -> None:
    turning = 0.5  # in a bend as well as straight on
    assert noticed_s(lambda t: turning + sign * STEP_RADPS * (t >= 0.995), speed_mps, rng) <= 0.08


@pytest.mark.parametrize("speed_mps", [0.1, 0.32, 0.46])
def test_the_sharpest_turn_that_the_servo_can_begin_is_no_jump(speed_mps: float, rng: np.random.Generator) -> None:
    def turn(t: float) -> float:
        steering_rad = max(-0.5, min(0.5, 4.0 * (t - 1.0)))
        return speed_mps / 0.26 * math.tan(steering_rad)

    assert math.isnan(noticed_s(turn, speed_mps, rng))


def test_a_jolt_that_comes_back_is_no_jump(rng: np.random.Generator) -> None:
    assert math.isnan(noticed_s(lambda t: 2.0 * math.sin(2 * math.pi * 12 * (t - 1)) * (1 < t < 1.5), 0.3, rng))


def test_a_gap_says_nothing(rng: np.random.Generator) -> None:
    watch = GyroJumpWatch(GyroJumpConfig())
    assert not any(watch.update(i / 100 + 0.2 * (i >= 50), 0.6 * (i >= 50), 0.3) for i in range(100))


def test_samples_that_come_late_leave_the_car_longer_to_turn() -> None:
    watch = GyroJumpWatch(GyroJumpConfig())
    rates_radps = [min(1.0, max(0.0, 4.8 * (i * 0.03 - 0.5))) for i in range(100)]  # 0.32 m/s, the servo at its fastest
    assert not any(watch.update(i * 0.03, rate_radps, 0.32) for i, rate_radps in enumerate(rates_radps))


def alarms(rate_radps: Callable[[float], float], seconds: float) -> list[tuple[float, Alarm]]:
    """What a car at 0.3 m/s is stopped for, and when; the odometry has taken the gyro's zero out."""
    watch, found = MotionWatch(SafetyConfig(), CAR, 0.00314), []
    for i in range(round(100 * seconds)):
        now_s = i / 100
        imu = ImuSample(now_s, (0.0, 0.0, rate_radps(now_s)), (0.0, 0.0, 9.81))
        ticks = int(0.003 * i / 0.00314)
        count = EncoderCount(now_s, ticks, ticks)
        alarm = watch.update(now_s, count, imu, (0.3, 0.0), DriveSetting(0.5, 0.0))
        found += [(now_s, alarm)] if alarm is not None else []
    return found


def test_the_car_stands_for_it_and_learns_the_gyro_anew() -> None:
    ((at_s, alarm),) = alarms(lambda t: STEP_RADPS * (t > 0.995), 4.0)
    assert at_s <= 1.08
    assert (alarm.reason, alarm.ends_mission) == (StopReason.SENSORS_DISAGREE, False)


def test_a_zero_that_jumps_back_while_the_car_stands_for_it_is_learnt_with_it() -> None:
    assert len(alarms(lambda t: STEP_RADPS * (0.995 < t < 2.0), 4.0)) == 1


def test_settings_that_would_never_or_always_alarm_are_refused() -> None:
    for wrong in ({"jump_radps": 0.0}, {"stays_s": 2.0}, {"jump_per_mps": -1.0}):
        with pytest.raises(ValueError, match="must be"):
            GyroJumpConfig(**wrong)
