"""New values in a robot.toml that somebody has written comments into."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_app.calibrate.change import Change, edited, toml, write
from robot_app.config import DEFAULT_PATH, load_config
from shared.config import ConfigError

TEXT = DEFAULT_PATH.read_text("utf-8")


def change(key: str, after: float | bool | tuple[float, ...] | tuple[str, ...]) -> Change:
    return Change(key, 0.0, after, "")


def test_only_the_value_changes() -> None:
    text = edited(TEXT, [change("odometry.distance_scale", 1.0234), change("devices.encoders.left_reversed", True)])
    different = [(a, b) for a, b in zip(TEXT.splitlines(), text.splitlines(), strict=True) if a != b]
    assert different == [
        (
            "distance_scale = 1.0       # true distance over measured one",
            "distance_scale = 1.0234       # true distance over measured one",
        ),
        ("left_reversed = false", "left_reversed = true"),
    ]


def test_a_list_keeps_its_comment() -> None:
    text = edited(TEXT, [change("devices.imu.gyro_axes", ("-y", "x", "z"))])
    assert 'gyro_axes = ["-y", "x", "z"]           # of the chip, that point forward' in text


def test_what_is_not_there_yet_is_put_at_the_end_of_its_table() -> None:
    text = edited(
        TEXT, [change("devices.imu.gyro_bias_radps", (0.01, -0.02, 1e-5)), change("camera.roll_right_rad", 0.1)]
    )
    lines = text.splitlines()
    assert lines[lines.index("gyro_bias_radps = [0.01, -0.02, 1e-05]") - 1].startswith("acceleration_axes")
    assert lines[lines.index("roll_right_rad = 0.1") - 1].startswith("pitch_down_rad")
    assert edited(text, []) == text


def test_a_table_that_is_not_there_is_made() -> None:
    assert edited(TEXT, [change("devices.magnetometer.offset_ut", (1.0, 2.0, 3.0))]).endswith(
        "\n\n[devices.magnetometer]\noffset_ut = [1.0, 2.0, 3.0]\n"
    )


@pytest.mark.parametrize(
    "text",
    [
        TEXT.replace("[odometry]", "[odometry ]"),
        TEXT.replace("distance_scale = 1.0 ", "distance_scale = 1.0 # \n#"),
    ],
)
def test_what_cannot_be_edited_safely_is_refused_or_right(text: str, tmp_path: Path) -> None:
    """Never a file that says something else than was meant."""
    path = tmp_path / "robot.toml"
    path.write_text(text, "utf-8")
    try:
        after = edited(text, [change("odometry.distance_scale", 1.25)])
    except ConfigError:
        return
    path.write_text(after, "utf-8")
    assert load_config(path).odometry.distance_scale == 1.25


def test_a_value_that_the_robot_would_refuse_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(TEXT, "utf-8")
    with pytest.raises(ConfigError, match="must rise"):
        write(path, [change("devices.drive.servo_trim_us", 700.0)])
    assert path.read_text("utf-8") == TEXT
    assert list(tmp_path.iterdir()) == [path]


def test_the_file_before_is_kept_beside_it_with_its_rights(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(TEXT, "utf-8")
    path.chmod(0o640)
    backup = write(path, [change("odometry.distance_scale", 1.02)])
    assert backup.read_text("utf-8") == TEXT
    assert load_config(path).odometry.distance_scale == 1.02
    assert path.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize(
    ("value", "text"),
    [(True, "true"), (2.0, "2.0"), (1.23456789, "1.2346"), (1e-7, "1e-07"), (12345678.0, "1.2346e+07")],
)
def test_numbers_are_numbers_to_toml(value: float, text: str) -> None:
    assert toml(value) == text
