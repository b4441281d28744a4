"""The three motors and encoders against a folder in the place of sysfs and scripted lines."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from robot_app.config import OMNI_PATH, OmniRobotConfig, load_any_config
from robot_app.drivers.base import DeviceError, DriveSetting, OmniSetting
from robot_app.drivers.config import OmniWheelsConfig
from robot_app.drivers.encoder import OmniEncoders
from robot_app.drivers.omni_drive import OmniDrive
from shared.runtime.clock import ManualClock
from tools.simulator.devices.gpio import GpioChip
from tools.simulator.devices.pwm import PwmFolder

PERIOD_NS = 1_000_000
LINES = ((23, 24), (17, 18), (22, 25))
ENCODERS = ((5, 6), (16, 26), (20, 21))


@pytest.fixture
def pwm(tmp_path: Path) -> PwmFolder:
    return PwmFolder(tmp_path, channels=3)


@pytest.fixture
def config(pwm: PwmFolder) -> OmniWheelsConfig:
    shipped = load_any_config(OMNI_PATH)
    assert isinstance(shipped, OmniRobotConfig)
    assert shipped.devices.omni is not None
    return replace(shipped.devices.omni, pwm_chip=str(pwm.path))


@pytest.fixture
def drive(config: OmniWheelsConfig, gpio: GpioChip) -> Iterator[OmniDrive]:
    drive = OmniDrive(config, ManualClock())
    yield drive
    drive.close()


def duties(pwm: PwmFolder) -> tuple[float, ...]:
    return tuple(pwm.value(k, "duty_cycle") / PERIOD_NS for k in range(3))


def directions(gpio: GpioChip) -> tuple[tuple[int, int], ...]:
    return tuple((gpio.levels.get(forward, 0), gpio.levels.get(reverse, 0)) for forward, reverse in LINES)


def test_it_opens_with_all_motors_cut(drive: OmniDrive, pwm: PwmFolder, gpio: GpioChip) -> None:
    assert [pwm.value(k, "period") for k in range(3)] == [PERIOD_NS] * 3
    assert [pwm.value(k, "enable") for k in range(3)] == [1] * 3
    assert duties(pwm) == (0.0, 0.0, 0.0)
    assert directions(gpio) == ((0, 0),) * 3


def test_each_motor_turns_its_own_way(drive: OmniDrive, pwm: PwmFolder, gpio: GpioChip) -> None:
    setting = OmniSetting((0.5, -0.25, 0.1))
    assert drive.set(setting) == setting
    assert duties(pwm) == (0.5, 0.25, 0.1)
    assert directions(gpio) == ((1, 0), (0, 1), (1, 0))


def test_a_bridge_changes_its_direction_without_current(
    drive: OmniDrive, pwm: PwmFolder, gpio: GpioChip, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive.set(OmniSetting((0.5, 0.5, 0.5)))
    seen: list[tuple[float, ...]] = []
    turn = gpio.set
    monkeypatch.setattr(gpio, "set", lambda *args: (seen.append(duties(pwm)), turn(*args)))
    drive.set(OmniSetting((-0.5, 0.5, 0.5)))
    assert {duty[0] for duty in seen} == {0.0}
    assert {duty[1:] for duty in seen} == {(0.5, 0.5)}


def test_limits_are_applied_and_returned(config: OmniWheelsConfig, gpio: GpioChip, pwm: PwmFolder) -> None:
    drive = OmniDrive(replace(config, max_duty=0.6), ManualClock())
    assert drive.set(OmniSetting((2.0, -2.0, 0.3))) == OmniSetting((0.6, -0.6, 0.3))
    assert duties(pwm) == (0.6, 0.6, 0.3)
    drive.close()


def test_a_reversed_motor_is_wired_the_other_way(config: OmniWheelsConfig, gpio: GpioChip) -> None:
    right, left, back = config.wheels
    wheels = (right, replace(left, motor_reversed=True), back)
    drive = OmniDrive(replace(config, wheels=wheels), ManualClock())
    drive.set(OmniSetting((0.5, 0.5, 0.5)))
    assert directions(gpio) == ((1, 0), (0, 1), (1, 0))
    drive.close()


def test_stopping_cuts_every_input_though_one_fails(drive: OmniDrive, pwm: PwmFolder, gpio: GpioChip) -> None:
    drive.set(OmniSetting((0.5, 0.5, 0.5)))
    gpio.is_broken = True
    drive.stop()
    assert duties(pwm) == (0.0, 0.0, 0.0)
    gpio.is_broken = False
    drive.stop()
    assert directions(gpio) == ((0, 0),) * 3


def test_an_unplugged_controller_is_a_device_error_and_still_stops(
    drive: OmniDrive, pwm: PwmFolder, gpio: GpioChip
) -> None:
    drive.set(OmniSetting((0.5, 0.5, 0.5)))
    gpio.is_broken = True
    with pytest.raises(DeviceError, match="cannot be set"):
        drive.set(OmniSetting((-0.5, 0.5, 0.5)))
    gpio.is_broken = False
    drive.stop()
    assert directions(gpio) == ((0, 0),) * 3


@pytest.mark.parametrize("setting", [OmniSetting((math.nan, 0.0, 0.0)), DriveSetting(0.5, 0.0)])
def test_what_is_no_setting_for_it_is_refused(
    drive: OmniDrive, setting: OmniSetting | DriveSetting, pwm: PwmFolder
) -> None:
    with pytest.raises(DeviceError, match="cannot apply"):
        drive.set(setting)
    assert duties(pwm) == (0.0, 0.0, 0.0)


def test_closing_twice_is_fine_and_what_is_closed_moves_nothing(drive: OmniDrive, pwm: PwmFolder) -> None:
    drive.set(OmniSetting((0.5, 0.5, 0.5)))
    drive.close()
    drive.close()
    assert [pwm.value(k, "enable") for k in range(3)] == [0] * 3
    with pytest.raises(DeviceError, match="closed"):
        drive.set(OmniSetting((0.0, 0.0, 0.0)))


def test_a_missing_controller_is_named(config: OmniWheelsConfig, gpio: GpioChip, pwm: PwmFolder) -> None:
    shutil.rmtree(pwm.path)
    with pytest.raises(DeviceError, match="front right motor"):
        OmniDrive(config, ManualClock())
    assert not gpio.requests


def test_motors_that_another_program_drives_are_left_alone(
    config: OmniWheelsConfig, gpio: GpioChip, pwm: PwmFolder
) -> None:
    gpio.used.add(LINES[2][1])
    (pwm.path / "pwm0" / "duty_cycle").write_text("12000\n", "ascii")
    with pytest.raises(DeviceError, match="drive direction at /dev/gpiochip0"):
        OmniDrive(config, ManualClock())
    assert pwm.value(0, "duty_cycle") == 12_000


def test_three_encoders_count_each_by_itself(config: OmniWheelsConfig, gpio: GpioChip) -> None:
    encoders = OmniEncoders(config, ManualClock())
    for (a, b), edges in zip(ENCODERS, (40, -80, 4), strict=True):
        gpio.turn(a, b, edges=edges)
    assert encoders.read(0.0).wheels == (10, -20, 1)
    encoders.close()
    with pytest.raises(DeviceError, match="closed"):
        encoders.read(0.0)


def test_the_encoders_of_the_wheels_that_stand_do_not_change(config: OmniWheelsConfig, gpio: GpioChip) -> None:
    right, left, back = config.wheels
    wheels = (right, left, replace(back, encoder_reversed=True))
    encoders = OmniEncoders(replace(config, wheels=wheels), ManualClock())
    gpio.turn(*ENCODERS[2], edges=-40)
    assert encoders.read(0.0).wheels == (0, 0, 10)
    assert encoders.impossible_edges == 0
    encoders.close()


def test_lines_used_twice_and_channels_used_twice_are_refused(config: OmniWheelsConfig) -> None:
    right, left, back = config.wheels
    with pytest.raises(ValueError, match="pwm_channel"):
        replace(config, wheels=(right, left, replace(back, pwm_channel=0)))
    devices = load_any_config(OMNI_PATH).devices
    with pytest.raises(ValueError, match="GPIO lines used twice: 23"):
        replace(devices, omni=replace(config, wheels=(right, left, replace(back, encoder_a=23))))
