"""The drive against a folder in the place of sysfs and scripted lines."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robot_app.drivers.ackermann_drive import AckermannDrive
from robot_app.drivers.base import DeviceError, DriveSetting
from robot_app.drivers.config import DriveConfig
from robot_app.drivers.guardian.guardian import Guardian, Will
from shared.geometry.ackermann import CarGeometry
from shared.runtime.clock import ManualClock
from tools.simulator.devices.gpio import GpioChip
from tools.simulator.devices.pwm import PwmFolder

SERVO, MOTOR = 0, 1
FORWARD, REVERSE = 23, 24


@pytest.fixture
def config(pwm: PwmFolder) -> DriveConfig:
    return DriveConfig(pwm_chip=str(pwm.path))


@pytest.fixture
def drive(config: DriveConfig, car: CarGeometry, gpio: GpioChip) -> Iterator[AckermannDrive]:
    drive = AckermannDrive(config, car, ManualClock())
    yield drive
    drive.close()


def lines(gpio: GpioChip) -> tuple[int, int]:
    return gpio.levels.get(FORWARD, 0), gpio.levels.get(REVERSE, 0)


def test_it_opens_standing_and_straight(drive: AckermannDrive, pwm: PwmFolder, gpio: GpioChip) -> None:
    assert (pwm.value(SERVO, "period"), pwm.value(MOTOR, "period")) == (20_000_000, 50_000)
    assert (pwm.value(SERVO, "enable"), pwm.value(MOTOR, "enable")) == (1, 1)
    assert pwm.pulse_us(SERVO) == 1500
    assert pwm.pulse_us(MOTOR) == 0
    assert lines(gpio) == (0, 0)


def test_forward_left_and_backward_right(drive: AckermannDrive, pwm: PwmFolder, gpio: GpioChip) -> None:
    assert drive.set(DriveSetting(0.5, 0.25)) == DriveSetting(0.5, 0.25)
    assert pwm.pulse_us(SERVO) == 1660
    assert (pwm.value(MOTOR, "duty_cycle"), lines(gpio)) == (25_000, (1, 0))
    assert drive.set(DriveSetting(-0.2, -0.25)) == DriveSetting(-0.2, -0.25)
    assert pwm.pulse_us(SERVO) == 1340
    assert (pwm.value(MOTOR, "duty_cycle"), lines(gpio)) == (10_000, (0, 1))


def test_what_the_guardian_is_to_do_is_to_push_against_the_way_as_long_as_the_car_rolls(
    config: DriveConfig, car: CarGeometry, gpio: GpioChip, monkeypatch: pytest.MonkeyPatch
) -> None:
    wills: list[Will | None] = []

    def keep(_: Guardian, will: Will | None = None) -> None:
        wills.append(will)

    monkeypatch.setattr(Guardian, "alive", keep)
    clock = ManualClock()
    with closing(AckermannDrive(config, car, clock)) as drive:
        for _ in range(40):
            clock.advance(0.02)
            drive.set(DriveSetting(0.5, 0.0))
        rolling, rest = wills[-1], DriveSetting(0.0, 0.0)
        assert rolling is not None
        assert rolling.levels == (False, True)
        assert rolling.push_ns == pytest.approx(1.2 * 0.5 * 50_000, rel=0.02)
        for _ in range(20):
            clock.advance(0.02)
            drive.set(rest)
        assert wills[-1] is not None
        assert wills[-1].push_ns < 0.05 * rolling.push_ns
        drive.set(DriveSetting(0.5, 0.0))
        drive.stop()
        assert wills[-1] is None


def test_lines_that_somebody_has_turned_round_are_set_again(drive: AckermannDrive, gpio: GpioChip) -> None:
    drive.set(DriveSetting(0.5, 0.0))
    gpio.set(FORWARD, 0)
    gpio.set(REVERSE, 1)
    drive.set(DriveSetting(0.5, 0.0))
    assert lines(gpio) == (1, 0)


def test_limits_are_applied_and_returned(config: DriveConfig, car: CarGeometry, gpio: GpioChip, pwm: PwmFolder) -> None:
    with closing(AckermannDrive(replace(config, max_duty=0.6, servo_trim_us=100.0), car, ManualClock())) as drive:
        applied = drive.set(DriveSetting(3.0, 2.0))
        assert applied.duty == 0.6
        assert applied.steering_rad == pytest.approx(300 / 640)  # the linkage ends before the car's steering does
        assert pwm.pulse_us(SERVO) == 1900
        assert drive.set(DriveSetting(-3.0, -2.0)) == DriveSetting(-0.6, -0.5)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(duty=st.floats(-2, 2), steering_rad=st.floats(-2, 2))
def test_the_servo_never_leaves_its_range(
    drive: AckermannDrive, pwm: PwmFolder, duty: float, steering_rad: float
) -> None:
    applied = drive.set(DriveSetting(duty, steering_rad))
    assert 1100 <= pwm.pulse_us(SERVO) <= 1900
    assert 0 <= pwm.value(MOTOR, "duty_cycle") <= 50_000
    assert abs(applied.duty) <= 1
    assert abs(applied.steering_rad) <= 0.5


def test_the_bridge_turns_round_without_current(
    drive: AckermannDrive, pwm: PwmFolder, gpio: GpioChip, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive.set(DriveSetting(0.8, 0.0))
    pulses: list[int] = []
    true_set = gpio.set

    def noting(line: int, level: int, lost: bool = False) -> None:
        pulses.append(pwm.value(MOTOR, "duty_cycle"))
        true_set(line, level, lost)

    monkeypatch.setattr(gpio, "set", noting)
    drive.set(DriveSetting(-0.8, 0.0))
    assert pulses == [0, 0]
    assert lines(gpio) == (0, 1)


def test_a_reversed_motor_is_wired_the_other_way(config: DriveConfig, car: CarGeometry, gpio: GpioChip) -> None:
    with closing(AckermannDrive(replace(config, motor_reversed=True), car, ManualClock())) as drive:
        drive.set(DriveSetting(0.5, 0.0))
        assert lines(gpio) == (0, 1)


def test_stopping_cuts_both_inputs_of_the_bridge(drive: AckermannDrive, pwm: PwmFolder, gpio: GpioChip) -> None:
    drive.set(DriveSetting(0.5, 0.1))
    drive.stop()
    assert (pwm.value(MOTOR, "duty_cycle"), lines(gpio)) == (0, (0, 0))
    drive.set(DriveSetting(0.5, 0.1))
    assert lines(gpio) == (1, 0)


@pytest.mark.parametrize("broken", ["lines", "pwm"])
def test_stopping_never_raises_cuts_what_it_can_and_says_once_what_it_cannot(
    drive: AckermannDrive,
    pwm: PwmFolder,
    gpio: GpioChip,
    broken: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    drive.set(DriveSetting(0.5, 0.1))
    if broken == "lines":
        gpio.is_broken = True
    else:
        monkeypatch.setattr("os.pwrite", _refuse)
    for _ in range(3):
        drive.stop()
    assert len(caplog.records) == 1
    if broken == "lines":
        assert pwm.value(MOTOR, "duty_cycle") == 0
    else:
        assert lines(gpio) == (0, 0)


def _refuse(*_: object) -> int:
    raise OSError(5, "Input/output error")


def test_closing_ends_standing_with_the_outputs_off(drive: AckermannDrive, pwm: PwmFolder, gpio: GpioChip) -> None:
    drive.set(DriveSetting(0.9, 0.1))
    drive.close()
    drive.close()
    drive.stop()
    assert (pwm.value(MOTOR, "duty_cycle"), pwm.value(SERVO, "duty_cycle")) == (0, 0)
    assert (pwm.value(MOTOR, "enable"), pwm.value(SERVO, "enable")) == (0, 0)
    assert not gpio.used
    with pytest.raises(DeviceError, match="closed"):
        drive.set(DriveSetting(0.0, 0.0))


@pytest.mark.parametrize("duty", [math.nan, math.inf])
def test_what_is_no_number_is_refused(drive: AckermannDrive, duty: float) -> None:
    with pytest.raises(DeviceError, match="cannot apply"):
        drive.set(DriveSetting(duty, 0.0))


def test_a_missing_overlay_is_named(car: CarGeometry, gpio: GpioChip, tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match="dtoverlay=pwm-2chan"):
        AckermannDrive(DriveConfig(pwm_chip=str(tmp_path / "none")), car, ManualClock())


def test_a_drive_that_another_program_has_is_left_alone(
    config: DriveConfig, car: CarGeometry, gpio: GpioChip, pwm: PwmFolder
) -> None:
    gpio.used.add(REVERSE)
    (pwm.path / "pwm1" / "duty_cycle").write_text("12000\n", "ascii")
    with pytest.raises(DeviceError, match="drive direction at /dev/gpiochip0, lines 23, 24"):
        AckermannDrive(config, car, ManualClock())
    assert pwm.value(MOTOR, "duty_cycle") == 12_000


def test_a_channel_that_never_appears_is_an_error(
    config: DriveConfig, car: CarGeometry, gpio: GpioChip, tmp_path: Path
) -> None:
    chip = tmp_path / "pwmchip7"
    chip.mkdir()
    clock = ManualClock()
    with pytest.raises(DeviceError, match="cannot be set up"):
        AckermannDrive(replace(config, pwm_chip=str(chip)), car, clock)
    assert (chip / "export").read_text() == "1\n"
    assert clock.now_s() == pytest.approx(1.0, abs=0.05)


def test_files_that_udev_opens_to_the_group_one_after_the_other_are_waited_for(
    config: DriveConfig, car: CarGeometry, gpio: GpioChip, pwm: PwmFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = ManualClock()
    opened_s = {"duty_cycle": 0.1, "enable": 0.3, "period": 0.2}
    monkeypatch.setattr("os.access", lambda path, _: clock.now_s() >= opened_s[path.name])
    with closing(AckermannDrive(config, car, clock)):
        assert clock.now_s() == pytest.approx(0.3, abs=0.05)
