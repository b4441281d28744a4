from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.slam2d.closures.closure import Closure
from station_gui.mapping.slam2d.closures.jury import Jury
from station_gui.mapping.slam2d.config import LoopConfig
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.particle.ancestry import Ancestry
from station_gui.mapping.slam2d.particle.blocks.block_maps import BlockMapConfig, BlockMaps
from station_gui.mapping.slam2d.particle.closing.config import BendConfig
from station_gui.mapping.slam2d.particle.closing.course import Course, closure_chi2, integrated
from station_gui.mapping.slam2d.particle.closing.loop_closer import ClosingConfig, LoopCloser
from station_gui.mapping.slam2d.particle.closing.loop_finder import LoopFinder, Way
from station_gui.mapping.slam2d.se2_arrays import between, compose

FloatArray = NDArray[np.float64]
_NOTHING = np.zeros((0, 2), np.float32)


def _circle(steps: int = 200, radius_m: float = 8.0) -> FloatArray:
    """(steps, 3): once round."""
    angle = np.linspace(0.0, math.tau, steps)
    return np.column_stack((radius_m * np.cos(angle), radius_m * np.sin(angle), angle + math.pi / 2))


def _motions(path: FloatArray) -> FloatArray:
    return np.array([path[0], *[between(a, b) for a, b in itertools.pairwise(path)]])


def _course(path: FloatArray) -> Course:
    course = Course(BendConfig())
    for step, motion in enumerate(_motions(path)):
        course.add_step(step, motion if step else np.zeros(3), np.eye(3) * 1e6, 0.0)
    return course


def _closure(old: int, new: int, measured: FloatArray) -> Closure:
    return Closure(old, new, measured, np.eye(3) * 1e4, searched=True)


def test_a_path_is_what_its_motions_make() -> None:
    path = _circle()
    made = integrated(_motions(path))
    np.testing.assert_allclose(made[:, :2], path[:, :2], atol=1e-9)
    np.testing.assert_allclose(np.cos(made[:, 2] - path[:, 2]), 1.0, atol=1e-12)


def test_nodes_are_a_metre_apart_and_steps_know_theirs() -> None:
    path = _circle()
    course = _course(path)
    lengths = np.hypot(*np.diff(path[course.first_steps, :2], axis=0).T)
    assert 0.95 < lengths.min() <= lengths.max() < 1.3
    nodes = course.node_of_steps(len(path))
    np.testing.assert_array_equal(nodes[course.first_steps], np.arange(course.nodes))
    assert (np.diff(nodes) >= 0).all()


def test_what_lies_far_back_along_the_way_counts_only_once_a_closure_joins_it() -> None:
    course = _course(_circle())
    assert not course.joined(10.0)[0]
    last = course.nodes - 1
    course.closures.append(_closure(0, last, np.zeros(3)))
    joined = course.joined(10.0)
    assert joined[0]
    assert joined[last]
    assert not joined[course.nodes // 2]


def test_a_given_map_is_always_joined_and_in_one_piece() -> None:
    course = Course(BendConfig())
    course.begin_given()
    for step in range(300, 700):
        course.add_step(step, np.array([0.1, 0.0, 0.0]), np.eye(3), 0.0)
    assert course.given == 1
    assert course.first_steps[:2].tolist() == [0, 300]
    assert course.joined(10.0)[0]
    assert not course.joined(10.0)[1]


def test_bending_spreads_the_error_of_a_loop_over_the_whole_way() -> None:
    truth = _circle()
    motions = _motions(truth)
    motions[1:, 2] += math.radians(0.05)  # ten degrees in all
    tracked = integrated(motions)
    course = _course(tracked)
    at = course.first_steps
    closure = _closure(0, course.nodes - 1, between(truth[0], truth[at[-1]]))
    graph = course.graph(tracked[at], motions, (closure,))
    graph.optimise()
    before = np.hypot(*(tracked[at] - truth[at])[:, :2].T)
    after = np.hypot(*(graph.poses - truth[at])[:, :2].T)
    assert before.max() > 1.0
    assert after.max() < 0.25 * before.max()
    assert closure_chi2(closure, graph.poses) < 0.01 * closure_chi2(closure, tracked[at])


def test_a_far_closure_needs_a_second_one_that_says_the_same() -> None:
    poses = np.column_stack((np.arange(60.0), np.zeros(60), np.zeros(60)))
    shift = np.array([0.0, 2.0, 0.1])
    jury = Jury(LoopConfig())
    first = _closure(0, 50, compose(shift, between(poses[0], poses[50])))
    other = _closure(1, 53, np.array([51.0, -4.0, 0.0]))
    corrected = [compose(shift, pose) for pose in poses]
    second = _closure(2, 54, between(poses[2], corrected[54]))

    assert jury.judge(first, poses) == []
    assert jury.judge(other, poses) == []
    assert jury.judge(second, poses) == [first, second]


def test_a_closure_that_the_path_agrees_with_is_believed_at_once() -> None:
    poses = np.column_stack((np.arange(60.0), np.zeros(60), np.zeros(60)))
    closure = _closure(0, 50, between(poses[0], poses[50]) + np.array([0.1, 0.1, 0.0]))
    assert Jury(LoopConfig()).judge(closure, poses) == [closure]


@pytest.mark.parametrize("turn_rad", [0.0, 1.0, -2.5])
def test_the_chi_square_of_a_closure_is_that_of_the_pose_graph(turn_rad: float) -> None:
    poses = np.array([[0.0, 0.0, 0.3], [1.0, 0.0, 0.4], [2.0, 1.0, 0.3 + turn_rad]])
    information = np.diag([4e4, 1e2, 1e3])
    measured = between(poses[0], poses[2]) + np.array([0.02, -0.3, 0.05])
    closure = Closure(0, 2, measured, information, searched=True)
    course = _course(poses)
    graph = course.graph(poses, _motions(poses), (closure,))
    assert closure_chi2(closure, poses) == pytest.approx(float(graph.chi2()[-1]), rel=1e-9)


def test_what_only_confirms_another_closure_bends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    maps = BlockMaps(BlockMapConfig(max_places=10, max_blocks=10), 1)
    closer, path = LoopCloser(ClosingConfig(), maps), _circle()
    keyframes = [Keyframe(0.0, 0, np.zeros(3), _NOTHING, _NOTHING, np.zeros(2)) for _ in path]
    way = Way(closer.course, path, keyframes, [False] * len(path))
    for step, motion in enumerate(_motions(path)):
        closer.course.add_step(step, motion if step else np.zeros(3), np.eye(3) * 1e6, 0.0)
    last = closer.course.nodes - 1
    truth = between(*way.node_poses()[[0, last]])
    pair = [_closure(0, last, truth), replace(_closure(0, last - 1, truth), witness=True)]
    monkeypatch.setattr(LoopFinder, "busy", True)
    monkeypatch.setattr(LoopFinder, "work", lambda self, way: pair[0])
    monkeypatch.setattr(Jury, "judge", lambda self, closure, poses: pair)

    assert closer.work(way, Ancestry(), 0, False) is None

    assert closer.course.closures == pair[:1]
