from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork
from station_gui.mapping.objects.combine import CombineConfig, ObjectCombiner
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.base import Slam
from station_gui.mapping.snapshot import GridMap, ObjectKind


class Poses:
    """A SLAM that believes what it is told."""

    def __init__(self) -> None:
        self.poses: dict[int, Pose2] = {}
        self.revision = 0

    def pose_of_scan(self, index: int) -> Pose2:
        return self.poses[index]

    def add(self, scan: PointScan) -> Pose2:
        raise NotImplementedError

    def finish(self) -> None:
        raise NotImplementedError

    def trajectory(self) -> NDArray[np.float64]:
        raise NotImplementedError

    def closures(self) -> NDArray[np.int32]:
        raise NotImplementedError

    def grid(self) -> GridMap:
        raise NotImplementedError


def outline(x_m: float, size_m: float, height_m: float) -> ObjectNetwork:
    """A box's front: three connections."""
    nodes = np.array([[x_m, 0, 0], [x_m, 0, height_m], [x_m, size_m, height_m], [x_m, size_m, 0]], np.float32)
    return ObjectNetwork(nodes, np.array([[0, 1], [1, 2], [2, 3]], np.uint16))


@pytest.fixture
def slam() -> Poses:
    return Poses()


def combine(slam: Slam, *seen: tuple[Pose2, ObjectNetwork], config: CombineConfig | None = None) -> ObjectCombiner:
    combiner = ObjectCombiner(config or CombineConfig())
    for i, (pose, objects) in enumerate(seen):
        slam.poses[i] = pose  # type: ignore[attr-defined]
        combiner.add(i, pose, objects)
    return combiner


def test_objects_are_rotated_and_moved_with_the_robot(slam: Poses) -> None:
    combiner = combine(slam, (Pose2(1.0, 2.0, np.pi / 2), outline(1.0, 0.3, 0.4)))
    placed = combiner.object_map(slam).segments_m
    np.testing.assert_allclose(placed[0], [[1.0, 3.0, 0.0], [1.0, 3.0, 0.4]], atol=1e-6)


def test_a_closure_places_everything_again(slam: Poses) -> None:
    combiner = combine(slam, (Pose2(), outline(1.0, 0.3, 0.4)))
    combiner.object_map(slam)
    slam.poses[0] = Pose2(0.0, 0.5, 0.0)
    slam.revision += 1
    np.testing.assert_allclose(combiner.object_map(slam).segments_m[0, 0], [1.0, 0.5, 0.0], atol=1e-6)


def test_a_robot_that_stands_adds_nothing_again(slam: Poses) -> None:
    combiner = combine(slam, *[(Pose2(), outline(1.0, 0.3, 0.4))] * 20)
    assert len(combiner.object_map(slam).segments_m) == 3


def test_walls_are_told_from_small_objects_and_clusters_from_one_another(slam: Poses) -> None:
    combiner = combine(slam, (Pose2(), outline(1.0, 0.3, 0.4)), (Pose2(0.5, 0, 0), outline(2.0, 2.5, 1.2)))
    objects = combiner.object_map(slam)
    assert objects.kind.tolist() == [ObjectKind.SMALL] * 3 + [ObjectKind.LARGE] * 3
    assert objects.cluster.tolist() == [0, 0, 0, 1, 1, 1]


def test_the_number_of_networks_has_a_bound_and_the_oldest_give_way(slam: Poses) -> None:
    seen = [(Pose2(0.2 * i, 0, 0), outline(1.0, 0.3, 0.4)) for i in range(20)]
    combiner = combine(slam, *seen, config=CombineConfig(max_networks=5))
    placed = combiner.object_map(slam).segments_m
    assert len(placed) == 15
    assert placed[:, :, 0].min() == pytest.approx(1.0 + 0.2 * 15)


def test_without_objects_the_map_of_objects_is_empty(slam: Poses) -> None:
    combiner = combine(slam, (Pose2(), ObjectNetwork()))
    assert combiner.object_map(slam).segments_m.shape == (0, 2, 3)
