"""The commands as a user calls them: help, and one line with exit code 2 for what cannot be used."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from shared.protocol.codec import encode
from shared.recording import Recorder
from tests.shared import samples

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data"
BIN = Path(sys.executable).parent

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"the recorded data is not at {DATA}")


def call(command: str, *arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(BIN / command), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=ROOT,
        env={"PATH": "/usr/bin:/bin", "HOME": "/tmp"} | environment,
        check=False,
    )


def refusal(done: subprocess.CompletedProcess[str]) -> str:
    """The one line that a misuse gives."""
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    lines = [line for line in done.stderr.strip().splitlines() if not line.startswith(("usage:", " "))]
    assert len(lines) == 1, done.stderr
    return lines[0]


@pytest.mark.parametrize("command", ["simulator", "robot-app", "station-gui", "replay", "evaluate"])
def test_every_command_explains_itself(command: str) -> None:
    done = call(command, "--help")
    assert done.returncode == 0
    assert len(done.stdout) > 300


@pytest.mark.parametrize("evaluation", ["mission", "map", "kidnap", "slam", "urg", "extraction"])
def test_every_evaluation_explains_itself(evaluation: str) -> None:
    assert "--json" in call("evaluate", evaluation, "--help").stdout


@pytest.mark.parametrize(
    ("command", "arguments", "named"),
    [
        ("simulator", ["--port", "99999"], "'99999' is no port"),
        ("simulator", ["--port", "http"], "'http' is no port"),
        ("simulator", ["--scenario", "lap"], "no scenario 'lap'"),
        ("simulator", ["--config", "absent.toml"], "absent.toml"),
        ("station-gui", ["--connect", "robot"], "'robot' is no address"),
        ("station-gui", ["--connect", "127.0.0.1:0"], "nobody can be reached at port 0"),
        ("station-gui", ["--connect", "robot:99999"], "'99999' is no port"),
        ("station-gui", [], "there is no display"),
        ("replay", ["--carmen", "absent.clf", "--out", "/tmp/x"], "absent.clf: there is no such file"),
        ("evaluate", ["mission", "--scenario", "nowhere"], "no scenario 'nowhere'"),
        ("evaluate", ["mission", "--robot", "absent.toml"], "absent.toml"),
        ("evaluate", ["mission", "--seeds", "3-1"], "'3-1' is no range of seeds"),
        ("evaluate", ["mission", "--slip", "5"], "'5' is no share from 0 to 0.5"),
        ("evaluate", ["urg", "absent.dat"], "absent.dat: there is no such file"),
        ("evaluate", ["slam", "absent.clf", "--relations", "absent.gz"], "absent"),
    ],
)
def test_what_cannot_be_used_is_named_in_one_line(command: str, arguments: list[str], named: str) -> None:
    assert named in refusal(call(command, *arguments))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (('name = "car-1"\n', ""), "missing key name"),
        (("wheelbase_m", "wheelbase"), "unknown key car.wheelbase, did you mean car.wheelbase_m?"),
        (("port = 47100", 'port = "47100"'), "link.port must be a whole number, not '47100'"),
        (("port = 47100", "port = 470000"), "link: port must be from 0 to 65535, not 470000"),
        (("[link]", "[link"), "is not valid TOML"),
    ],
)
def test_a_wrong_robot_configuration_is_named_by_file_and_key(
    tmp_path: Path, change: tuple[str, str], named: str
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text((ROOT / "robot_app" / "robot.toml").read_text().replace(*change))
    line = refusal(call("simulator", "--config", path, "--port", "0"))
    assert named in line
    assert str(path) in line


def test_a_wrong_station_configuration_is_named_by_file_and_key(tmp_path: Path) -> None:
    path = tmp_path / "station.toml"
    path.write_text((ROOT / "station_gui" / "station.toml").read_text().replace("heartbeat_s", "hartbeat_s"))
    line = refusal(call("station-gui", "--config", path))
    assert f"{path}: unknown key session.hartbeat_s, did you mean session.heartbeat_s?" in line


def test_a_port_in_use_is_named(tmp_path: Path) -> None:

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"cannot listen on 127.0.0.1:{port}" in refusal(call("simulator", "--port", str(port)))


def test_a_recording_that_is_cut_short_is_replayed_up_to_there_and_named(tmp_path: Path) -> None:

    recorder = Recorder(tmp_path / "whole.mcap", {}, 0)
    rng = np.random.default_rng(1)
    for i in range(60):
        recorder.write(encode(samples.observation(rng, sequence=i)), i / 10)
    recorder.close()
    whole = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    done = call("replay", "--mission", tmp_path / "cut.mcap", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "cut.mcap: the recording is cut short" in done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert 0 < summary["observations"] < 60
    assert "cut short" in summary["truncated"]


def test_a_file_that_is_no_recording_is_named(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_text("no recording")
    assert "x.mcap: is no MCAP file" in refusal(call("replay", "--mission", tmp_path / "x.mcap", "--out", tmp_path))


@needs_data
def test_a_public_log_is_replayed_to_a_map(tmp_path: Path) -> None:
    done = call("replay", "--urg", DATA / "urg04lx" / "exp1.dat.gz", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "map2d.png").stat().st_size > 10_000
    assert (tmp_path / "out" / "trajectory.tum").read_text().count("\n") > 50
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["observations"] == 756


@needs_data
def test_a_log_that_is_cut_short_is_replayed_up_to_there_and_named(tmp_path: Path) -> None:
    whole = (DATA / "slam" / "intel.clf.bz2").read_bytes()
    (tmp_path / "cut.clf.bz2").write_bytes(whole[:400_000])
    done = call("replay", "--carmen", tmp_path / "cut.clf.bz2", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "cut.clf.bz2" in done.stderr
    assert "Traceback" not in done.stderr
    assert (tmp_path / "out" / "map2d.png").exists()
