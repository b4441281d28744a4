from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from shared.messages import Observation
from tools.logs.base import LogError
from tools.logs.urg import UrgReader, scan_times_s, true_m

_DATA = Path(__file__).resolve().parents[3] / ".." / "shared" / "data" / "urg04lx"


def _line(time_us: int, left: int, right: int, distance_mm: int = 1000) -> str:
    fields = [str(time_us), "0", str(left), str(right)] + ["0"] * 20 + [str(distance_mm)] * 682
    return " ".join(fields) + "\n"


def _drive(path: Path, left: list[int], right: list[int], jitter_s: list[float] | None = None) -> list[Observation]:
    """A log with a line every turn of the scanner."""
    late_s = jitter_s or [0.0] * len(left)
    path.write_text(
        "".join(
            _line(round((0.0987 * k + late) * 1e6), a, b)
            for k, (a, b, late) in enumerate(zip(left, right, late_s, strict=True))
        )
    )
    return list(UrgReader(path))


def test_a_turn_of_both_wheels_is_2000_ticks(tmp_path: Path) -> None:
    ticks = [0, 0, 0, *range(0, 2001, 100), 2000, 2000, 2000, 2000]
    scans = _drive(tmp_path / "a.dat", ticks, ticks)
    assert scans[-1].odom_from_robot.x_m == pytest.approx(math.tau * 0.0777)
    assert scans[14].speed_mps == pytest.approx(math.tau * 0.0777 / 20 / 0.0987, rel=1e-6)
    assert scans[14].yaw_rate_radps == 0.0


def test_the_right_wheel_alone_turns_the_robot_to_the_left(tmp_path: Path) -> None:
    right = [0, 0, 0, *range(0, 1001, 50), 1000, 1000, 1000, 1000]
    scans = _drive(tmp_path / "a.dat", [0] * len(right), right)
    assert scans[-1].odom_from_robot.theta_rad == pytest.approx(math.pi * 0.0777 / 0.31)
    assert scans[14].yaw_rate_radps == pytest.approx(math.pi * 0.0777 / 0.31 / 20 / 0.0987, rel=1e-6)


def test_a_scan_is_older_than_the_ticks_of_its_line(tmp_path: Path) -> None:
    """It has the odometry of 0.2 s before, between two records."""
    ticks = [100 * k for k in range(30)]
    scans = _drive(tmp_path / "a.dat", ticks, ticks)
    metres_per_second = 100 / 2000 * math.tau * 0.0777 / 0.0987
    assert scans[20].stamp_s == pytest.approx(20 * 0.0987 - 0.2)
    assert scans[20].odom_from_robot.x_m == pytest.approx(metres_per_second * scans[20].stamp_s)
    assert scans[0].odom_from_robot.x_m == 0.0


def test_stamps_that_jitter_do_not_make_the_scanner_jitter(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    late_s = np.abs(rng.normal(0.0, 0.01, 60))
    scans = _drive(tmp_path / "a.dat", [0] * 60, [0] * 60, late_s.tolist())
    stamps = np.array([scan.stamp_s for scan in scans])
    assert np.abs(np.diff(stamps) - 0.0987).max() < 0.006
    assert np.std(stamps - 0.0987 * np.arange(60)) < 0.3 * late_s.std()


def test_a_lost_scan_shifts_those_after_it(tmp_path: Path) -> None:
    stamps_s = scan_times_s(0.0987 * np.concatenate((np.arange(30), np.arange(31, 60))))
    assert np.diff(stamps_s)[29] == pytest.approx(2 * 0.0987, abs=1e-6)
    assert np.delete(np.diff(stamps_s), 29) == pytest.approx(0.0987, abs=1e-6)


def test_beams_run_from_right_to_left_and_error_codes_are_none(tmp_path: Path) -> None:
    path = tmp_path / "a.dat.gz"
    path.write_bytes(gzip.compress(_line(0, 0, 0, 19).encode() + _line(1, 0, 0, 20).encode()))
    first, second = list(UrgReader(path))

    assert np.isnan(first.ranges_m).all()
    np.testing.assert_allclose(second.ranges_m, true_m(np.array(0.02)), rtol=1e-6)
    assert first.geometry.first_angle_rad == pytest.approx(-math.radians(119.7), abs=0.01)
    assert first.geometry.robot_from_scanner.x_m == 0.145


def test_the_error_of_the_scanner_is_a_wave_that_keeps_the_order_of_distances() -> None:
    measured_m = np.linspace(0.02, 5.6, 1000)
    error_m = measured_m - true_m(measured_m)
    assert np.abs(error_m).max() < 0.09
    assert error_m[np.argmin(np.abs(measured_m - 2.83))] == pytest.approx(0.083, abs=1e-3)
    assert (np.diff(true_m(measured_m)) > 0).all()


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


def test_the_whole_millimetres_of_the_scanner_are_there_too(tmp_path: Path) -> None:
    path = tmp_path / "a.dat"
    path.write_text(_line(0, 0, 0, 1_420))
    (sent,) = UrgReader(path, corrects=False)
    np.testing.assert_array_equal(sent.ranges_m, np.full_like(sent.ranges_m, 1.42))
