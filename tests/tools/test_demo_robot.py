from __future__ import annotations

from pathlib import Path

from robot_app.config import load_config
from shared.link.pairing import read_pairing
from tools.demo_robot import configure


def test_the_demos_robot_is_the_one_that_comes_along_with_another_link(tmp_path: Path) -> None:
    config = load_config(configure(tmp_path, "both", ["/dev/pts/1", "/dev/pts/2"]))
    assert config.link.use == "both"
    assert config.radio.ports == ("/dev/pts/1", "/dev/pts/2")
    assert read_pairing(Path(config.link.pairing)).radio_key
    assert config.car == load_config(None).car
