from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from robot_app.drivers.base import DriveSetting, EncoderCount
from robot_app.safety.wheels import WheelFault, WheelWatch, WheelWatchConfig

WHEELBASE_M, TICK_M = 0.26, 0.00314


@pytest.fixture
def watch() -> WheelWatch:
    return WheelWatch(WheelWatchConfig(), WHEELBASE_M, TICK_M)


def counts(
    seconds: float, left_mps: float, right_mps: float, start: tuple[float, float] = (0.0, 0.0)
) -> Iterator[EncoderCount]:
    for i in range(round(seconds * 100)):
        left, right = (int((s + v * i / 100) / TICK_M) for s, v in zip(start, (left_mps, right_mps), strict=True))
        yield EncoderCount(i / 100, left, right)


def first_fault(
    watch: WheelWatch, run: Iterator[EncoderCount], yaw_rate: float, steering_rad: float = 0.0
) -> tuple[float, WheelFault] | None:
    for count in run:
        fault = watch.update(count, yaw_rate, 0.2, DriveSetting(0.4, steering_rad))
        if fault is not None:
            return count.stamp_s, fault
    return None


@pytest.mark.parametrize(
    ("left_mps", "right_mps", "fault"),
    [(0.0, 0.2, WheelFault.LEFT), (0.2, 0.0, WheelFault.RIGHT), (0.0, -0.2, WheelFault.LEFT)],
)
def test_an_encoder_that_does_not_count_is_named_within_25_mm(
    watch: WheelWatch, left_mps: float, right_mps: float, fault: WheelFault
) -> None:
    found = first_fault(watch, counts(1.0, left_mps, right_mps), 0.0)
    assert found is not None
    assert found[0] <= 0.14
    assert found[1] is fault


def test_a_car_that_stands_on_the_edge_of_a_tick_has_two_sound_encoders(watch: WheelWatch) -> None:
    still = DriveSetting(0.0, 0.0)
    assert not any(watch.update(EncoderCount(i / 100, 7, 40 + i % 2), 0.0, 0.0, still) for i in range(200))


def test_both_that_fall_silent_while_the_motor_pushes_are_noticed_within_a_tenth_of_a_second(watch: WheelWatch) -> None:
    found = first_fault(watch, counts(1.0, 0.0, 0.0), 0.0)
    assert found is not None
    assert found[0] <= 0.10
    assert found[1] is WheelFault.SILENT
    assert watch.speed_before_mps == 0.2


def test_what_is_braked_from_is_the_speed_before_the_silence_not_the_average_that_falls_meanwhile(
    watch: WheelWatch,
) -> None:
    fault, speed_mps = None, 0.3
    for i in range(12):
        fault = fault or watch.update(EncoderCount(i / 100, 9, 9), 0.0, speed_mps, DriveSetting(0.5, 0.0))
        speed_mps = 0.3 * (1 - i / 10)
    assert fault is WheelFault.SILENT
    assert watch.speed_before_mps == 0.3


@pytest.mark.parametrize("duty", [0.0, 0.1, -0.4])
def test_wheels_that_are_not_pushed_may_stand(watch: WheelWatch, duty: float) -> None:
    assert not any(watch.update(count, 0.0, 0.2, DriveSetting(duty, 0.0)) for count in counts(1.0, 0.0, 0.0))


@pytest.mark.parametrize("steering_rad", [-0.5, 0.0, 0.5])
def test_a_car_that_turns_as_it_is_steered_is_believed_though_a_tenth_of_it_is_slip(
    watch: WheelWatch, steering_rad: float
) -> None:
    yaw_rate = 0.2 * math.tan(steering_rad) / WHEELBASE_M
    assert first_fault(watch, counts(20.0, 0.22, 0.22), yaw_rate, steering_rad) is None


@pytest.mark.parametrize(("step_radps", "within_s"), [(0.2, 2.5), (0.5, 0.6), (-0.5, 0.6)])
def test_a_gyro_whose_bias_jumps_is_noticed_the_sooner_the_further(
    watch: WheelWatch, step_radps: float, within_s: float
) -> None:
    found = first_fault(watch, counts(5.0, 0.2, 0.2), step_radps)
    assert found is not None
    assert found[0] <= within_s
    assert found[1] is WheelFault.TURNING
