from __future__ import annotations

import pytest

from shared.geometry.se2 import Pose2
from station_gui.mapping.slam2d.localisation import early
from station_gui.mapping.slam2d.localisation.early import EarlyOdometry


@pytest.fixture
def odometry(monkeypatch: pytest.MonkeyPatch) -> EarlyOdometry:
    monkeypatch.setattr(early, "_MOST", 4)
    return EarlyOdometry()


def test_at_first_every_scan_is_kept_as_it_came(odometry: EarlyOdometry) -> None:
    came = [Pose2(0.1 * k, 0.02 * k * k, 0.3 * k) for k in range(8)]
    for pose in came:
        odometry.append(pose)
    assert [odometry[k].as_array().tolist() for k in range(8)] == [pose.as_array().tolist() for pose in came]


@pytest.mark.parametrize("count", [1, 9, 16, 17, 31, 32, 33, 500])
def test_of_a_long_way_no_more_is_kept_and_what_is_between_is_interpolated(odometry: EarlyOdometry, count: int) -> None:
    for k in range(count):
        odometry.append(Pose2(0.1 * k, -0.2 * k, 0.001 * k))
    assert len(odometry) == count
    for k in range(count):
        assert odometry[k].as_array() == pytest.approx([0.1 * k, -0.2 * k, 0.001 * k], abs=1e-9)
    assert odometry._kept.shape == (8, 3)


def test_a_scan_that_has_not_come_has_no_place(odometry: EarlyOdometry) -> None:
    odometry.append(Pose2())
    with pytest.raises(IndexError):
        odometry[1]
