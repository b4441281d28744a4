from __future__ import annotations

from pathlib import Path

import pytest

from robot_app.drivers.base import DriveSetting
from robot_app.drivers.config import DriveConfig
from tools.evaluate.faults.wires import Reading, WiredChip, Wires, ride
from tools.simulator.devices.pwm import PwmFolder


def test_what_is_on_the_wires_is_read_as_a_setting(tmp_path: Path) -> None:
    config = DriveConfig()
    pwm, chip = PwmFolder(tmp_path), WiredChip(tmp_path, config)
    wires = Wires(tmp_path, config)
    (pwm.path / "pwm1" / "duty_cycle").write_text("10000\n", "ascii")
    (pwm.path / "pwm0" / "duty_cycle").write_text("1660000\n", "ascii")
    assert wires.read() == DriveSetting(0.0, 0.25)  # no line is high
    chip.set(config.reverse_line, 1)
    assert wires.read().duty == pytest.approx(-0.2)


def test_a_car_that_is_pushed_against_its_way_stands_sooner_than_one_that_is_cut() -> None:
    going = [Reading(0.0, DriveSetting(0.55, 0.0))]
    cut = ride([*going, Reading(0.9, DriveSetting(0.0, 0.0))], 0.85)
    pushed = ride([*going, Reading(0.9, DriveSetting(-0.4, 0.0)), Reading(0.97, DriveSetting(0.0, 0.0))], 0.85)
    assert cut.speed_mps == pushed.speed_mps == pytest.approx(0.31, abs=0.04)
    assert cut.driven_s == pytest.approx(0.05, abs=0.01)
    assert pushed.moved_s < cut.moved_s - 0.05
    assert 0.25 < cut.moved_s < 0.4
