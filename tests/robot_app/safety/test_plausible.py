from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.drivers.base import ImuSample, RawScan
from robot_app.safety.plausible import ImuWatch, ScanWatch


def room(rng: np.random.Generator) -> NDArray[np.float32]:
    """(227,) ranges: a wall with table legs before it."""
    ranges_m = 2.0 + 0.5 * np.sin(np.linspace(0, 4, 227)) + rng.normal(0, 0.01, 227)
    ranges_m[::25] = 0.7
    return ranges_m.astype(np.float32)


def test_a_room_is_seen_though_a_third_of_the_beams_are_missing(rng: np.random.Generator) -> None:
    watch = ScanWatch(12)
    ranges_m = room(rng)
    ranges_m[rng.random(227) < 0.33] = np.nan
    assert watch.can_see(RawScan(0.0, ranges_m))


def test_what_no_room_looks_like_is_not_believed(rng: np.random.Generator) -> None:
    watch = ScanWatch(12)
    assert not any(watch.can_see(RawScan(i / 25, rng.uniform(0.06, 4.0, 227).astype(np.float32))) for i in range(50))


@pytest.mark.parametrize("beams", [0, 1, 11])
def test_a_covered_scanner_sees_nothing(rng: np.random.Generator, beams: int) -> None:
    ranges_m = np.full(227, np.nan, np.float32)
    ranges_m[:beams] = 0.1
    assert not ScanWatch(12).can_see(RawScan(0.0, ranges_m))


def test_a_scan_that_comes_again_was_not_measured(rng: np.random.Generator) -> None:
    watch, ranges_m = ScanWatch(12), room(rng)
    assert watch.can_see(RawScan(0.0, ranges_m))
    assert not watch.can_see(RawScan(0.04, ranges_m.copy()))


def test_an_imu_that_repeats_itself_four_times_hangs() -> None:
    watch = ImuWatch()
    alive = [watch.is_alive(ImuSample(i / 100, (0.1, 0.0, 0.0), (0.0, 0.0, 9.8))) for i in range(6)]
    assert alive == [True] * 4 + [False] * 2
