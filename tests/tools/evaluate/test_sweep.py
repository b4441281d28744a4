from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from shared.command_line import Parser, run
from shared.messages import Observation
from station_gui.mapping.scan import to_points
from tools.evaluate import sweep
from tools.evaluate.playing import shipped
from tools.evaluate.sweep import VARIATIONS
from tools.logs.base import LogError
from tools.logs.carmen import CarmenReader

_SCANS = 12


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A robot that drives a decimetre a scan, by odometry, in a room that goes with it."""
    line = "FLASER 180 " + " ".join(f"{2 + k / 100:.2f}" for k in range(180)) + " {x} 0 0 {x} 0 0 {stamp} host 0\n"
    path = tmp_path / "a.clf"
    path.write_text("".join(line.format(stamp=100 + k, x=0.1 * k) for k in range(_SCANS)))
    return path


@pytest.fixture
def observations(log: Path) -> list[Observation]:
    return list(CarmenReader(log))


def _varied(name: str, observations: list[Observation], seed: int = 0) -> list[Observation]:
    return VARIATIONS[name].change(observations, np.random.default_rng(seed))


def test_every_second_beam_points_where_it_pointed_before(observations: list[Observation]) -> None:
    varied = _varied("beams", observations)
    np.testing.assert_array_equal(to_points(varied[3]).points_m, to_points(observations[3]).points_m[::2])


def test_a_late_beginning_and_fewer_scans_keep_the_scans_stamps(observations: list[Observation]) -> None:
    assert [seen.stamp_s for seen in _varied("late40", observations)] == [100.0 + k for k in range(4, _SCANS)]
    assert [seen.stamp_s for seen in _varied("scans", observations)] == [100.0 + k for k in range(0, _SCANS, 2)]
    assert [seen.stamp_s for seen in _varied("backwards", observations)] == [111.0 - k for k in range(_SCANS)]


def test_worse_wheels_drive_as_far_as_they_slip(observations: list[Observation]) -> None:
    ways = [_varied("wheels", observations, seed)[-1].odom_from_robot.x_m for seed in range(40)]
    assert np.mean(ways) == pytest.approx(1.05 * 1.1, abs=0.01)
    assert np.std(ways) == pytest.approx(0.05 * 0.1 * np.sqrt(_SCANS - 1), rel=0.4)


def test_noise_is_of_the_ranges_alone_and_the_same_again_with_the_same_seed(observations: list[Observation]) -> None:
    first, again, other = (_varied("noise", observations, seed) for seed in (1, 1, 2))
    assert first[0].odom_from_robot == observations[0].odom_from_robot
    np.testing.assert_array_equal(first[0].ranges_m, again[0].ranges_m)
    assert (first[0].ranges_m != other[0].ranges_m).any()
    errors_m = np.concatenate([a.ranges_m - b.ranges_m for a, b in zip(first, observations, strict=True)])
    assert np.nanstd(errors_m) == pytest.approx(0.01, rel=0.1)


def test_the_time_for_loops_is_a_multiple_of_the_stations_own() -> None:
    config = shipped("graph", 0)
    hurried = sweep.with_loop_time(config, VARIATIONS["hurried"].loop_time)
    assert hurried.slam.loops.units_per_step == pytest.approx(0.6 * config.slam.loops.units_per_step, abs=1)


def test_each_variation_asked_for_is_a_row(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    relations = tmp_path / "a.relations"
    relations.write_text("100.0 110.0 1 0 0 0 0 0\n")
    parser = Parser(prog="sweep")
    sweep.add_arguments(parser)
    words = [str(log), "--relations", str(relations), "--only", "whole", "backwards"]
    for more in ([], ["--json"]):
        args = parser.parse_args([*words, *more])
        assert run("sweep", lambda args=args: sweep.run(args), also=(LogError,)) == 0
    *rows, whole, backwards = capsys.readouterr().out.splitlines()
    assert [row.split("|")[1].strip() for row in rows] == ["as it is", "backwards"]
    assert json.loads(whole)["scans"] == json.loads(backwards)["scans"] == _SCANS
    assert json.loads(whole)["relations"] == json.loads(backwards)["relations"] == 1
