"""Encoders on emulated GPIO lines, and the motor with its wheels in the air."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from robot_app.calibrate.encoders import calibrate_encoders
from robot_app.calibrate.guide import CalibrationError
from robot_app.calibrate.motor import calibrate_motor
from robot_app.config import RobotConfig
from robot_app.drivers.base import DriveSetting, EncoderCount
from robot_app.drivers.config import EncoderConfig
from robot_app.drivers.encoder import QuadratureEncoders
from shared.runtime.clock import ManualClock
from tests.robot_app.calibrate.scripted import Action, Operator, values
from tools.simulator.devices.gpio import GpioChip

AS_WIRED = EncoderConfig(left_reversed=False, right_reversed=False)


def pushed(gpio: GpioChip, way_m: float, left: float = 1.0, right: float = -1.0) -> Action:
    """The right encoder is mirrored, as on the real car; `left` and `right` are shares of the true ticks."""

    def action(meanwhile: Callable[[], None]) -> None:
        edges = way_m / (math.tau * 0.04) * 80 * 4
        for _ in range(10):
            gpio.turn(5, 6, round(edges * left / 10))
            gpio.turn(16, 26, round(edges * right / 10))
            meanwhile()

    return action


def placed(_: Callable[[], None]) -> None:
    """Put to the first mark."""


def runs(*pushes: Action) -> list[Action]:
    return [action for push in pushes for action in (placed, push)]


def test_scale_and_directions_are_found(gpio: GpioChip, config: RobotConfig) -> None:
    encoders = QuadratureEncoders(AS_WIRED, ManualClock())
    operator = Operator(*runs(*(pushed(gpio, 2.0 * k, 0.97, -0.972) for k in (1.0, 1.001, 0.998))), numbers=(2.0,))
    changes = calibrate_encoders(encoders, config, operator)
    found = values(changes)
    assert found["distance_scale"] == pytest.approx(1 / 0.971, rel=0.003)
    assert (found["left_reversed"], found["right_reversed"]) == (False, True)
    assert changes[-1].certainty.startswith("± 0.00")


def test_a_wheel_that_counts_down_is_turned_round(gpio: GpioChip, config: RobotConfig) -> None:
    encoders = QuadratureEncoders(AS_WIRED, ManualClock())
    operator = Operator(*runs(*[pushed(gpio, 1.0, -1.0, 1.0)] * 3), numbers=(1.0,))
    found = values(calibrate_encoders(encoders, config, operator))
    assert (found["left_reversed"], found["right_reversed"]) == (True, False)


@pytest.mark.parametrize(
    ("pushes", "words"),
    [
        (((1.0, 1.0, 0.0),) * 3, "right encoder counted .* GPIO 16 and 26"),
        (((1.0, 1.0, -0.8),) * 3, "in a curve, or an encoder loses ticks"),
        (((1.0, 1.0, -1.0), (1.0, -1.0, -1.0), (1.0, 1.0, -1.0)), "left encoder counted up in one run and down"),
        (((1.0, 1.0, -1.0), (1.1, 1.0, -1.0), (1.0, 1.0, -1.0)), "runs differ too much"),
    ],
)
def test_pushes_that_prove_nothing_are_refused(
    gpio: GpioChip, config: RobotConfig, pushes: tuple[tuple[float, float, float], ...], words: str
) -> None:
    encoders = QuadratureEncoders(AS_WIRED, ManualClock())
    operator = Operator(*runs(*(pushed(gpio, *push) for push in pushes)), numbers=(1.0,))
    with pytest.raises(CalibrationError, match=words):
        calibrate_encoders(encoders, config, operator)


class Bench:
    """A motor with its wheels in the air: drive and encoders in one."""

    def __init__(self, ticks_per_duty: tuple[float, float]) -> None:
        self._rates = ticks_per_duty
        self._ticks = [0.0, 0.0]
        self._duty = 0.0
        self.most_duty = 0.0
        self.stops = 0

    def set(self, setting: DriveSetting) -> DriveSetting:
        self._duty = setting.duty
        self.most_duty = max(self.most_duty, abs(setting.duty))
        return setting

    def stop(self) -> None:
        self._duty = 0.0
        self.stops += 1

    def read(self, timeout_s: float) -> EncoderCount:
        for i, rate in enumerate(self._rates):
            self._ticks[i] += rate * self._duty
        return EncoderCount(0.0, int(self._ticks[0]), int(self._ticks[1]))

    def close(self) -> None:
        self.stop()


@pytest.mark.parametrize(("rate", "is_reversed"), [(20.0, False), (-20.0, True)])
def test_a_motor_that_turns_back_is_turned_round(config: RobotConfig, rate: float, is_reversed: bool) -> None:
    bench = Bench((rate, rate))
    found = values(calibrate_motor(bench, bench, config, Operator(), ManualClock()))
    assert found["motor_reversed"] is is_reversed
    assert bench.stops == 1
    assert bench.most_duty < 0.2


@pytest.mark.parametrize(
    ("rates", "words"), [((0.0, 0.0), "nothing turned up to duty 0.35"), ((20.0, -20.0), "calibrate encoders first")]
)
def test_a_motor_that_cannot_be_judged_is_stopped(config: RobotConfig, rates: tuple[float, float], words: str) -> None:
    bench = Bench(rates)
    with pytest.raises(CalibrationError, match=words):
        calibrate_motor(bench, bench, config, Operator(), ManualClock())
    assert bench.stops == 1


def test_nothing_turns_without_a_yes(config: RobotConfig) -> None:
    bench = Bench((20.0, 20.0))
    with pytest.raises(CalibrationError, match="nothing turned"):
        calibrate_motor(bench, bench, config, Operator(agrees=False), ManualClock())
    assert bench.most_duty == 0.0


def test_reversed_twice_is_not_reversed(config: RobotConfig) -> None:
    drive = replace(config.devices.drive, motor_reversed=True)
    turned = replace(config, devices=replace(config.devices, drive=drive))
    bench = Bench((-20.0, -20.0))
    assert values(calibrate_motor(bench, bench, turned, Operator(), ManualClock()))["motor_reversed"] is False
