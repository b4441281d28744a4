from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.simulator.devices.robot import EmulatedRobot


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[EmulatedRobot]:
    """Every device on its emulated wire, under the names of the libraries that the drivers load."""
    emulated = EmulatedRobot(tmp_path)
    for name, library in emulated.libraries.items():
        monkeypatch.setitem(sys.modules, name, library)
    yield emulated
    emulated.close()
