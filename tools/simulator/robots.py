"""Puts one of the robots into a scenario, with the configuration that it drives with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from robot_app.config import OMNI_PATH, AnyRobotConfig, RobotConfig, load_any_config
from shared.config import ConfigError
from tools.simulator.scenario import ROBOT_NAMES, RobotName, Scenario


def with_robot(scenario: Scenario, robot: RobotName | None, path: Path | None) -> tuple[Scenario, AnyRobotConfig]:
    """The robot of this name, or that of the file at `path`; a file of the other one is a `ConfigError`."""
    config = load_any_config(OMNI_PATH if path is None and robot == "omni" else path)
    found: RobotName = "car" if isinstance(config, RobotConfig) else "omni"
    if robot is not None and robot != found:
        raise ConfigError(f"{path}: is the configuration of the robot {found!r}, not of {robot!r}")
    return replace(scenario, robot=found), config


def with_robot_of(scenario: Scenario, name_or_path: str) -> tuple[Scenario, AnyRobotConfig]:
    """The same of a robot's name or of a file."""
    for name in ROBOT_NAMES:
        if name == name_or_path:
            return with_robot(scenario, name, None)
    return with_robot(scenario, None, Path(name_or_path))
