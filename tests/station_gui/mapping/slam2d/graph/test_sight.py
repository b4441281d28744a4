from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.slam2d.graph.sight.sight import Horizon, View, seen_through_share
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.se2_arrays import compose
from station_gui.mapping.slam2d.share import Share

FloatArray = NDArray[np.float64]
_SCANNER_M = np.array([0.1, 0.0])


def _view(bearings_deg: FloatArray, range_m: float, in_place: FloatArray) -> View:
    bearings = np.radians(bearings_deg)
    points = _SCANNER_M + range_m * np.column_stack((np.cos(bearings), np.sin(bearings)))
    keyframe = Keyframe(0.0, 0, np.zeros(3), points.astype(np.float32), np.zeros_like(points, np.float32), _SCANNER_M)
    return View(in_place, Horizon(keyframe))


def _share(points: FloatArray, pose: FloatArray, views: list[View], units: int = 1 << 60) -> tuple[float, int]:
    share = Share()
    task = seen_through_share(points, pose, views, 0.15, 0.02, share)
    for rests in range(10_000):
        share.begin(units)
        try:
            next(task)
        except StopIteration as end:
            return float(end.value), rests
    raise AssertionError("no end")


@pytest.mark.parametrize("in_place", [np.zeros(3), np.array([3.0, -2.0, 2.5])])
def test_only_points_well_before_the_seen_ones_are_seen_through(in_place: FloatArray) -> None:
    view = _view(np.arange(-90.0, 91.0, 0.5), 3.0, in_place)
    ahead = _SCANNER_M + np.array([[1.0, 0.0], [2.5, 0.3], [2.9, 0.0], [3.5, 0.0], [-1.0, 0.0]])
    assert _share(ahead, in_place, [view])[0] == pytest.approx(2 / 5)


def test_what_no_beam_came_near_is_not_known() -> None:
    view = _view(np.concatenate((np.arange(-90.0, -20.0), np.arange(20.0, 90.0))), 3.0, np.zeros(3))
    points = np.array([[1.0, 0.0], [1.0, 0.1], [1.1, 1.0], [1.1, -1.0]])
    assert _share(points, np.zeros(3), [view])[0] == pytest.approx(1 / 2)


@pytest.mark.parametrize("spacing_deg", [0.1, 0.36, 1.0, 2.0, 3.7])
@pytest.mark.parametrize("way", [1, -1])
def test_between_neighbouring_beams_nothing_is_unknown(spacing_deg: float, way: int) -> None:
    """Round the back of the scanner too, where bearings jump."""
    view = _view(np.arange(100.0, 260.0, spacing_deg)[::way], 3.0, np.zeros(3))
    ahead_rad = np.radians(np.arange(105.0, 255.0, 0.13))
    points = _SCANNER_M + 2.0 * np.column_stack((np.cos(ahead_rad), np.sin(ahead_rad)))
    assert _share(points, np.zeros(3), [view])[0] == 1.0


@pytest.mark.parametrize("spacing_deg", [0.36, 1.0, 2.0])
def test_where_beams_hit_nothing_is_not_known_however_wide_they_are(spacing_deg: float) -> None:
    bearings = np.arange(-60.0, 60.0, spacing_deg)
    view = _view(bearings[np.abs(bearings) > 5.0], 3.0, np.zeros(3))
    ahead_rad = np.radians(np.arange(-3.0, 3.0, 0.1))
    points = _SCANNER_M + 2.0 * np.column_stack((np.cos(ahead_rad), np.sin(ahead_rad)))
    assert _share(points, np.zeros(3), [view])[0] == 0.0


def test_a_near_point_of_the_view_hides_what_is_behind_it() -> None:
    post, wall = _view(np.array([0.2]), 1.0, np.zeros(3)).keyframe, _view(np.arange(-9.0, 9.0, 0.5), 3.0, np.zeros(3))
    both = np.concatenate((wall.keyframe.points_m, post.points_m))
    view = View(np.zeros(3), Horizon(Keyframe(0.0, 0, np.zeros(3), both, np.zeros_like(both), _SCANNER_M)))
    assert _share(np.array([[2.1, 0.0], [2.1, 0.2]]), np.zeros(3), [view])[0] == pytest.approx(1 / 2)


def test_several_views_count_a_point_once_and_rest_between() -> None:
    rng = np.random.default_rng(0)
    pose = np.array([0.5, 0.2, -0.7])
    views = [_view(np.arange(-120.0, 120.0, 0.4), 3.0, rng.normal(0, 0.5, 3)) for _ in range(6)]
    points = rng.uniform(-4, 4, (300, 2))
    at_once, _ = _share(points, pose, views)
    slowly, rests = _share(points, pose, views, units=1)
    assert rests == 5
    assert at_once == slowly
    assert at_once == pytest.approx(np.mean([_seen_through(point, pose, views) for point in points]), abs=0.02)


def _seen_through(point: FloatArray, pose: FloatArray, views: list[View]) -> bool:
    """By the circles that the views have seen; sectors at their ends differ."""
    in_place = compose(pose, np.array([*point, 0.0]))[:2]
    for view in views:
        x, y, theta = view.in_place
        c, s = np.cos(theta), np.sin(theta)
        local = np.array([[c, s], [-s, c]]) @ (in_place - (x, y)) - _SCANNER_M
        if np.hypot(*local) * 1.02 + 0.15 < 3.0 and abs(np.arctan2(local[1], local[0])) < np.radians(120.0):
            return True
    return False
