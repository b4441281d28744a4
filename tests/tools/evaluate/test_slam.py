from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shared.command_line import Parser, run
from station_gui.build import build_slam
from station_gui.config import load_config
from station_gui.mapping.saved_map import SavedMap
from tools.evaluate import slam
from tools.evaluate.playing import Method, closure_offsets_m, shipped, shipped_slam
from tools.logs.base import LogError


def _log(path: Path, scans: int) -> Path:
    """A robot that stands in a round room."""
    line = "FLASER 180 " + " ".join(["3.00"] * 180) + " 0 0 0 0 0 0 {stamp} host 0\n"
    path.write_text("".join(line.format(stamp=100 + k) for k in range(scans)))
    return path


def _run(*words: str) -> int:
    """As the command line does it."""
    parser = Parser(prog="slam")
    slam.add_arguments(parser)
    return run("slam", lambda: slam.run(parser.parse_args(words)), also=(LogError,))


def test_errors_are_those_of_the_relative_pose() -> None:
    stamps = np.array([1.0, 2.0, 3.0])
    poses = np.array([[0.0, 0.0, np.pi / 2], [0.0, 1.0, np.pi / 2], [0.0, 1.0, -np.pi]])
    relations = np.array([[1.0, 2.0, 1.1, 0.0, 0.0], [2.0, 3.0, 0.0, 0.0, np.pi / 2 - 0.1], [1.0, 9.0, 0, 0, 0]])

    translation_m, rotation_rad = slam.relation_errors(stamps, poses, relations)

    np.testing.assert_allclose(translation_m, [0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(rotation_rad, [0.0, 0.1], atol=1e-12)


def test_a_closure_is_off_by_what_lies_between_it_and_the_map() -> None:
    saved = SavedMap(
        nodes=np.array([[0.0, 0.0, 0.0], [1.0, 0.0, np.pi / 2], [1.0, 2.0, 0.0]]),
        ends=np.array([[0, 1], [1, 2], [0, 2]], np.int32),
        measured=np.array([[5.0, 5.0, 0.0], [2.3, 0.4, 1.0], [1.0, 2.0, 0.0]]),
        information=np.tile(np.eye(3), (3, 1, 1)),
        robust=np.array([False, True, True]),
        length_m=np.ones(3),
        keyframes=(),
        pieces=np.zeros(3, np.int32),
    )
    np.testing.assert_allclose(closure_offsets_m(saved), [0.5, 0.0], atol=1e-12)


def test_all_figures_are_printed_as_json_and_the_trajectory_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, relations = _log(tmp_path / "a.clf", 20), tmp_path / "a.relations"
    relations.write_text("100.0 110.0 0 0 0 0 0 0\n")
    trajectory = tmp_path / "out.tum"

    code = _run(str(log), "--relations", str(relations), "--trajectory", str(trajectory), "--json")

    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert code == 0
    assert figures["scans"] == 20
    assert figures["relations"] == 1
    assert figures["translation_mean_m"] < 0.001
    assert set(figures) == {
        "scans", "relations", "translation_mean_m", "translation_std_m", "rotation_mean_deg", "rotation_std_deg",
        "seconds", "realtime_factor", "step_ms_p50", "step_ms_p99", "step_ms_p99_first_1000", "step_ms_p99_last_1000",
        "peak_rss_mb", "loop_closures", "unlocated", "cpu_seconds", "cpu_realtime_factor", "step_ms_max",
        "step_cpu_ms_p50", "step_cpu_ms_p99", "step_cpu_ms_p99_first_1000", "step_cpu_ms_p99_last_1000",
        "step_cpu_ms_max", "closure_offset_max_m", "resamplings", "effective_share",
    }  # fmt: skip
    assert 0 < figures["step_cpu_ms_p50"] <= figures["step_cpu_ms_p99"] <= figures["step_cpu_ms_max"]
    rows = np.loadtxt(trajectory)
    assert rows.shape == (20, 8)
    np.testing.assert_allclose(rows[:, 6] ** 2 + rows[:, 7] ** 2, 1.0)


@pytest.mark.parametrize("content", ["1 2 3\n", "a b c d e f g h\n", ""])
def test_relations_that_cannot_be_used_give_one_line_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str
) -> None:
    relations = tmp_path / "a.relations"
    relations.write_text(content)
    code = _run(str(_log(tmp_path / "a.clf", 2)), "--relations", str(relations))
    told = capsys.readouterr().err
    assert code == 2
    assert told.count("\n") == 1
    assert str(relations) in told


def test_a_cut_log_gives_its_figures_and_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, relations = _log(tmp_path / "a.clf", 20), tmp_path / "a.relations"
    log.write_text(log.read_text()[:-300])
    relations.write_text("100.0 110.0 0 0 0 0 0 0\n")
    code = _run(str(log), "--relations", str(relations), "--json")
    captured = capsys.readouterr()
    assert code == 2
    assert json.loads(captured.out)["scans"] == 19
    assert f"{log}: line 20 is cut" in captured.err


def test_it_is_said_how_many_relations_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    relations = tmp_path / "a.relations"
    relations.write_text("100.0 101.0 0 0 0 0 0 0\n100.0 900.0 0 0 0 0 0 0\n")
    assert _run(str(_log(tmp_path / "a.clf", 2)), "--relations", str(relations), "--json") == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["relations"] == 1
    assert captured.err == "1 of 2 relations are left out: their stamps are not in the log\n"


def test_relations_of_another_log_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    relations = tmp_path / "a.relations"
    relations.write_text("1.0 2.0 0 0 0 0 0 0\n")
    assert _run(str(_log(tmp_path / "a.clf", 2)), "--relations", str(relations)) == 2
    assert "no relation names two stamps" in capsys.readouterr().err


def test_the_particle_filter_gives_the_same_figures_and_the_same_trajectory_for_a_seed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, relations = _log(tmp_path / "a.clf", 20), tmp_path / "a.relations"
    relations.write_text("100.0 110.0 0 0 0 0 0 0\n")
    written = []
    for name in ("one.tum", "two.tum"):
        words = ["--method", "particle", "--seed", "3", "--trajectory", str(tmp_path / name), "--json"]
        assert _run(str(log), "--relations", str(relations), *words) == 0
        written.append((tmp_path / name).read_bytes())
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert figures["translation_mean_m"] < 0.005
    assert figures["loop_closures"] == 0
    assert figures["resamplings"] == 0
    assert figures["effective_share"] == pytest.approx(1.0)
    assert written[0] == written[1]


@pytest.mark.parametrize(
    "words",
    [
        ("--method", "kalman"), ("--seed", "-1"), ("--seed", "x"), ("--trajectory", "/nope/x.tum"),
        ("--trajectory", "."), ("--relations", "nope.relations"),
    ],
    ids=str,
)  # fmt: skip
def test_options_that_cannot_be_used_are_refused_in_one_line_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, str]
) -> None:
    log, relations = _log(tmp_path / "a.clf", 2), tmp_path / "a.relations"
    relations.write_text("100.0 101.0 0 0 0 0 0 0\n")
    with pytest.raises(SystemExit, match="2"):
        _run(str(log), "--relations", str(relations), *words)
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert words[0] in told
    assert words[1] in told


def test_what_is_measured_is_what_the_station_ships() -> None:
    methods: tuple[Method, Method] = ("graph", "particle")
    for method in methods:
        config = shipped(method, 7)
        assert config == replace(load_config(None), method=method, particle_slam=config.particle_slam)
        assert config.particle_slam == replace(load_config(None).particle_slam, seed=7)
        assert type(shipped_slam(method, 0)) is type(build_slam(load_config(None)))
