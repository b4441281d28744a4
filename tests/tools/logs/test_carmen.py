from __future__ import annotations

import bz2
import gzip
import math
from pathlib import Path

import numpy as np
import pytest

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
    with pytest.raises(LogError, match="holds no FLASER line"):
        list(CarmenReader(path))
