"""What the Raspberry Pi is told about the robot."""

from __future__ import annotations

import configparser
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from robot_app import run
from robot_app.config import load_config

SYSTEMD = Path(__file__).resolve().parents[2] / "systemd"
needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


def unit() -> configparser.RawConfigParser:
    parser = configparser.RawConfigParser(strict=False)
    parser.optionxform = str
    parser.read(SYSTEMD / "robot-app.service")
    return parser


def analyse(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["systemd-analyze", *words], capture_output=True, text=True, timeout=60, check=False)


@needs_systemd
def test_the_service_is_one_that_systemd_accepts_without_a_word(tmp_path: Path) -> None:
    text = (SYSTEMD / "robot-app.service").read_text(encoding="utf-8")
    there = re.sub(r"/opt/robot-app/\S+", "/bin/true", text)  # what is not installed on this machine
    (tmp_path / "robot-app.service").write_text(there, encoding="utf-8")
    found = analyse("verify", "--man=no", str(tmp_path / "robot-app.service"))
    assert (found.returncode, found.stdout + found.stderr) == (0, "")


@needs_systemd
def test_the_service_is_exposed_less_than_four() -> None:
    found = analyse("security", "--offline=true", "--threshold=39", str(SYSTEMD / "robot-app.service"))
    assert found.returncode == 0, found.stdout


def test_the_watchdog_waits_for_more_than_two_of_the_apps_words() -> None:
    assert float(unit()["Service"]["WatchdogSec"]) >= 3 * run._LOOK_AFTER_S


def test_a_wrong_configuration_is_not_tried_again() -> None:
    assert unit()["Service"]["RestartPreventExitStatus"] == "2"


def channel(chips: Path, chip: int, number: int) -> Path:
    folder = chips / f"pwmchip{chip}" / f"pwm{number}"
    folder.mkdir(parents=True)
    (folder / "duty_cycle").write_text("120000")
    (folder / "enable").write_text("1")
    return folder


def motors_off(sys: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["/bin/sh", str(SYSTEMD / "motors-off.sh")],
        env={"SYS": str(sys), "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        timeout=10,
        check=False,
    )


def test_motors_off_cuts_every_channel(tmp_path: Path) -> None:
    channels = [channel(tmp_path / "class" / "pwm", chip, number) for chip in (0, 2) for number in (0, 1)]
    assert motors_off(tmp_path).returncode == 0
    for folder in channels:
        assert (folder / "duty_cycle").read_text() == "0\n"
        assert (folder / "enable").read_text() == "0\n"


def test_motors_off_goes_on_after_a_channel_that_cannot_be_written(tmp_path: Path) -> None:
    broken, good = (channel(tmp_path / "class" / "pwm", 0, number) for number in (0, 1))
    (broken / "duty_cycle").unlink()
    (broken / "duty_cycle").mkdir()
    found = motors_off(tmp_path)
    assert found.returncode == 1
    assert str(broken / "duty_cycle") in found.stderr
    assert (good / "duty_cycle").read_text() == "0\n"


def test_a_channel_that_was_exported_and_never_set_up_keeps_the_app_from_nothing(tmp_path: Path) -> None:
    raw = channel(tmp_path / "class" / "pwm", 0, 1)
    (raw / "enable").write_text("0\n")
    (raw / "duty_cycle").unlink()
    (raw / "duty_cycle").mkdir()  # the kernel refuses any duty without a period
    found = motors_off(tmp_path)
    assert (found.returncode, found.stderr) == (0, "")


def test_motors_off_is_content_where_no_channel_was_ever_used(tmp_path: Path) -> None:
    assert motors_off(tmp_path).returncode == 0


def test_no_pin_has_two_uses() -> None:
    boot = (SYSTEMD / "robot-boot.txt").read_text(encoding="utf-8")
    uarts = {"uart2": (0, 1), "uart4": (8, 9)}
    pins = [int(pin) for pin in re.findall(r"pin2?=(\d+)", boot)]
    pins += [pin for name in re.findall(r"^dtoverlay=(uart\d)", boot, re.MULTILINE) for pin in uarts[name]]
    pins += [2, 3]  # I2C 1
    devices = load_config(None).devices
    encoders, drive = devices.encoders, devices.drive
    pins += [encoders.left_a, encoders.left_b, encoders.right_a, encoders.right_b]
    pins += [drive.forward_line, drive.reverse_line]
    assert len(pins) == len(set(pins)) == 15
