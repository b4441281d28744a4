"""`replay --save-map`, `--map` and `--localise`, on missions through a small room."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shared.geometry.rays import cast_rays
from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation
from shared.protocol.codec import encode
from shared.recording import Recorder
from station_gui import __main__ as station_command
from tests.shared import samples
from tools import replay

ROOM = np.array(  # x0, y0, x1, y1 of its walls
    [[-1, -1, 3, -1], [3, -1, 3, 2], [3, 2, -1, 2], [-1, 2, -1, -1], [2, -1, 2, 0]], np.float64
)
Replay = Callable[..., dict[str, Any]]


def observation(sequence: int, pose: Pose2, odom_from_room: Pose2) -> Observation:
    geometry = dataclasses.replace(samples.GEOMETRY, beam_interval_s=0.0)
    scanner = pose @ geometry.robot_from_scanner
    angles = geometry.angles_rad(227) + scanner.theta_rad
    ranges = np.empty(len(angles))
    cast_rays(scanner.x_m, scanner.y_m, angles, ROOM, geometry.range_max_m, ranges)
    return Observation(
        sequence, sequence / 10, odom_from_room @ pose, 0.0, 0.0, geometry, ranges.astype(np.float32), ObjectNetwork(),
        has_objects=False,
    )  # fmt: skip


def record(path: Path, odom_from_room: Pose2, turn_rad: float) -> Path:
    recorder = Recorder(path, {}, 0)
    for k in range(30):
        pose = Pose2(0.03 * k, 0.01 * k, turn_rad * k)
        recorder.write(encode(observation(k, pose, odom_from_room)), k / 10)
    recorder.close()
    return path


@pytest.fixture
def run_replay(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Replay:
    """Calls the command, which has to succeed; returns its summary."""

    def run(mission: Path, *more: str | Path) -> dict[str, Any]:
        out = tmp_path / "out"
        monkeypatch.setattr(sys, "argv", ["replay", "--mission", str(mission), "--out", str(out), *map(str, more)])
        assert replay.main() == 0
        summary: dict[str, Any] = json.loads((out / "summary.json").read_text("utf-8"))
        return summary

    return run


def test_a_map_that_was_saved_is_gone_on_with_or_localised_in(run_replay: Replay, tmp_path: Path) -> None:
    path = tmp_path / "room.labmap"
    first = run_replay(record(tmp_path / "a.mcap", Pose2(), 0.02), "--save-map", path)
    other = record(tmp_path / "b.mcap", Pose2(9.0, -4.0, 2.0), 0.05)

    localised = run_replay(other, "--map", path, "--localise", "--save-map", tmp_path / "same.labmap")
    grown = run_replay(other, "--map", path, "--save-map", tmp_path / "grown.labmap")

    assert first["observations_located"] == 30
    for summary in (localised, grown):
        assert summary["tracking"] == "located"
        assert 10 <= summary["observations_located"] < 30
    assert localised["keyframes"] == first["keyframes"] < grown["keyframes"]
    assert (tmp_path / "same.labmap").read_bytes() == path.read_bytes()
    assert len((tmp_path / "grown.labmap").read_bytes()) > len(path.read_bytes())


def test_the_way_of_a_robot_that_is_localised_is_its_own_and_not_that_of_the_map(
    run_replay: Replay, tmp_path: Path
) -> None:
    path = tmp_path / "room.labmap"
    run_replay(record(tmp_path / "a.mcap", Pose2(), 0.02), "--save-map", path)
    summary = run_replay(record(tmp_path / "b.mcap", Pose2(9.0, -4.0, 2.0), 0.05), "--map", path, "--localise")
    way = np.loadtxt(tmp_path / "out" / "trajectory.tum")
    assert len(way) == summary["observations_located"]
    steps = np.rint(10 * way[:, 0])
    np.testing.assert_allclose(way[:, 1:3], np.column_stack((0.03 * steps, 0.01 * steps)), atol=0.02)
    assert summary["distance_m"] == pytest.approx(math.hypot(0.03, 0.01) * (len(way) - 1), abs=0.05)


@pytest.mark.parametrize("command", ["replay", "station"])
def test_localising_needs_a_map_that_is_one(
    command: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "photo.labmap"
    path.write_bytes(bytes(300))
    mission = record(tmp_path / "a.mcap", Pose2(), 0.02)
    first = ["replay", "--mission", str(mission), "--out", str(tmp_path)] if command == "replay" else ["station-gui"]
    main = replay.main if command == "replay" else station_command.main
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    for more, told in (
        (["--localise"], "--localise needs the --map"),
        (["--map", str(path)], f"{path}: is not a saved map"),
        (["--map", str(tmp_path / "none.labmap")], "none.labmap"),
    ):
        monkeypatch.setattr(sys, "argv", [*first, *more])
        try:
            code = main()
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 1
        assert code == 2
        assert told in capsys.readouterr().err
