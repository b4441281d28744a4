from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation, ScanGeometry
from station_gui.mapping.objects.combine import ObjectCombiner
from station_gui.mapping.objects.config import CombineConfig, ReferenceConfig
from station_gui.mapping.objects.fusing.fused_edges import Edges
from station_gui.mapping.objects.reference import aligned
from station_gui.mapping.slam2d.base import Slam
from station_gui.mapping.snapshot import GridMap, ObjectKind, ObjectMap

STEP_1 = CombineConfig(steps=(1,))
FUSED = CombineConfig(steps=(1, 2))
BEAMS = 241
GEOMETRY = ScanGeometry(math.radians(-120), math.radians(1), 0.0, 0.06, 4.0, Pose2())
EMPTY_GRID = GridMap(np.full((10, 10), 0.5, np.float32), (-5.0, -5.0), 0.02)


class Poses:
    """A SLAM that believes what it is told."""

    def __init__(self) -> None:
        self.poses: dict[int, Pose2] = {}
        self.revision = 0

    def pose_of_scan(self, index: int) -> Pose2:
        return self.poses[index]


def front(x_m: float, low_y_m: float, high_y_m: float, height_m: float) -> ObjectNetwork:
    """A box's front as it is seen from the origin: two upright edges and the upper one."""
    nodes = [[x_m, low_y_m, 0], [x_m, low_y_m, height_m], [x_m, high_y_m, height_m], [x_m, high_y_m, 0]]
    return ObjectNetwork(np.array(nodes, np.float32), np.array([[0, 1], [1, 2], [2, 3]], np.uint16))


def seen_from(pose: Pose2, network: ObjectNetwork) -> ObjectNetwork:
    """The same things in the frame of a robot that stands elsewhere."""
    return ObjectNetwork(pose.inverse().apply_3d(network.nodes_m).astype(np.float32), network.edges)


def observation(objects: ObjectNetwork, stamp_s: float = 0.0, range_m: float = 3.5) -> Observation:
    ranges = np.full(BEAMS, range_m, np.float32)
    return Observation(0, stamp_s, Pose2(), 0.0, 0.0, GEOMETRY, ranges, objects, True)


class Rig:
    """A combiner and the SLAM that it asks."""

    def __init__(self, config: CombineConfig) -> None:
        self.slam = Poses()
        self.combiner = ObjectCombiner(config)
        self.scans = 0

    def see(self, pose: Pose2, objects: ObjectNetwork, range_m: float = 3.5) -> None:
        self.slam.poses[self.scans] = pose
        seen = observation(objects, 0.1 * self.scans, range_m)
        self.combiner.add(self.scans, pose, seen, self._slam())
        self.scans += 1

    def map(self, grid: GridMap = EMPTY_GRID) -> ObjectMap:
        return self.combiner.object_map(self._slam(), grid)

    def _slam(self) -> Slam:
        return self.slam  # type: ignore[return-value]


def drive_past(rig: Rig, network: ObjectNetwork, places: int = 6, deviation_m: float = 0.0) -> None:
    rng = np.random.default_rng(1)
    for k in range(places):
        pose = Pose2(0.11 * k, 0.0, 0.0)
        seen = seen_from(pose, network)
        noise = rng.normal(0, deviation_m, seen.nodes_m.shape).astype(np.float32)
        rig.see(pose, ObjectNetwork(seen.nodes_m + noise, seen.edges))


def test_step_1_alone_shows_every_network_where_the_pose_graph_puts_it() -> None:
    rig = Rig(STEP_1)
    rig.see(Pose2(1.0, 2.0, np.pi / 2), front(1.0, 0.0, 0.3, 0.4))
    rig.see(Pose2(1.0, 2.2, np.pi / 2), front(1.0, 0.0, 0.3, 0.4))
    placed = rig.map()
    np.testing.assert_allclose(placed.segments_m[0], [[1.0, 3.0, 0.0], [1.0, 3.0, 0.4]], atol=1e-6)
    assert placed.cluster.tolist() == [0, 0, 0, 1, 1, 1]
    rig.slam.poses[0] = Pose2(0.0, 0.0, 0.0)
    np.testing.assert_allclose(rig.map().segments_m[0, 0], [1.0, 0.0, 0.0], atol=1e-6)


def test_the_number_of_networks_has_a_bound_and_the_oldest_give_way() -> None:
    rig = Rig(replace(STEP_1, most_networks=5))
    drive_past(rig, front(2.0, 0.0, 0.3, 0.4), places=20)
    assert len(rig.map().segments_m) == 15


def test_the_same_object_seen_from_many_places_is_one() -> None:
    rig = Rig(FUSED)
    drive_past(rig, front(2.0, -0.2, 0.2, 0.3), deviation_m=0.004)
    placed = rig.map()
    assert len(placed.segments_m) == 3
    upright = placed.segments_m[np.abs(placed.segments_m[:, 1, 2] - placed.segments_m[:, 0, 2]) > 0.1]
    assert np.sort(upright[:, :, 1].mean(axis=1)) == pytest.approx([-0.2, 0.2], abs=0.006)
    assert upright[:, 1, 2] == pytest.approx([0.3, 0.3], abs=0.01)
    assert set(placed.kind.tolist()) == {ObjectKind.SMALL}


def test_how_high_a_thing_reaches_is_known_from_afar_when_it_is_found_from_near() -> None:
    def sides(height_m: float) -> ObjectNetwork:
        high = front(3.2, -0.2, 0.2, height_m)
        return ObjectNetwork(high.nodes_m, high.edges[[0, 2]])

    rig = Rig(FUSED)
    for k in range(4):
        rig.see(Pose2(0.06 * k, 0.0, 0.0), seen_from(Pose2(0.06 * k, 0.0, 0.0), sides(1.3)))
    assert len(rig.map().segments_m) == 0
    for k in range(4):
        rig.see(Pose2(1.2 + 0.06 * k, 0.0, 0.0), seen_from(Pose2(1.2 + 0.06 * k, 0.0, 0.0), sides(0.9)))
    assert rig.map().segments_m[:, 1, 2] == pytest.approx([1.3, 1.3], abs=0.01)


def test_what_was_seen_once_is_noise() -> None:
    rig = Rig(FUSED)
    rig.see(Pose2(), front(2.0, -0.2, 0.2, 0.3))
    assert len(rig.map().segments_m) == 0


def test_a_robot_that_stands_adds_no_views() -> None:
    rig = Rig(FUSED)
    for _ in range(8):
        rig.see(Pose2(), front(2.0, -0.2, 0.2, 0.3))
    assert len(rig.map().segments_m) == 0


def test_a_closure_places_everything_again_in_shares() -> None:
    rig = Rig(replace(FUSED, edges_at_once=1))
    drive_past(rig, front(2.0, -0.2, 0.2, 0.3))
    rig.slam.poses = {k: Pose2(0.0, 1.0, 0.0) @ pose for k, pose in rig.slam.poses.items()}
    rig.slam.revision += 1
    last = rig.slam.poses[rig.scans - 1]
    moved = [y > 1.0 for y in rig.map().segments_m[:, :, 1].mean(axis=1)]
    assert not any(moved)
    for _ in range(3):
        rig.see(last, ObjectNetwork())
    assert rig.map().segments_m[:, :, 1].mean() == pytest.approx(1.0, abs=0.01)


def test_a_closure_is_followed_without_a_depth_image_too() -> None:
    rig = Rig(FUSED)
    drive_past(rig, front(2.0, -0.2, 0.2, 0.3))
    rig.slam.poses = {k: Pose2(0.0, 1.0, 0.0) @ pose for k, pose in rig.slam.poses.items()}
    rig.slam.revision += 1
    blind = replace(observation(ObjectNetwork()), has_objects=False)
    rig.combiner.add(rig.scans, Pose2(), blind, rig.slam)  # type: ignore[arg-type]
    assert rig.map().segments_m[:, :, 1].mean() == pytest.approx(1.0, abs=0.01)


def test_what_moved_away_goes_in_the_end() -> None:
    rig = Rig(FUSED)
    drive_past(rig, front(2.0, -0.2, 0.2, 0.3))
    assert len(rig.map().segments_m) == 3
    for k in range(60):
        rig.see(Pose2(0.4 + 0.11 * (k % 2), 0.0, 0.0), ObjectNetwork())
    assert len(rig.map().segments_m) == 0


def test_what_is_hidden_stays() -> None:
    rig = Rig(FUSED)
    drive_past(rig, front(2.0, -0.2, 0.2, 0.3))
    for k in range(60):
        rig.see(Pose2(0.4 + 0.11 * (k % 2), 0.0, 0.0), ObjectNetwork(), range_m=0.5)
    assert len(rig.map().segments_m) == 3


def test_two_fronts_that_stand_behind_one_another_stay_two() -> None:
    rig = Rig(FUSED)
    near, far = front(1.9, -0.4, 0.0, 0.3), front(2.0, 0.0, 0.4, 0.4)
    drive_past(rig, joined(near, far))
    assert len(rig.map().segments_m) == 6


def test_the_same_sequence_gives_the_same_map_bit_for_bit_however_often_it_is_looked_at() -> None:
    maps = []
    for looks in (1, 5):
        rig = Rig(FUSED)
        for _ in range(looks):
            rig.map()
        drive_past(rig, front(2.0, -0.2, 0.2, 0.3), deviation_m=0.005)
        maps.append(rig.map())
    np.testing.assert_array_equal(maps[0].segments_m, maps[1].segments_m)


def test_steps_that_need_others_are_refused() -> None:
    for steps in ((2,), (1, 3), (1, 2, 5), (1, 6)):
        with pytest.raises(ValueError, match="steps"):
            CombineConfig(steps=steps)


def joined(a: ObjectNetwork, b: ObjectNetwork) -> ObjectNetwork:
    return ObjectNetwork(
        np.concatenate((a.nodes_m, b.nodes_m)), np.concatenate((a.edges, b.edges + np.uint16(len(a.nodes_m))))
    )


def test_an_upright_edge_that_was_seen_from_far_alone_is_not_believed() -> None:
    post = ObjectNetwork(np.array([[3.0, 0, 0], [3.0, 0, 0.6]], np.float32), np.array([[0, 1]], np.uint16))
    rig = Rig(FUSED)
    for k in range(3):
        pose = Pose2(0.06 * k - 0.3, 0, 0)
        rig.see(pose, seen_from(pose, post))
    assert len(rig.map().segments_m) == 0
    for k in range(3):
        pose = Pose2(0.06 * k + 0.6, 0, 0)
        rig.see(pose, seen_from(pose, post))
    assert len(rig.map().segments_m) == 1


def test_an_edge_comes_to_the_mean_of_its_own_place_and_its_lines() -> None:
    ends_m = np.array([[[0.2, 0.02, 0.5], [0.8, 0.02, 0.5]], [[0.0, 0.02, 0.0], [0.0, 0.02, 0.5]]])
    edges = Edges(ends_m, np.array([False, True]), np.full(2, 9))
    line_m = np.array([[[0.0, 0.0], [1.0, 0.0]]])
    moved = aligned(edges, line_m, ReferenceConfig(line_weight=0.5))
    np.testing.assert_allclose(moved.ends_m[:, :, 1], 0.01, atol=1e-12)
    np.testing.assert_array_equal(moved.ends_m[:, :, [0, 2]], ends_m[:, :, [0, 2]])
