from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from tools.logs.base import LogError
from tools.logs.urg import UrgReader

_DATA = Path(__file__).resolve().parents[3] / ".." / "shared" / "data" / "urg04lx"


def _line(time_us: int, left: int, right: int, distance_mm: int = 1000) -> str:
    fields = [str(time_us), "0", str(left), str(right)] + ["0"] * 20 + [str(distance_mm)] * 682
    return " ".join(fields) + "\n"


def test_wheel_ticks_become_odometry(tmp_path: Path) -> None:
    """2000 ticks are a turn of a wheel of 77 mm; the wheels are 330 mm apart."""
    path = tmp_path / "a.dat"
    path.write_text(_line(0, 0, 0) + _line(100_000, 1000, 1000) + _line(200_000, 1000, 2000))
    scans = list(UrgReader(path))
    half_turn_m = math.pi * 0.077

    assert scans[1].odom_from_robot.x_m == pytest.approx(half_turn_m)
    assert scans[1].speed_mps == pytest.approx(half_turn_m / 0.1)
    assert scans[2].odom_from_robot.theta_rad == pytest.approx(half_turn_m / 0.33)
    assert scans[2].stamp_s == pytest.approx(0.2)


def test_beams_run_from_right_to_left_and_error_codes_are_none(tmp_path: Path) -> None:
    path = tmp_path / "a.dat.gz"
    path.write_bytes(gzip.compress(_line(0, 0, 0, 19).encode() + _line(1, 0, 0, 20).encode()))
    first, second = list(UrgReader(path))

    assert np.isnan(first.ranges_m).all()
    np.testing.assert_allclose(second.ranges_m, 0.02)
    assert first.geometry.first_angle_rad == pytest.approx(-math.radians(119.7), abs=0.01)
    assert first.geometry.robot_from_scanner.x_m == 0.145


def test_a_last_line_that_is_cut_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.dat"
    path.write_text(_line(0, 0, 0) + _line(100_000, 0, 0)[:900])
    reader = UrgReader(path)
    assert len(list(reader)) == 1
    assert reader.truncated is not None
    assert reader.truncated.startswith(f"{path}: line 2 is cut")


@pytest.mark.parametrize("bad", ["1 2 3\n", _line(0, 0, 0).replace(" 1000", " x", 1), _line(0, 0, 0, 10**12)])
def test_a_garbled_line_is_named(tmp_path: Path, bad: str) -> None:
    path = tmp_path / "a.dat"
    path.write_text(_line(0, 0, 0) + bad + _line(1, 0, 0))
    with pytest.raises(LogError, match=r"a\.dat: line 2: "):
        list(UrgReader(path))


def test_an_empty_log_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.dat"
    path.write_text("\n")
    with pytest.raises(LogError, match="holds no scan"):
        list(UrgReader(path))


@pytest.mark.skipif(not _DATA.is_dir(), reason="the folder shared/data is not there")
def test_the_recorded_logs_are_read_whole_and_the_cut_one_is_told() -> None:
    found = {}
    for name in ("exp1", "exp2", "test_lab2"):
        reader = UrgReader(_DATA / f"{name}.dat.gz")
        found[name] = (sum(1 for _ in reader), reader.truncated is not None)
    assert found == {"exp1": (756, False), "exp2": (641, False), "test_lab2": (404, True)}
