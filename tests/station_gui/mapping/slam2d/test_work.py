"""No step does much, however large the map is and whatever happens: counted, not timed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.build import build_slam
from station_gui.config import load_config
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.localisation.self_locating import SelfLocatingSlam
from station_gui.mapping.slam2d.matching.scan_matcher import ScanMatcher
from station_gui.mapping.slam2d.share import Share
from station_gui.mapping.snapshot import Tracking

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]

_MOST_UNITS, _MOST_MATCHES = 30_000, 2  # of about 15 ns, once the first window is there
_MOST_UNITS_IN_DOUBT, _MOST_MATCHES_IN_DOUBT = 450_000, 30


class Work:
    """What has been done since `begin`."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        self.units = 0
        self.matches = 0


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Work:
    counted, take, refine = Work(), Share.take, ScanMatcher.refine

    def counting_take(share: Share, units: int) -> None:
        counted.units += units
        take(share, units)

    def counting_refine(*args: object, **kwargs: object) -> object:
        counted.matches += 1
        return refine(*args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(Share, "take", counting_take)
    monkeypatch.setattr(ScanMatcher, "refine", counting_refine)
    return counted


def _drive(slam: SelfLocatingSlam, work: Work, scans: list[PointScan]) -> list[Tracking]:
    """Checks every step; the states after each."""
    states = []
    for scan in scans:
        work.begin()
        slam.add(scan)
        states.append(slam.tracking)
        assert work.units <= _MOST_UNITS_IN_DOUBT
        assert work.matches <= _MOST_MATCHES_IN_DOUBT
    return states


@pytest.mark.parametrize("method", ["graph", "particle"])
def test_no_step_does_much_whether_the_robot_is_followed_or_lost_and_found(
    method: Literal["graph", "particle"],
    work: Work,
    lab: FloatArray,
    lap: Callable[[int], list[Pose2]],
    scan_from: ScanMaker,
) -> None:
    slam, rng = build_slam(replace(load_config(None), method=method)), np.random.default_rng(0)
    way = lap(100) + lap(100)[:60]
    _drive(slam, work, [scan_from(lab, pose, rng, pose, 0.1 * k) for k, pose in enumerate(way)])
    there, began_s = lap(100)[0], 0.1 * len(way)  # carried to
    states = _drive(slam, work, [scan_from(lab, there, rng, way[-1], began_s + 0.1 * k) for k in range(25)])
    assert Tracking.SEARCHING in states


def test_a_step_does_no_more_in_a_large_map(
    work: Work, lab: FloatArray, lap: Callable[[int], list[Pose2]], scan_from: ScanMaker
) -> None:
    slam, rng = build_slam(load_config(None)), np.random.default_rng(0)
    way = [pose for _ in range(4) for pose in lap(100)]
    for k, pose in enumerate(way):
        work.begin()
        slam.add(scan_from(lab, pose, rng, pose, 0.1 * k))
        assert k == 0 or (work.units <= _MOST_UNITS and work.matches <= _MOST_MATCHES)
    assert slam.tracking is Tracking.LOCATED
    assert len(slam.trajectory()) > 200
