from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from robot_app.config import ControlConfig
from tools.evaluate.__main__ import main
from tools.evaluate.control.surfaces import surfaces_of


def test_a_surface_answers_as_its_controller_does() -> None:
    control = ControlConfig()
    steering, _, speed, *_ = surfaces_of(control)
    middle = steering.values()[40, 40]
    assert middle == pytest.approx(control.wall.rules.steering(0.0, 0.0), abs=1e-9)
    assert speed.values().max() == pytest.approx(control.wall.fast_mps)
    assert np.isfinite(speed.values()).all()


def test_all_surfaces_are_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "surfaces.png"
    monkeypatch.setattr("sys.argv", ["evaluate", "surfaces", "--picture", str(path)])
    assert main() == 0
    with Image.open(path) as picture:
        assert picture.size == (1290, 800)
