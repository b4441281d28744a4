from __future__ import annotations

import bz2
import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from shared.messages import Observation
from station_gui.mapping.scan import to_points
from tools.logs.base import LogError
from tools.logs.carmen import CarmenReader


def _line(stamp_s: float = 12.5, ranges: str = "1.0 2.0 81.83 51.2", laser: str = "0.96 2.0 0.0") -> str:
    return f"FLASER 4 {ranges} {laser} 1.0 2.0 0.0 {stamp_s} host 3.0\n"


_LOG = "# a comment\nPARAM robot x\nODOM 0 0 0 0 0 0 1.0 host 1.0\n" + _line(12.5) + _line(12.4)


def test_scans_come_in_the_order_of_the_file_with_the_odometry_of_their_line(tmp_path: Path) -> None:
    path = tmp_path / "a.clf"
    path.write_text(_LOG)
    reader = CarmenReader(path)
    first, second = list(reader)

    assert (first.stamp_s, second.stamp_s) == (12.5, 12.4)
    assert (first.sequence, second.sequence) == (0, 1)
    assert first.odom_from_robot.as_array().tolist() == [1.0, 2.0, 0.0]
    assert reader.truncated is None
    assert reader.count() == 2
    assert not first.has_objects


def test_beams_run_from_right_to_left_and_values_of_no_return_are_none(tmp_path: Path) -> None:
    path = tmp_path / "a.clf"
    path.write_text(_LOG)
    scan = next(iter(CarmenReader(path)))

    assert scan.geometry.first_angle_rad == -math.pi / 2
    assert scan.geometry.step_rad == pytest.approx(math.pi / 4)
    np.testing.assert_array_equal(np.isnan(scan.ranges_m), [False, False, True, True])
    assert scan.geometry.robot_from_scanner.x_m == pytest.approx(-0.04)


@pytest.mark.parametrize(("suffix", "pack"), [(".gz", gzip.compress), (".bz2", bz2.compress)])
def test_packed_logs_are_read_and_cut_ones_give_what_they_hold(tmp_path: Path, suffix: str, pack) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(0)
    text = "".join(_line(k, " ".join(f"{v:.2f}" for v in rng.uniform(1, 9, 4))) for k in range(40_000))
    whole, cut = tmp_path / f"whole.clf{suffix}", tmp_path / f"cut.clf{suffix}"
    packed = pack(text.encode())
    whole.write_bytes(packed)
    cut.write_bytes(packed[: len(packed) * 3 // 4])
    reader = CarmenReader(cut)
    count = sum(1 for _ in reader)

    assert sum(1 for _ in CarmenReader(whole)) == 40_000
    assert 0 < count < 40_000
    assert reader.truncated is not None
    assert str(cut) in reader.truncated
    assert "\n" not in reader.truncated


def test_a_last_line_that_is_cut_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.clf"
    path.write_text(_LOG + _line()[:30])
    reader = CarmenReader(path)
    assert len(list(reader)) == 2
    assert reader.truncated is not None
    assert reader.truncated.startswith(f"{path}: line 6 is cut")


@pytest.mark.parametrize(
    "line",
    [
        "FLASER 4 1.0 x 2.0 3.0 0 0 0 0 0 0 1.0 host 1.0\n",
        "FLASER 4 1.0 2.0\n",
        "FLASER -1 1.0 2.0\n",
        "FLASER 99999999999 1.0 2.0\n",
        "FLASER 2 1.0 2.0 0 0 0 nan 0 0 1.0 host 1.0\n",
        "FLASER \n",
        "FLASER\n",
    ],
)
def test_a_garbled_line_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "a.clf"
    path.write_text(_LOG + line + _LOG)
    with pytest.raises(LogError, match=r"a\.clf: line 6: "):
        list(CarmenReader(path))


@pytest.mark.parametrize("name", ["a.clf", "a.clf.gz", "a.clf.bz2"])
def test_a_file_that_is_no_log_is_named(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    with pytest.raises(LogError, match="no such file"):
        CarmenReader(path)
    path.write_bytes(bytes(range(128, 256)) * 10 + b"\n")
    with pytest.raises(LogError, match=name):
        list(CarmenReader(path))
    with pytest.raises(LogError, match="is not a file"):
        CarmenReader(tmp_path)


def test_a_log_without_a_scan_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.clf"
    path.write_text("# nothing\n")
    with pytest.raises(LogError, match="holds no FLASER or ROBOTLASER1 line"):
        list(CarmenReader(path))


def _flaser(ranges: list[float], stamp_s: float = 1.0) -> str:
    values = " ".join(f"{r:.2f}" for r in ranges)
    return f"FLASER {len(ranges)} {values} 0.1 0 0 0 0 0 {stamp_s} host 3.0\n"


def _robotlaser(
    ranges: str, config: str = "-1.570796 3.141593 1.570796 20.0 0.01 0", remissions: str = "0", stamp_s: float = 7.5
) -> str:
    poses = "1.2 2.0 0.0 1.0 2.0 0.0"
    return (
        f"ROBOTLASER1 0 {config} {len(ranges.split())} {ranges} {remissions} {poses} 0.4 0.1 0.5 0.3 1e9 "
        f"{stamp_s} host 3.0\n"
    )


def _read(tmp_path: Path, text: str) -> list[Observation]:
    path = tmp_path / "a.clf"
    path.write_bytes(text.encode("latin-1"))
    return list(CarmenReader(path))


@pytest.mark.parametrize(
    ("beams", "first_deg", "step_deg"),
    [
        (180, -90.0, 1.0),
        (181, -90.0, 1.0),
        (360, -90.0, 0.5),
        (361, -90.0, 0.5),
        (401, -50.0, 0.25),
        (541, -135.0, 0.5),
        (1081, -135.0, 0.25),
    ],
)
def test_the_number_of_beams_tells_where_they_point(
    tmp_path: Path, beams: int, first_deg: float, step_deg: float
) -> None:
    (scan,) = _read(tmp_path, _flaser([2.0] * beams))
    assert math.degrees(scan.geometry.first_angle_rad) == pytest.approx(first_deg)
    assert math.degrees(scan.geometry.step_rad) == pytest.approx(step_deg)
    assert len(scan.ranges_m) == beams


def test_a_newer_kind_of_line_tells_its_own_angles_and_its_greatest_range(tmp_path: Path) -> None:
    config = "-2.0 4.0 1.0 10.0 0.01 2"
    scan, late = _read(
        tmp_path, _robotlaser("1.0 9.9 9.99 10.0 81.9", config, "3 100 200 300") + _robotlaser("1 1", stamp_s=7.4)
    )
    assert (scan.geometry.first_angle_rad, scan.geometry.step_rad) == (-2.0, 1.0)
    assert scan.geometry.range_max_m == pytest.approx(10.0, rel=0.01)
    np.testing.assert_array_equal(np.isnan(scan.ranges_m), [False, False, True, True, True])
    assert scan.odom_from_robot.as_array().tolist() == [1.0, 2.0, 0.0]
    assert scan.geometry.robot_from_scanner.x_m == pytest.approx(0.2)
    assert (scan.speed_mps, scan.yaw_rate_radps) == (0.4, 0.1)
    assert (scan.stamp_s, late.stamp_s) == (7.5, 7.4)


def test_a_line_without_a_step_has_its_field_of_view_spread_over_its_beams(tmp_path: Path) -> None:
    (scan,) = _read(tmp_path, _robotlaser("1 1 1 1 1", "-1.0 2.0 0.0 20.0 0.01 0"))
    assert scan.geometry.step_rad == pytest.approx(0.5)


def test_blank_lines_comments_in_any_language_and_other_messages_are_left_out(tmp_path: Path) -> None:
    text = (
        "\n# Büro, im März\r\nPARAM laser_front_laser_max 81.9\nSYNC x\nTRUEPOS 0 0 0 0 0 0 1.0 host 1.0\n   \n"
        "RLASER 2 1.0 1.0 0 0 0 0 0 0 1.0 host 1.0\nRAWLASER1 0 0 0 0 0 0 0 2 1 1 0 1.0 host 1.0\n"
    )
    scans = _read(tmp_path, text + _flaser([1.0, 2.0], 5.0).replace("\n", "\r\n") + text + _flaser([1.0, 2.0], 4.0))
    assert [scan.stamp_s for scan in scans] == [5.0, 4.0]


def test_a_log_with_both_kinds_of_scan_lines_is_read_by_the_kind_that_came_first(tmp_path: Path) -> None:
    scans = _read(tmp_path, _flaser([1.0, 2.0], 1.0) + _robotlaser("3 3 3") + _flaser([1.0, 2.0], 2.0))
    assert [len(scan.ranges_m) for scan in scans] == [2, 2]


@pytest.mark.parametrize("code_m", [81.91, 81.83, 80.0, 51.2, 50.0, 8.1, 8.19, 30.0])
def test_the_value_that_says_nothing_there_is_found_whatever_it_is(tmp_path: Path, code_m: float) -> None:
    rng = np.random.default_rng(3)
    walls_m = [rng.uniform(1.0, 7.5, 180).round(2) for _ in range(16)]
    missed = rng.random(180) < 0.1
    scans = _read(tmp_path, "".join(_flaser(np.where(missed, code_m, wall).tolist()) for wall in walls_m))
    for scan in scans:
        np.testing.assert_array_equal(np.isnan(scan.ranges_m), missed)


def test_a_far_wall_is_not_taken_for_nothing(tmp_path: Path) -> None:
    """A standing scanner sees the end of a hall in the same few beams again and again, each time a little different."""
    rng = np.random.default_rng(4)
    scans = _read(
        tmp_path,
        "".join(_flaser([2.0] * 150 + (29.0 + rng.normal(0.0, 0.01, 30)).round(2).tolist()) for _ in range(64)),
    )
    assert not any(np.isnan(scan.ranges_m).any() for scan in scans)


def test_readings_that_are_no_numbers_are_no_echoes(tmp_path: Path) -> None:
    (scan,) = _read(tmp_path, "FLASER 4 nan inf -1.0 2.0 0 0 0 0 0 0 1.0 host 1.0\n")
    points = to_points(scan).points_m
    assert len(points) == 1


def test_a_line_may_end_after_its_stamp_but_not_where_the_file_is_cut(tmp_path: Path) -> None:
    short = "FLASER 2 1.0 2.0 0 0 0 0 0 0 1.25\n"
    assert _read(tmp_path, short)[0].stamp_s == 1.25
    path = tmp_path / "cut.clf"
    path.write_text(_flaser([1.0, 2.0]) + short.rstrip("\n"))
    reader = CarmenReader(path)
    assert len(list(reader)) == 1
    assert reader.truncated is not None


@pytest.mark.parametrize(
    "line",
    [
        _robotlaser("1 1", "-1.0 2.0 nan 20.0 0.01 0"),
        _robotlaser("1 1 1", "-1.0 20.0 6.0 20.0 0.01 0"),
        _robotlaser("1 1", remissions="9"),
        _robotlaser("1 1", remissions="-1"),
        "ROBOTLASER1 0 0 0 0 0 0 0\n",
        "ROBOTLASER1 0 0 0 0 0 0 0 3 1 1\n",
    ],
)
def test_a_garbled_newer_line_is_named(tmp_path: Path, line: str) -> None:
    with pytest.raises(LogError, match=r"a\.clf: line 2: "):
        _read(tmp_path, _robotlaser("1 1") + line + _robotlaser("1 1"))
