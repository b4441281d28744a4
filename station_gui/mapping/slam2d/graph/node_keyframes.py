"""The scans that are in the map, by the nodes of the graph that they hang on."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.slam2d.keyframes import Keyframe, Placed


class NodeKeyframes:
    """`all`: in the order they came; `by_node`: those of each node."""

    def __init__(self) -> None:
        self.all: list[Keyframe] = []
        self.by_node: list[list[Keyframe]] = []
        self._places = Placed()
        self._first: list[int] = []  # of each node

    def __len__(self) -> int:
        return len(self.all)

    def load(self, saved: SavedMap) -> None:
        """Into an empty one."""
        self.by_node.extend([] for _ in range(len(saved.nodes)))
        for keyframe in saved.keyframes:
            self.append(keyframe)
        first = np.searchsorted(saved.keyframe_nodes(), np.arange(len(saved.nodes)))
        self._first.extend(np.minimum(first, len(saved.keyframes) - 1).tolist())

    def add_node(self) -> None:
        self.by_node.append([])
        self._first.append(len(self.all))

    def append(self, keyframe: Keyframe) -> None:
        self.all.append(keyframe)
        self._places.append(keyframe.node, keyframe.in_node)
        self.by_node[keyframe.node].append(keyframe)

    @property
    def nodes(self) -> NDArray[np.int32]:
        """(K,): the node of each; a view."""
        return self._places.nodes

    def poses(self, nodes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(K, 3), map frame; `nodes`: (N, 3), the nodes' poses."""
        return self._places.poses(nodes)

    def trajectory(self, nodes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(K, 4): stamp, and pose as of `poses`."""
        return np.column_stack((np.array([keyframe.stamp_s for keyframe in self.all]), self.poses(nodes)))

    def first_of(self, pairs: Iterable[tuple[int, int]]) -> NDArray[np.int32]:
        """(P, 2): of pairs of nodes, the first keyframe of each."""
        return np.array([(self._first[a], self._first[b]) for a, b in pairs], np.int32).reshape(-1, 2)
