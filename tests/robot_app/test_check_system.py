"""What `robot-app check` says of the computer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from robot_app import check_system as module
from robot_app.check_system import SystemPlaces, check_system
from robot_app.config import RobotConfig, load_config
from shared.link.pairing import write_new_pairing


@pytest.fixture
def config() -> RobotConfig:
    return load_config(None)


@pytest.fixture
def places(tmp_path: Path) -> SystemPlaces:
    return SystemPlaces(tmp_path / "state", tmp_path / "robot-app.service", tmp_path / "synchronized")


def words(config: RobotConfig, places: SystemPlaces, what: str) -> tuple[bool, str]:
    return next((f.found, f.words) for f in check_system(config, places) if f.device == what)


def test_an_installed_service_is_enough_for_real_time(
    config: RobotConfig, places: SystemPlaces, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "highest_priority", lambda: 0)
    assert words(config, places, "real time") == (
        False,
        "no FIFO priority, and no robot-app.service that gives it: sudo sh systemd/install.sh",
    )
    places.unit.touch()
    assert words(config, places, "real time") == (True, "none in this shell; robot-app.service has it")


def test_a_full_card_is_a_fault(config: RobotConfig, places: SystemPlaces, monkeypatch: pytest.MonkeyPatch) -> None:
    assert words(config, places, "card")[0]
    monkeypatch.setattr(module, "shutil", SimpleNamespace(disk_usage=lambda _: SimpleNamespace(free=50e6)))
    found, text = words(config, places, "card")
    assert not found
    assert text.startswith("50 MB free")


def test_a_clock_that_was_never_set_is_told_and_no_fault(
    config: RobotConfig, places: SystemPlaces, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "wall_clock_name", lambda: "19700101-000012")
    found, text = words(config, places, "clock")
    assert found
    assert "never set" in text
    places.synchronised.touch()
    assert words(config, places, "clock")[1].endswith("synchronised")


def test_the_pairing_file_is_read(config: RobotConfig, places: SystemPlaces, tmp_path: Path) -> None:
    assert "anybody on this network" in words(config, places, "pairing")[1]
    path = tmp_path / "pairing.pem"
    paired = replace(config, link=replace(config.link, pairing=str(path)))
    assert "no pairing file" in words(paired, places, "pairing")[1]
    write_new_pairing(path)
    assert words(paired, places, "pairing")[0]
    path.chmod(0o644)
    found, text = words(paired, places, "pairing")
    assert not found
    assert f"chmod 600 {path}" in text
