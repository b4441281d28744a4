from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.config import GraphSlamConfig
from station_gui.mapping.slam2d.graph_slam import GraphSlam
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.localisation.config import LocalisationConfig, SearchConfig
from station_gui.mapping.slam2d.localisation.query import gather, recent, thinned
from station_gui.mapping.slam2d.localisation.reference import Reference
from station_gui.mapping.slam2d.localisation.relocaliser import Relocaliser
from station_gui.mapping.slam2d.localisation.search import _kernels as search_kernels
from station_gui.mapping.slam2d.localisation.search.places import PlaceSearch, distinct
from station_gui.mapping.slam2d.localisation.verify import _kernels as verify_kernels
from station_gui.mapping.slam2d.localisation.verify.verifier import judge, verify
from station_gui.mapping.slam2d.matching.scan_matcher import to_lines
from station_gui.mapping.slam2d.se2_arrays import compose, compose_all
from station_gui.mapping.slam2d.search.branch_and_bound import build_pyramid
from station_gui.mapping.slam2d.share import Share

FloatArray = NDArray[np.float64]
ScanMaker = Callable[..., PointScan]
_CONFIG = LocalisationConfig()
_PLENTY = 1 << 60  # of units


def _reference(saved: SavedMap) -> Reference:
    graph = GraphSlamConfig()
    in_node = np.array([keyframe.in_node for keyframe in saved.keyframes])
    poses = compose_all(saved.nodes[saved.keyframe_nodes()], in_node)
    reference = Reference(_CONFIG.reference, graph.match, graph.grid, saved.keyframes, poses)
    while not reference.step(_PLENTY):
        pass
    return reference


def _keyframe(scan: PointScan) -> Keyframe:
    lines = to_lines(scan.points_m, scan.origin_m, GraphSlamConfig().normals)
    return Keyframe(
        scan.stamp_s, 0, np.zeros(3), lines.points_m.astype(np.float32), lines.normals.astype(np.float32), scan.origin_m
    )


def _stand(relocaliser: Relocaliser, walls: FloatArray, pose: Pose2, make: ScanMaker, scans: int = 30) -> Pose2 | None:
    """Where the robot is said to be, after some scans at one place."""
    rng = np.random.default_rng(3)
    for k in range(scans):
        found = relocaliser.add(make(walls, pose, rng, Pose2(), 0.1 * k))
        if found is not None:
            return found
    return None


def test_a_robot_put_down_anywhere_is_found_while_it_stands(
    lab: FloatArray, lab_map: SavedMap, places: list[Pose2], scan_from: ScanMaker
) -> None:
    reference = _reference(lab_map)
    for place in places:
        found = _stand(Relocaliser(_CONFIG, reference), lab, place, scan_from)
        assert found is not None
        assert found.distance_m(place) < 0.03
        assert abs(math.remainder(found.theta_rad - place.theta_rad, math.tau)) < math.radians(1.0)


def test_a_room_that_is_not_the_map_is_no_place_in_it(
    lab_map: SavedMap, other_room: FloatArray, scan_from: ScanMaker
) -> None:
    relocaliser = Relocaliser(_CONFIG, _reference(lab_map))
    for pose in (Pose2(2.5, 1.5, 0.3), Pose2(1.2, 2.4, -2.0)):
        assert _stand(relocaliser, other_room, pose, scan_from, scans=40) is None


def test_places_that_look_the_same_are_not_guessed(
    square: FloatArray, lap: Callable[[int], list[Pose2]], scan_from: ScanMaker
) -> None:
    slam = GraphSlam(GraphSlamConfig())
    rng = np.random.default_rng(0)
    for k, pose in enumerate(lap(60)):
        slam.add(scan_from(square, pose, rng, stamp_s=0.1 * k))
    relocaliser = Relocaliser(_CONFIG, _reference(slam.saved()))

    assert _stand(relocaliser, square, Pose2(0.9, 1.0, 0.5), scan_from) is None
    assert len(relocaliser.hypotheses) >= 4
    assert relocaliser.undecided


def test_a_robot_that_sees_nothing_stays_lost(lab_map: SavedMap) -> None:
    relocaliser = Relocaliser(_CONFIG, _reference(lab_map))
    for k in range(20):
        scan = PointScan(0.1 * k, Pose2(0.03 * k, 0.0, 0.0), np.zeros(2), np.zeros((0, 2)))
        assert relocaliser.add(scan) is None


def test_the_same_scans_are_found_at_the_same_place_bit_for_bit(
    lab: FloatArray, lab_map: SavedMap, places: list[Pose2], scan_from: ScanMaker
) -> None:
    first, second = (_stand(Relocaliser(_CONFIG, _reference(lab_map)), lab, places[0], scan_from) for _ in range(2))
    assert first is not None
    assert first == second


def test_the_search_finds_what_looking_everywhere_finds() -> None:
    rng = np.random.default_rng(0)
    rim = 32  # so that no point lies outside
    likelihood = np.pad(rng.integers(0, 120, (40, 48)).astype(np.uint8), rim)
    points = rng.uniform(-0.6, 0.6, (25, 2))
    free = np.pad((rng.random((40, 48)) < 0.7).astype(np.uint8), rim)
    turns, cell_m, keep_level, least = 36, 0.1, 2, 1000
    levels = build_pyramid(likelihood, (0.0, 0.0), cell_m, 4).levels
    free_levels = build_pyramid(free, (0.0, 0.0), cell_m, 4).levels
    found, state = np.zeros((20_000, 4), np.int64), np.zeros(3, np.int64)
    turn, room = 0, np.zeros(25, np.int64)
    while turn < turns:
        turn = search_kernels.search_turns(
            points, levels, free_levels, turn, turns, 7, cell_m, keep_level, least, 10**6, 50, room, found, state
        )
    best: dict[tuple[int, int, int], int] = {}
    for k in range(turns):
        c, s = math.cos(math.tau * k / turns), math.sin(math.tau * k / turns)
        columns = np.floor((c * points[:, 0] - s * points[:, 1]) / cell_m + 0.5).astype(int)
        rows = np.floor((s * points[:, 0] + c * points[:, 1]) / cell_m + 0.5).astype(int)
        for y, x in zip(*np.nonzero(free), strict=True):
            total = int(likelihood[rows + y, columns + x].astype(int).sum())
            if total >= least:
                square = (k, int(x) // 4, int(y) // 4)
                best[square] = max(best.get(square, 0), total)
    kept = {(int(t), int(x) // 4, int(y) // 4): int(total) for t, x, y, total in found[: state[0]]}

    assert len(best) > 20
    assert kept == best


def test_when_there_is_no_room_the_worst_place_gives_way() -> None:
    rng = np.random.default_rng(0)
    likelihood = rng.integers(0, 255, (32, 32)).astype(np.uint8)
    levels = build_pyramid(likelihood, (0.0, 0.0), 0.1, 3).levels
    free = np.ones_like(levels)
    runs = []
    for room in (10, 5000):
        found, state = np.zeros((room, 4), np.int64), np.zeros(3, np.int64)
        search_kernels.search_turns(
            np.zeros((1, 2)), levels, free, 0, 4, 1, 0.1, 1, 1, 10**6, 10**9, np.zeros(1, np.int64), found, state,
        )  # fmt: skip
        runs.append(np.sort(found[: state[0], 3])[::-1])
    np.testing.assert_array_equal(runs[0], runs[1][:10])


def test_the_search_works_in_shares(lab: FloatArray, lab_map: SavedMap, scan_from: ScanMaker) -> None:
    keyframe = _keyframe(scan_from(lab, Pose2(1.0, 1.2, 0.4), np.random.default_rng(0)))
    query = gather([keyframe], np.zeros((1, 3)), 0.04, 700)
    reference = _reference(lab_map)
    results = []
    for units in (10_000, _PLENTY):
        search, share = PlaceSearch(SearchConfig(), reference, query), Share()
        steps = 0
        while not search.ended:
            share.begin(units)
            search.step(share)
            assert share.left > -2 * 10_000
            steps += 1
        results.append((steps, np.array(search.places())))
    assert results[0][0] > 5
    assert results[1][0] == 1
    np.testing.assert_array_equal(results[0][1], results[1][1])
    best = results[0][1][0]
    assert math.hypot(best[0] - 1.0, best[1] - 1.2) < 0.1


def test_a_beam_through_a_wall_cannot_be(lab: FloatArray, lab_map: SavedMap, scan_from: ScanMaker) -> None:
    reference = _reference(lab_map)
    truth = Pose2(1.0, 1.2, 0.4)
    query = gather([_keyframe(scan_from(lab, truth, np.random.default_rng(0)))], np.zeros((1, 3)), 0.04, 700)

    right = judge(_CONFIG.verify, reference, query, truth.as_array())
    moved = judge(_CONFIG.verify, reference, query, (Pose2(-0.6, 0.0, 0.0) @ truth).as_array())
    into = judge(_CONFIG.verify, reference, query, (Pose2(0.6, 0.5, 0.0) @ truth).as_array())

    assert np.mean(right == verify_kernels.FITS) > 0.95
    assert np.mean(moved == verify_kernels.THROUGH_WALL) > 0.2
    assert np.mean(into >= verify_kernels.IN_FREE_SPACE) > 0.3


def test_no_wall_is_missed_where_far_ones_are_skipped(lab: FloatArray, lab_map: SavedMap, scan_from: ScanMaker) -> None:
    reference, rng = _reference(lab_map), np.random.default_rng(1)
    local_map, grid = reference.local_map, reference.grid
    empty = np.full_like(local_map.distance2, 1)
    empty[local_map.distance2 == 0] = 0  # says nowhere that no surfel is near
    query = gather([_keyframe(scan_from(lab, Pose2(1.0, 1.2, 0.4), rng))], np.zeros((1, 3)), 0.04, 700)
    for pose in rng.uniform((0.3, 0.3, -3.0), (3.6, 3.9, 3.0), (30, 3)):
        verdicts = [np.zeros(len(query.points_m), np.uint8) for _ in range(2)]
        for distance2, verdict in zip((local_map.distance2, empty), verdicts, strict=True):
            verify_kernels.judge(
                query.points_m, query.normals, query.scanners_m, pose, 0.06, 0.2, 0.4, 0.35, local_map.origin_x_m,
                local_map.origin_y_m, local_map.cell_m, local_map.nearest, distance2, local_map.reach_cells,
                local_map.surfels, grid.probability, *grid.origin_m, grid.cell_m, verdict,
            )  # fmt: skip
        np.testing.assert_array_equal(*verdicts)
        assert (verdicts[0] == verify_kernels.THROUGH_WALL).any()


def test_what_lies_beyond_the_map_is_not_held_against_a_place(
    lab: FloatArray, lap: Callable[[int], list[Pose2]], scan_from: ScanMaker
) -> None:
    rng = np.random.default_rng(0)
    open_lab = np.delete(lab, 1, axis=0)  # without the wall at x = 3.95 m
    slam = GraphSlam(GraphSlamConfig())
    for k, pose in enumerate(lap(60)):
        slam.add(scan_from(open_lab, pose, rng, stamp_s=0.1 * k))
    truth = Pose2(2.9, 2.6, 0.0)
    seen = scan_from(np.vstack((open_lab, (5.5, 0.0, 5.5, 4.2))), truth, rng)
    query = gather([_keyframe(seen)], np.zeros((1, 3)), 0.04, 700)

    verdicts = judge(_CONFIG.verify, _reference(slam.saved()), query, truth.as_array())

    beyond = truth.apply(query.points_m)[:, 0] > 5.3
    assert np.count_nonzero(beyond) > 20
    assert set(verdicts[beyond].tolist()) == {verify_kernels.UNKNOWN}


def test_a_place_that_is_a_little_off_is_refined(lab: FloatArray, lab_map: SavedMap, scan_from: ScanMaker) -> None:
    reference = _reference(lab_map)
    truth = Pose2(1.0, 1.2, 0.4)
    query = gather([_keyframe(scan_from(lab, truth, np.random.default_rng(0)))], np.zeros((1, 3)), 0.04, 700)
    hypothesis = verify(_CONFIG.verify, reference, query, truth.as_array() + np.array([0.05, -0.04, 0.03]))
    assert np.abs(hypothesis.map_from_trail - truth.as_array()).max() < 0.02
    assert hypothesis.support > 0.9
    assert hypothesis.good_share > 0.95


def test_of_places_next_to_each_other_the_best_stays() -> None:
    poses = np.array([(0, 0, 0), (0.1, 0, 0.05), (0.1, 0, 1.0), (2, 0, 0), (0, 0, math.tau - 0.05)], np.float64)
    assert distinct(poses, SearchConfig()) == [0, 2, 3]
    assert distinct(np.zeros((0, 3)), SearchConfig()) == []
    assert len(distinct(np.column_stack((np.arange(100.0), np.zeros((100, 2)))), SearchConfig(max_places=7))) == 7


def test_points_are_thinned_to_one_per_square() -> None:
    points = np.array([(0.01, 0.01), (0.02, 0.03), (0.11, 0.01), (0.5, 0.5), (0.12, 0.05)])
    assert thinned(points, 0.1, 10).tolist() == [0, 2, 3]
    assert len(thinned(np.random.default_rng(0).uniform(0, 9, (5000, 2)), 0.1, 300)) <= 300


@pytest.mark.parametrize(("way_m", "scans", "first"), [(0.25, 50, 3), (10.0, 50, 0), (10.0, 2, 4), (0.0, 50, 5)])
def test_the_query_is_the_last_part_of_the_way(way_m: float, scans: int, first: int) -> None:
    trajectory = np.column_stack((np.arange(6.0), 0.1 * np.arange(6.0), np.zeros((6, 2))))
    assert recent(trajectory, way_m, scans) == first


def test_somebody_who_stood_round_the_robot_at_first_is_forgotten(
    lab: FloatArray, lab_map: SavedMap, places: list[Pose2], scan_from: ScanMaker
) -> None:
    relocaliser = Relocaliser(replace(_CONFIG, look_again_scans=10), _reference(lab_map))
    shut_in = np.array([(0.3, -0.3, 0.3, 0.3), (-0.3, 0.3, 0.3, 0.3), (-0.3, -0.3, 0.3, -0.3)])
    assert _stand(relocaliser, shut_in, Pose2(), scan_from, scans=4) is None
    found = _stand(relocaliser, lab, places[0], scan_from)
    assert found is not None
    assert found.distance_m(places[0]) < 0.03


def test_hypotheses_outlive_a_trail_that_has_become_long(
    square: FloatArray, lap: Callable[[int], list[Pose2]], scan_from: ScanMaker
) -> None:
    slam = GraphSlam(GraphSlamConfig())
    rng = np.random.default_rng(0)
    for k, pose in enumerate(lap(60)):
        slam.add(scan_from(square, pose, rng, stamp_s=0.1 * k))
    relocaliser = Relocaliser(replace(_CONFIG, longest_trail_scans=12), _reference(slam.saved()))
    way = lap(60)
    for k, pose in enumerate(way[:40]):
        assert relocaliser.add(scan_from(square, pose, rng, Pose2(5.0, 5.0, 1.0) @ pose, 0.1 * k)) is None
    at = np.array([compose(h.map_from_trail, relocaliser.trail_from_robot.as_array()) for h in relocaliser.hypotheses])
    assert len(at) >= 4
    assert np.hypot(at[:, 0] - way[39].x_m, at[:, 1] - way[39].y_m).min() < 0.05


def test_a_map_made_in_small_shares_is_the_same_one(lab_map: SavedMap) -> None:
    graph = GraphSlamConfig()
    in_node = np.array([keyframe.in_node for keyframe in lab_map.keyframes])
    poses = compose_all(lab_map.nodes[lab_map.keyframe_nodes()], in_node)
    made, steps = [], []
    for units in (2_000, _PLENTY):
        reference = Reference(_CONFIG.reference, graph.match, graph.grid, lab_map.keyframes, poses)
        steps.append(1)
        while not reference.step(units):
            steps[-1] += 1
        made.append(reference)
    assert steps[0] > 4 * steps[1]
    np.testing.assert_array_equal(made[0].pyramid.levels, made[1].pyramid.levels)
    np.testing.assert_array_equal(made[0].free, made[1].free)
    np.testing.assert_array_equal(made[0].grid.probability, made[1].grid.probability)
    np.testing.assert_array_equal(made[0].local_map.surfels, made[1].local_map.surfels)
