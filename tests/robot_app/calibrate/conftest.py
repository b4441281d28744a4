from __future__ import annotations

import pytest

from robot_app.config import RobotConfig, load_config


@pytest.fixture
def config() -> RobotConfig:
    return load_config(None)
