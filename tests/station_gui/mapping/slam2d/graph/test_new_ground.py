"""What a match leaves over: new ground counts for nothing, what the map has looked through counts against."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import NewGroundConfig
from station_gui.mapping.slam2d.graph.sight.new_ground import NewGround, view_of
from station_gui.mapping.slam2d.graph.sight.sight import View
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan

_BEAMS = 360


def _ring(range_m: float, first_deg: float, last_deg: float) -> NDArray[np.float64]:
    angle_rad = np.radians(np.linspace(first_deg, last_deg, _BEAMS))
    return range_m * np.column_stack((np.cos(angle_rad), np.sin(angle_rad)))


def _view(points_m: NDArray[np.float64]) -> View:
    return view_of(LineScan(points_m, np.zeros_like(points_m)), np.zeros(2), np.zeros(3))


_KNOWN = _ring(3.0, -90.0, 90.0)


def test_points_that_no_scan_of_the_map_could_see_do_not_count() -> None:
    here = _view(np.vstack((_KNOWN, _ring(1.0, 120.0, 240.0))))
    assert NewGround(NewGroundConfig()).fair_share(0.5, here, [_view(_KNOWN)]) == pytest.approx(1.0)


def test_points_that_the_map_has_looked_through_leave_the_share_as_it_is() -> None:
    here = _view(np.vstack((_KNOWN, _ring(1.0, -60.0, 60.0))))
    assert NewGround(NewGroundConfig()).fair_share(0.5, here, [_view(_KNOWN)]) == 0.5


def test_a_scan_that_looks_through_the_map_leaves_the_share_as_it_is() -> None:
    assert NewGround(NewGroundConfig()).fair_share(0.5, _view(_ring(6.0, -90.0, 90.0)), [_view(_KNOWN)]) == 0.5


def test_without_a_scan_of_the_map_near_by_nothing_is_excused() -> None:
    far = View(np.array([20.0, 0.0, 0.0]), _view(_KNOWN).horizon)
    assert NewGround(NewGroundConfig()).fair_share(0.5, _view(_KNOWN), [far]) == 0.5


@pytest.mark.parametrize(("share", "surprise", "asked"), [(0.5, 1.0, True), (0.2, 1.0, False), (0.5, 6.0, False)])
def test_only_a_match_near_the_prediction_that_many_points_hold_is_asked_about(
    share: float, surprise: float, asked: bool
) -> None:
    ground = NewGround(NewGroundConfig())
    assert ground.may_be(share, surprise, 200) is asked
    assert not ground.may_be(share, math.nan, 200)


def test_the_newest_scans_are_asked_and_no_more_than_there_are() -> None:
    ground = NewGround(NewGroundConfig(views=3, every=2))
    keyframes = [_view(_KNOWN).keyframe for _ in range(10)]
    for count, asked in ((2, [1]), (9, [8, 6, 4]), (10, [9, 7, 5])):
        assert [h.keyframe for h in ground.picked(keyframes[:count])] == [keyframes[k] for k in asked]
    assert ground.picked([]) == []


def test_a_scan_that_is_asked_again_is_gone_through_once() -> None:
    ground = NewGround(NewGroundConfig(views=3, every=2))
    keyframes = [_view(_KNOWN).keyframe for _ in range(10)]
    first = ground.picked(keyframes[:8])
    ground.picked(keyframes[:9])
    assert ground.picked(keyframes)[1:] == first[:2]
