"""2D–3D combination, step 1 (paper 1, section 3.3): objects are placed by the pose graph.

The networks of a few observations per place are kept as they came; when the pose graph moves, all are placed again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from shared.geometry.se2 import Pose2, wrap_angle
from shared.messages import ObjectNetwork
from station_gui.mapping.slam2d.base import Slam
from station_gui.mapping.snapshot import ObjectKind, ObjectMap


@dataclass(frozen=True, slots=True)
class CombineConfig:
    keep_every_m: float = 0.10  # a network is kept when the robot has moved so far …
    keep_every_rad: float = 0.17  # … or turned so much since the last one kept
    large_extent_m: float = 1.0  # from here on an object counts as a wall or a large object …
    large_height_m: float = 0.7  # … or from this height on
    max_networks: int = 4000  # the oldest give way


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """One network as the robot saw it: `segments_m` (E, 2, 3) in the robot's frame."""

    scan: int  # index in the SLAM's order
    segments_m: NDArray[np.float64]
    kind: NDArray[np.uint8]
    cluster: NDArray[np.int32]
    clusters: int


class ObjectCombiner:
    """Keeps networks and places them; one thread."""

    def __init__(self, config: CombineConfig) -> None:
        self._config = config
        self._kept: list[_Kept] = []
        self._placed: list[NDArray[np.float32]] = []
        self._placed_revision = 0
        self._last_pose: Pose2 | None = None
        self._map = _EMPTY
        self._changed = False

    def add(self, scan: int, map_from_robot: Pose2, objects: ObjectNetwork) -> None:
        """Take the network that was seen with the scan of this index, unless the robot has hardly moved."""
        if len(objects.edges) == 0 or not self._has_moved(map_from_robot):
            return
        self._last_pose = map_from_robot
        kept = _keep(scan, objects, self._config)
        self._kept.append(kept)
        self._placed.append(_place(kept, map_from_robot))
        if len(self._kept) > self._config.max_networks:
            del self._kept[0], self._placed[0]
        self._changed = True

    def object_map(self, slam: Slam) -> ObjectMap:
        """All objects where the pose graph puts them now."""
        if slam.revision != self._placed_revision:
            self._placed_revision = slam.revision
            self._placed = [_place(kept, slam.pose_of_scan(kept.scan)) for kept in self._kept]
            self._changed = True
        if self._changed and self._kept:
            self._map = self._join()
        self._changed = False
        return self._map

    def _has_moved(self, pose: Pose2) -> bool:
        last = self._last_pose
        if last is None or pose.distance_m(last) >= self._config.keep_every_m:
            return True
        return abs(wrap_angle(pose.theta_rad - last.theta_rad)) >= self._config.keep_every_rad

    def _join(self) -> ObjectMap:
        first = np.cumsum([0] + [kept.clusters for kept in self._kept[:-1]])
        return ObjectMap(
            np.concatenate(self._placed),
            np.concatenate([kept.kind for kept in self._kept]),
            np.concatenate([kept.cluster + offset for kept, offset in zip(self._kept, first, strict=True)]).astype(
                np.int32
            ),
        )


def _keep(scan: int, objects: ObjectNetwork, config: CombineConfig) -> _Kept:
    nodes = objects.nodes_m.astype(np.float64)
    edges = objects.edges.astype(np.int64)
    ones = np.ones(len(edges))
    adjacency = coo_matrix((ones, (edges[:, 0], edges[:, 1])), shape=(len(nodes), len(nodes)))
    count, of_node = connected_components(adjacency, directed=False)
    kind_of_cluster = np.array([_kind(nodes[of_node == c], config) for c in range(count)], np.uint8)
    cluster = of_node[edges[:, 0]].astype(np.int32)
    return _Kept(scan, nodes[edges], kind_of_cluster[cluster], cluster, int(count))


def _kind(nodes_m: NDArray[np.float64], config: CombineConfig) -> ObjectKind:
    extent = nodes_m.max(axis=0) - nodes_m.min(axis=0)
    large = math.hypot(extent[0], extent[1]) >= config.large_extent_m or extent[2] >= config.large_height_m
    return ObjectKind.LARGE if large else ObjectKind.SMALL


def _place(kept: _Kept, map_from_robot: Pose2) -> NDArray[np.float32]:
    """Rotate, then translate (eqs 34 and 35)."""
    placed = map_from_robot.apply_3d(kept.segments_m.reshape(-1, 3)).astype(np.float32).reshape(-1, 2, 3)
    return np.asarray(placed)


_EMPTY = ObjectMap(np.zeros((0, 2, 3), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.int32))
