"""Every scan's place in the graph, and the points of those that are in the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.graph._kernels import place_all
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan

_FIRST_ROOM = 1024


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """A scan that is in the map. `in_node`: (3,), its pose in the frame of its node."""

    stamp_s: float
    node: int
    in_node: NDArray[np.float64]
    points_m: NDArray[np.float32]
    normals: NDArray[np.float32]
    scanner_m: NDArray[np.float64]

    def lines(self) -> LineScan:
        return LineScan(self.points_m.astype(np.float64), self.normals.astype(np.float64))


class Placed:
    """Poses that ride on nodes: a node and a pose in its frame each."""

    def __init__(self) -> None:
        self._node = np.zeros(_FIRST_ROOM, np.int32)
        self._in_node = np.zeros((_FIRST_ROOM, 3))
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, node: int, in_node: NDArray[np.float64]) -> None:
        if self._count == len(self._node):
            self._node = np.concatenate((self._node, np.zeros_like(self._node)))
            self._in_node = np.concatenate((self._in_node, np.zeros_like(self._in_node)))
        self._node[self._count] = node
        self._in_node[self._count] = in_node
        self._count += 1

    def node_of(self, index: int) -> int:
        return int(self._node[: self._count][index])

    @property
    def nodes(self) -> NDArray[np.int32]:
        """(len(self),); a view."""
        return self._node[: self._count]

    def in_node(self, index: int) -> NDArray[np.float64]:
        return np.asarray(self._in_node[: self._count][index])

    def poses(self, nodes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(len(self), 3), map frame; `nodes`: (K, 3), the nodes' poses."""
        poses = np.empty((self._count, 3))
        place_all(nodes, self._node[: self._count], self._in_node[: self._count], poses)
        return poses
