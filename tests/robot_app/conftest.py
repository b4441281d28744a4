from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.simulator.devices.gpio import GpioChip
from tools.simulator.devices.robot import EmulatedRobot


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[EmulatedRobot]:
    """Every device on its emulated wire, under the names of the libraries that the drivers load."""
    emulated = EmulatedRobot(tmp_path)
    for name, library in emulated.libraries.items():
        monkeypatch.setitem(sys.modules, name, library)
    yield emulated
    emulated.close()


@pytest.fixture
def gpio(monkeypatch: pytest.MonkeyPatch) -> GpioChip:
    """GPIO lines under the name of gpiod."""
    chip = GpioChip()
    library = chip.library()
    monkeypatch.setitem(sys.modules, "gpiod", library)
    monkeypatch.setitem(sys.modules, "gpiod.line", library.line)
    return chip


@pytest.fixture(autouse=True)
def _a_slow_test_is_no_app_that_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robot_app.drivers.guardian.guardian.SILENCE_S", 60.0)
