from __future__ import annotations

from pathlib import Path

import pytest

from robot_app.config import DEFAULT_PATH as ROBOT_TOML
from robot_app.config import load_config as load_robot
from shared.config import ConfigError, parse
from shared.link.es920lr.settings import conflicts
from shared.link.radio_config import RadioConfig, alone, beside_wifi, longest_word_s
from station_gui.config import load_config as load_station


def robot_with(tmp_path: Path, **lines: str) -> Path:
    text = ROBOT_TOML.read_text("utf-8")
    for key, value in lines.items():
        start = text.index(f"\n{key} = ") + 1
        text = text[:start] + f"{key} = {value}" + text[text.index("\n", start) :]
    path = tmp_path / "robot.toml"
    path.write_text(text, "utf-8")
    return path


def test_the_two_sides_as_they_come_agree() -> None:
    robot, station = load_robot(None).radio, load_station(None).radio
    for radio in range(2):
        ours, theirs = robot.settings(radio), station.settings(radio)
        assert (ours.own_id, ours.destination_id) == (theirs.destination_id, theirs.own_id)
        assert (ours.modulation, ours.channel, ours.pan_id) == (theirs.modulation, theirs.channel, theirs.pan_id)
        assert not conflicts(ours)
    assert robot.settings(0).channel != robot.settings(1).channel


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"ports": ["/dev/a", "/dev/a"]}, "radio: ports are one or two different ones"),
        ({"ports": ["a", "b", "c"]}, "radio: ports are one or two"),
        ({"ports": ["/dev/a:C"]}, "radio: ports: /dev/a:C: a transceiver has two radios, /dev/a:A and /dev/a:B"),
        ({"channels": [1, 1]}, "radio: channels are two different"),
        ({"channels": [1, 9]}, "radio: channel is 1 to 5 at 500 kHz"),
        ({"own_id": 2}, "radio: own_id and destination_id must differ"),
        ({"spreading_factor": 6}, "radio: spreading_factor is 7 to 12"),
        ({"bandwidth_hz": 62_500, "spreading_factor": 12}, "radio: .*the band allows 4 s"),
        ({"bandwith_hz": 1}, "did you mean radio.bandwidth_hz"),
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(table: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        parse(table, RadioConfig, "radio.")


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ({"use": '"radio"'}, r"robot\.toml: .*radio\.ports must name"),
        ({"use": '"both"', "ports": '["/dev/ttyUSB0"]'}, r"robot\.toml: .*link\.pairing must name"),
        (
            {"use": '"both"', "ports": '["a"]', "pairing": '"p"', "bandwidth_hz": "125_000"},
            r"safety\.command_silence_radio_s is 2, .*heard every 2\.1 s",
        ),
        ({"use": '"lora"'}, r"link\.use must be one of 'tcp', 'radio', 'both'"),
    ],
)
def test_a_robot_that_could_not_be_spoken_to_is_refused_by_file_and_key(
    tmp_path: Path, lines: dict[str, str], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        load_robot(robot_with(tmp_path, **lines))


def test_turns_follow_the_airtime() -> None:
    fast, slow = RadioConfig().settings(0), RadioConfig(bandwidth_hz=125_000, spreading_factor=9).settings(0)
    assert beside_wifi(fast).turn_s < alone(fast).turn_s < alone(slow).turn_s
    assert longest_word_s(fast) < 1.0 < longest_word_s(slow)
