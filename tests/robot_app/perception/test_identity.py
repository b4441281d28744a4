"""Objects from frame to frame."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_app.perception.config import TrackingConfig
from robot_app.perception.identity import _kernels as kernels
from robot_app.perception.identity.tracker import ObjectTracker
from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork
from tests.shared import samples

HERE = Pose2()
SQUARE = np.array([[2.0, -0.2, 0.0], [2.0, 0.2, 0.0], [2.0, 0.2, 0.4], [2.0, -0.2, 0.4]])
RING = np.array([[0, 1], [1, 2], [2, 3], [0, 3]])


def network(*outlines_m: np.ndarray, open_at: int | None = None) -> ObjectNetwork:
    """Closed outlines of four nodes; the one numbered `open_at` lacks a side."""
    nodes = np.concatenate([np.zeros((0, 3)), *outlines_m])
    edges = [RING[: 3 if k == open_at else 4] + 4 * k for k in range(len(outlines_m))]
    return ObjectNetwork(nodes.astype(np.float32), np.concatenate([np.zeros((0, 2), int), *edges]).astype(np.uint16))


def moved(outline_m: np.ndarray, x_m: float = 0.0, y_m: float = 0.0) -> np.ndarray:
    return outline_m + np.array([x_m, y_m, 0.0])


def noisy(outline_m: np.ndarray, seed: int, sigma_m: float = 0.005) -> np.ndarray:
    return outline_m + np.random.default_rng(seed).normal(0.0, sigma_m, outline_m.shape)


def places_m(tracked: ObjectNetwork) -> np.ndarray:
    """(K, 3): the middle of each object of four nodes, in their order."""
    return tracked.nodes_m.reshape(-1, 4, 3).mean(axis=1)


def seen_from(outlines_m: list[np.ndarray], pose: Pose2) -> ObjectNetwork:
    return network(*(pose.inverse().apply_3d(outline) for outline in outlines_m))


def test_overlap_is_that_of_a_plain_twin() -> None:
    rng = np.random.default_rng(1)
    segments, others = rng.uniform(0, 0.3, (5, 2, 3)), rng.uniform(0, 0.3, (7, 2, 3))
    start, other_start = np.array([0, 2, 5], np.int32), np.array([0, 3, 4, 7], np.int32)
    reach = np.array([0.03, 0.08, 0.05])
    share = np.zeros((2, 3))
    kernels.measure_overlap(
        segments, start, others, other_start, reach, 0.03, np.zeros((2, 2, 3)), np.zeros((3, 2, 3)), share
    )
    for k in range(2):
        points = []
        for a, b in segments[start[k] : start[k + 1]]:
            parts = max(1, math.ceil(np.linalg.norm(b - a) / 0.03))
            points += [a + (part + 0.5) / parts * (b - a) for part in range(parts)]
        for o in range(3):
            near = 0
            for point in points:
                gaps = []
                for a, b in others[other_start[o] : other_start[o + 1]]:
                    t = np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
                    gaps.append(np.linalg.norm(a + t * (b - a) - point))
                near += min(gaps) <= reach[o]
            assert share[k, o] == pytest.approx(near / len(points))


def test_what_lies_along_something_whole_before_it_is_not_whole() -> None:
    lines = np.zeros((5, 2, 3))
    lines[:, 1, 0] = 1.0
    lines[1:, :, 1] = [[0.025], [0.05], [1.0], [1.0]]  # beside the first; beside the second alone; and elsewhere
    lines[4, 1, 0] = 1.5  # a third of it reaches beyond the fourth
    start, reach_m = np.arange(6, dtype=np.int32), np.full(5, 0.03)
    for share, expected in ((0.8, [1, 0, 1, 1, 1]), (0.6, [1, 0, 1, 1, 0])):
        whole = np.full(5, 7, np.uint8)
        kernels.mark_whole(lines, start, reach_m, share, 0.03, np.zeros((5, 2, 3)), whole)
        assert whole.tolist() == expected


def test_a_still_scene_with_noise_gives_the_same_network_bit_for_bit() -> None:
    tracker = ObjectTracker(TrackingConfig())
    boxes = [SQUARE, moved(SQUARE, 0.5, 1.0)]
    frames = [tracker.update(network(*(noisy(box, 10 * k + i) for i, box in enumerate(boxes))), HERE) for k in range(9)]
    for frame in frames[1:]:
        assert frame.nodes_m.tobytes() == frames[0].nodes_m.tobytes()
        assert frame.edges.tobytes() == frames[0].edges.tobytes()


def test_objects_keep_their_order_while_the_robot_drives_and_turns() -> None:
    tracker = ObjectTracker(TrackingConfig())
    boxes = [SQUARE, moved(SQUARE, 0.5, 1.0), moved(SQUARE, 0.2, -1.2)]
    for k in range(30):
        pose = Pose2(0.02 * k, 0.01 * k, 0.01 * k)
        tracked = tracker.update(seen_from([noisy(box, k) for box in boxes], pose), pose)
        at_m = pose.apply_3d(places_m(tracked))
        assert np.abs(at_m - [box.mean(axis=0) for box in boxes]).max() < 0.03


def test_an_object_that_grows_is_shown_anew_with_the_nodes_that_stay_in_their_places() -> None:
    tracker = ObjectTracker(TrackingConfig())
    before = tracker.update(network(SQUARE, open_at=0), HERE)
    taller = noisy(SQUARE, 1) + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0.4], [0, 0, 0.4]])
    after = tracker.update(network(taller), HERE)
    np.testing.assert_array_equal(after.nodes_m[:2], before.nodes_m[:2])
    assert after.nodes_m[:, 2].max() > 0.7


def test_a_part_that_is_missing_for_a_few_frames_stays_and_then_goes() -> None:
    config = TrackingConfig(patience_frames=3)
    tracker = ObjectTracker(config)
    half = ObjectNetwork(SQUARE.astype(np.float32), np.array([[0, 1], [1, 2]], np.uint16))
    for _ in range(4):
        tracker.update(network(SQUARE), HERE)
    sides = [len(tracker.update(half, HERE).edges) for _ in range(5)]
    assert sides == [4, 4, 4, 2, 2]


def test_an_object_that_is_missing_for_a_few_frames_stays_and_then_goes_and_is_known_when_it_comes_back() -> None:
    tracker = ObjectTracker(TrackingConfig(patience_frames=3))
    other = moved(SQUARE, 0.0, 2.0)
    for _ in range(4):
        tracker.update(network(SQUARE, other), HERE)
    shown = [len(places_m(tracker.update(network(other), HERE))) for _ in range(5)]
    assert shown == [2, 2, 2, 1, 1]
    back = tracker.update(network(other, SQUARE), HERE)
    np.testing.assert_allclose(back.nodes_m, np.concatenate((SQUARE, other)), atol=1e-6)


def test_what_was_seen_once_leaves_at_once() -> None:
    tracker = ObjectTracker(TrackingConfig())
    tracker.update(network(SQUARE), HERE)
    assert len(tracker.update(network(), HERE).nodes_m) == 0


def test_an_object_that_moved_is_another_one() -> None:
    tracker = ObjectTracker(TrackingConfig())
    tracker.update(network(SQUARE), HERE)
    tracked = tracker.update(network(moved(SQUARE, 0.0, 1.0)), HERE)
    np.testing.assert_allclose(tracked.nodes_m, moved(SQUARE, 0.0, 1.0), atol=1e-6)
    assert len(tracker._known) == 2


def test_a_part_of_what_is_shown_is_not_shown_twice() -> None:
    tracker = ObjectTracker(TrackingConfig())
    tracker.update(network(SQUARE), HERE)
    halves = ObjectNetwork(
        np.concatenate((SQUARE[:2], SQUARE[2:])).astype(np.float32), np.array([[0, 1], [2, 3]], np.uint16)
    )
    tracked = tracker.update(halves, HERE)
    assert len(tracked.nodes_m) == 4
    assert len(tracked.edges) == 4


def test_what_is_seen_from_nearby_replaces_what_was_seen_from_afar() -> None:
    tracker = ObjectTracker(TrackingConfig())
    far = noisy(SQUARE, 3, 0.01)
    tracker.update(network(far), HERE)
    near = Pose2(1.2, 0.0, 0.0)
    tracked = tracker.update(seen_from([SQUARE], near), near)
    np.testing.assert_allclose(near.apply_3d(tracked.nodes_m), SQUARE, atol=1e-6)


def test_memory_is_bounded_and_what_was_not_seen_for_long_is_forgotten_first() -> None:
    tracker = ObjectTracker(TrackingConfig(max_objects=5, patience_frames=0))
    for k in range(40):
        tracked = tracker.update(network(SQUARE, moved(SQUARE, 0.0, 1.0 + k)), HERE)
        np.testing.assert_allclose(tracked.nodes_m[:4], SQUARE, atol=1e-6)
    assert len(tracker._known) == 5


def test_what_is_remembered_gives_way_when_there_are_too_many_nodes() -> None:
    tracker = ObjectTracker(TrackingConfig(most_nodes=9))
    old, far, near = SQUARE, moved(SQUARE, 2.0, 1.0), moved(SQUARE, 0.0, -1.0)
    for _ in range(6):
        tracker.update(network(old), HERE)
    tracked = tracker.update(network(far, near), HERE)
    np.testing.assert_allclose(tracked.nodes_m, np.concatenate((far, near)), atol=1e-6)
    tracked = tracker.update(network(old, far, near), HERE)
    np.testing.assert_allclose(tracked.nodes_m, np.concatenate((old, near)), atol=1e-6)


def test_the_most_alike_are_matched_first_and_each_but_once() -> None:
    owners = np.full(3, -1, np.int32)
    alike = np.array([[0.6, 0.5], [0.9, 0.7], [0.3, 0.2]])
    kernels.match_most_alike(alike, 0.25, owners)
    assert owners.tolist() == [1, 0, -1]


def test_an_observation_is_steadied_where_it_was_seen_from(rng: np.random.Generator) -> None:
    tracker, poses = ObjectTracker(TrackingConfig()), (Pose2(), Pose2(0.3, 0.1, 0.2))
    seen = [
        replace(
            samples.observation(rng),
            odom_from_robot=pose,
            objects=seen_from([noisy(SQUARE, seed)], pose),
            has_objects=True,
        )
        for seed, pose in enumerate(poses)
    ]
    first, second = (tracker.steadied(each) for each in seen)
    first_m, second_m = (each.odom_from_robot.apply_3d(each.objects.nodes_m) for each in (first, second))
    np.testing.assert_allclose(first_m, second_m, atol=1e-6)


def test_where_no_image_was_looked_at_nothing_is_steadied(rng: np.random.Generator) -> None:
    blind = replace(samples.observation(rng, nodes=0), has_objects=False)
    assert ObjectTracker(TrackingConfig()).steadied(blind) is blind


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_any_networks_give_sound_networks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tracker = ObjectTracker(TrackingConfig(max_objects=8))
    for _ in range(6):
        count = int(rng.integers(0, 12))
        pairs = rng.integers(0, max(count, 1), (int(rng.integers(0, 15)) if count > 1 else 0, 2))
        edges = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
        frame = ObjectNetwork(rng.uniform(0, 1, (count, 3)).astype(np.float32), edges.astype(np.uint16))
        tracked = tracker.update(frame, Pose2(*rng.uniform(-1, 1, 3)))
        assert len(tracked.nodes_m) <= TrackingConfig().most_nodes
        assert np.isfinite(tracked.nodes_m).all()
        assert len(tracked.edges) == 0 or tracked.edges.max() < len(tracked.nodes_m)
