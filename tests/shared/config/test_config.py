from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import pytest

from shared.config import ConfigError, load


@dataclass(frozen=True)
class Link:
    port: int
    host: str = "0.0.0.0"
    mode: Literal["tcp", "lora"] = "tcp"


@dataclass(frozen=True)
class Settings:
    name: str
    link: Link
    rate_hz: float = 10.0
    corners: tuple[tuple[float, float], ...] = ()
    pair: tuple[int, str] = (1, "a")
    extra: Link = field(default_factory=lambda: Link(1))

    def __post_init__(self) -> None:
        if self.rate_hz <= 0:
            raise ValueError("rate_hz must be positive")


def settings(tmp_path: Path, text: str) -> Settings:
    path = tmp_path / "robot.toml"
    path.write_text(text)
    return load(path, Settings)


GOOD = 'name = "r"\nrate_hz = 5\ncorners = [[1, 2.5]]\n[link]\nport = 7\nmode = "lora"\n'


def test_a_good_file_becomes_its_dataclass(tmp_path: Path) -> None:
    assert settings(tmp_path, GOOD) == Settings("r", Link(7, mode="lora"), 5.0, ((1.0, 2.5),))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (GOOD + "prot = 1\n", r"unknown key link\.prot, did you mean link\.port\?"),
        ("nmae = 1\n" + GOOD, r"unknown key nmae, did you mean name\?"),
        (GOOD.replace("port = 7\n", ""), r"missing key link\.port"),
        (GOOD.replace("port = 7", "port = 7.5"), r"link\.port must be a whole number, not 7\.5"),
        (GOOD.replace("port = 7", "port = true"), r"link\.port must be a whole number, not True"),
        (GOOD.replace('"lora"', '"lara"'), r"link\.mode must be one of 'tcp', 'lora', not 'lara'"),
        (GOOD.replace("[[1, 2.5]]", "[[1]]"), r"corners\[0\] must have 2 values, not 1"),
        (GOOD.replace("[[1, 2.5]]", "3"), r"corners must be a list, not 3"),
        (GOOD.replace("= 5", "= nan"), r"rate_hz must be a number, not nan"),
        (GOOD.replace("= 5", "= -5"), r"rate_hz must be positive"),
        ('name = "r"\nlink = 3\n', r"link must be a table, not 3"),
        ("name = \n", r"is not valid TOML"),
    ],
)
def test_a_wrong_file_is_refused_by_name_in_one_line(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint) as caught:
        settings(tmp_path, text)
    assert str(tmp_path / "robot.toml") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"absent\.toml: cannot be read: No such file"):
        load(tmp_path / "absent.toml", Settings)


def test_what_is_wrong_with_the_file_as_a_whole_follows_its_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"robot\.toml: rate_hz must be positive$"):
        settings(tmp_path, GOOD.replace("rate_hz = 5", "rate_hz = 0"))
