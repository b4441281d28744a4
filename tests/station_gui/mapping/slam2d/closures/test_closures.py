from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.slam2d.closures.closure import Candidate, Closure, choose, joined
from station_gui.mapping.slam2d.closures.jury import Jury
from station_gui.mapping.slam2d.closures.verifier import Verifier
from station_gui.mapping.slam2d.config import LoopConfig, MatchConfig
from station_gui.mapping.slam2d.graph.sight.sight import Horizon, View
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, ScanMatcher
from station_gui.mapping.slam2d.share import result_at_once

FloatArray = NDArray[np.float64]
_CELL_M, _REACH_CELLS = 0.05, 8
_NEAR = Candidate(0, 20, 1.0)
_ROW = np.column_stack((np.arange(60.0), np.zeros(60), np.zeros(60)))  # poses of nodes


def _wall(start: tuple[float, float], end: tuple[float, float], points: int = 60) -> tuple[FloatArray, FloatArray]:
    """Points and normals of a wall that faces to the left of its direction."""
    a, b = np.array(start), np.array(end)
    along = (b - a) / np.hypot(*(b - a))
    return np.linspace(a, b, points), np.tile((-along[1], along[0]), (points, 1))


def _scan(*walls: tuple[FloatArray, FloatArray]) -> LineScan:
    return LineScan(np.vstack([points for points, _ in walls]), np.vstack([normals for _, normals in walls]))


def _keyframe(scan: LineScan) -> Keyframe:
    points, normals = scan.points_m.astype(np.float32), scan.normals.astype(np.float32)
    return Keyframe(0.0, 0, np.zeros(3), points, normals, np.zeros(2))


_RIGHT, _FRONT = _wall((-2.0, -1.0), (2.0, -1.0)), _wall((2.0, -1.0), (2.0, 2.0))
_UNKNOWN = _wall((-2.0, 2.0), (-2.0, -1.0), 90)  # where the place was not looked at


def _verified(
    pair: Candidate,
    place: LineScan,
    query: LineScan,
    config: LoopConfig | None = None,
    ahead_m: float = 0.0,
) -> Closure | None:
    """A search has put the query 5 cm and half a degree beside where it is; the estimate is `ahead_m` from there."""
    matcher = ScanMatcher(MatchConfig(), _REACH_CELLS, _CELL_M)
    local_map = LocalMap(12.0, _CELL_M, _REACH_CELLS, 5000, 100.0)
    local_map.insert(place.points_m, place.normals, np.zeros(3))
    verifier = Verifier(config or LoopConfig(), matcher)
    views = [View(np.zeros(3), Horizon(_keyframe(place)))]
    guess = np.array([0.05, -0.03, math.radians(0.5)])
    estimate = guess + np.array([ahead_m, 0.0, 0.0])
    return result_at_once(lambda share: verifier.verified(pair, query, estimate, guess, local_map, views, share))


def _closure(new: int, off_m: float, *, witness: bool = False) -> Closure:
    """Partial, and `off_m` beside where `_ROW` has the new node."""
    return Closure(0, new, _ROW[new] + (0.0, off_m, 0.0), np.eye(3), searched=True, partial=True, witness=witness)


def test_what_is_known_for_the_most_part_is_a_whole_view() -> None:
    closure = _verified(_NEAR, _scan(_RIGHT, _FRONT), _scan(_RIGHT, _FRONT))
    assert closure is not None
    assert not closure.partial
    np.testing.assert_allclose(closure.measured, 0.0, atol=5e-3)


def test_few_known_points_do_where_they_hold_the_robot_and_none_stands_in_free_space() -> None:
    query = _scan(_RIGHT, _FRONT, _UNKNOWN)
    assert _verified(Candidate(0, 20, 3.0), _scan(_RIGHT, _FRONT), query) is None  # too far off to be sure
    loose = _verified(_NEAR, _scan(_RIGHT, _FRONT), query, LoopConfig(sure_held_share=0.9))
    assert loose is not None
    assert loose.partial
    firm = _verified(_NEAR, _scan(_RIGHT, _FRONT), query)
    assert firm is not None
    assert not firm.partial
    witness = _verified(_NEAR, _scan(_RIGHT, _FRONT), query, LoopConfig(sure_held_share=0.9, min_held_share=0.9))
    assert witness is not None
    assert not firm.witness
    assert witness.witness


def test_where_a_corridor_fits_as_well_at_the_estimate_nothing_says_how_far_along_it_is() -> None:
    corridor = _scan(_wall((-5.0, -1.0), (5.0, -1.0)), _wall((5.0, 1.0), (-5.0, 1.0)))
    closure = _verified(Candidate(0, 20, 3.0), corridor, _scan(_RIGHT, _wall((2.0, 1.0), (-2.0, 1.0))), ahead_m=1.5)
    assert closure is not None
    np.testing.assert_allclose(closure.measured, (1.55, 0.0, 0.0), atol=0.06)
    along, across = closure.information[0, 0], closure.information[1, 1]
    assert along < 1.0 / 1.0**2  # a metre of uncertainty and more
    assert across > 1.0 / 0.01**2


def test_a_place_that_fits_better_than_the_estimate_is_found() -> None:
    closure = _verified(Candidate(0, 20, 3.0), _scan(_RIGHT, _FRONT), _scan(_RIGHT, _FRONT), ahead_m=1.5)
    assert closure is not None
    np.testing.assert_allclose(closure.measured, 0.0, atol=5e-3)


def test_a_partial_view_along_one_wall_does_not_say_how_far_along_it_is() -> None:
    assert _verified(_NEAR, _scan(_RIGHT), _scan(_RIGHT, _UNKNOWN)) is None


def test_a_partial_view_that_stands_where_the_place_was_seen_free_is_another_place() -> None:
    across = _wall((0.8, -0.8), (0.8, 0.8), 90)
    assert _verified(_NEAR, _scan(_RIGHT, _FRONT), _scan(_RIGHT, _FRONT, across)) is None


def test_the_search_wants_less_of_a_place_that_may_be_seen_from_another_side() -> None:
    config = LoopConfig()
    verifier = Verifier(config, ScanMatcher(MatchConfig(), _REACH_CELLS, _CELL_M))
    assert verifier.min_score(_NEAR) == config.min_partial_score
    assert verifier.min_score(Candidate(0, 20, 3.0)) == config.min_score


def test_a_partial_closure_needs_a_second_one_even_where_the_estimate_agrees() -> None:
    first, second = _closure(50, 0.0), _closure(53, 0.0)
    jury = Jury(LoopConfig())
    assert jury.judge(first, _ROW) == []
    assert jury.judge(second, _ROW) == [first, second]


def test_a_closure_that_rests_on_scans_of_another_one_confirms_it_only_where_the_estimate_agrees_too() -> None:
    far, near = Jury(LoopConfig(query_neighbours=1)), Jury(LoopConfig(query_neighbours=1))
    for new in (50, 51, 52):
        assert far.judge(_closure(new, 0.5), _ROW) == []
    first, second = _closure(50, 0.2), _closure(51, 0.2)
    assert near.judge(first, _ROW) == []
    assert near.judge(_closure(50, 0.2), _ROW) == []  # nothing new
    assert near.judge(second, _ROW)[0] is first


def test_closures_that_hold_the_robot_loosely_confirm_others_but_not_each_other() -> None:
    jury = Jury(LoopConfig())
    loose = _closure(50, 0.2, witness=True)
    assert jury.judge(loose, _ROW) == []
    assert jury.judge(_closure(53, 0.2, witness=True), _ROW) == []
    believed = jury.judge(_closure(54, 0.2), _ROW)
    assert loose in believed
    assert len(believed) == 3


@pytest.mark.parametrize("most", [0, 1, 2])
def test_no_more_candidates_are_chosen_than_asked_for_and_none_next_to_another(most: int) -> None:
    near, way_m = np.arange(20), np.full(20, 100.0, np.float64)
    chosen = choose(LoopConfig(max_candidates=most), 50, near, way_m, np.linspace(0.5, 2.4, 20))
    assert [candidate.old for candidate in chosen] == [0, 7][:most]


def test_a_node_whose_place_is_well_known_is_not_searched_for() -> None:
    chosen = choose(LoopConfig(), 50, np.array([3, 30]), np.array([5.0, np.inf]), np.array([1.0, 2.0]))
    assert [candidate.shift_m for candidate in chosen] == [0.0, LoopConfig().max_search_m]


def test_scans_are_joined_in_their_common_frame() -> None:
    keyframe = _keyframe(LineScan(np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])))
    both = joined([(keyframe, np.zeros(3)), (keyframe, np.array([2.0, 1.0, math.pi / 2]))])
    np.testing.assert_allclose(both.points_m, [[1.0, 0.0], [2.0, 2.0]], atol=1e-12)
    np.testing.assert_allclose(both.normals, [[0.0, 1.0], [-1.0, 0.0]], atol=1e-12)
    assert joined([]).points_m.shape == (0, 2)
