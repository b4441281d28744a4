"""The paths of all particles as one tree: what they have in common is kept once."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.se2_arrays import between_all, compose_all

FloatArray = NDArray[np.float64]
_FIRST_ROOM = 4096
_Number = TypeVar("_Number", np.int64, np.float64)


class Ancestry:
    """Nodes with a parent, a pose, the motion that led from the parent, and their number of ancestors.

    Branches without a living end are dropped as the tree grows.
    """

    def __init__(self) -> None:
        self._parent = np.full(_FIRST_ROOM, -1, np.int64)
        self._depth = np.zeros(_FIRST_ROOM, np.int64)
        self._pose = np.zeros((_FIRST_ROOM, 3))
        self._motion = np.zeros((_FIRST_ROOM, 3))
        self._name = np.zeros(_FIRST_ROOM, np.int64)
        self._named = 0
        self._count = 0
        self._nodes = np.zeros(0, np.int64)  # of the path that was asked for last

    def __len__(self) -> int:
        return self._count

    def extend(self, ends: NDArray[np.int64], poses: FloatArray) -> NDArray[np.int64]:
        """(N,): new ends that hang on `ends`, (N,), -1 for none, at `poses`, (N, 3). No other end lives on."""
        if self._count + len(ends) > len(self._parent):
            ends = self._make_room(ends)
        new = np.arange(self._count, self._count + len(ends))
        self._parent[new] = ends
        self._pose[new] = poses
        rooted = ends >= 0
        self._depth[new] = np.where(rooted, self._depth[ends] + 1, 0)
        self._motion[new] = np.where(rooted[:, None], between_all(self._pose[ends], poses), 0.0)
        self._name[new] = self._named + np.arange(len(ends))
        self._named += len(ends)
        self._count += len(ends)
        return new

    def parent(self, node: int) -> int:
        return int(self._parent[: self._count][node])

    def name_of_ancestor(self, end: int, depth: int) -> int:
        """Of the node of `depth` on the way from the root to `end`: a number that stays when branches are dropped."""
        node = end
        while self._depth[node] > depth:
            node = int(self._parent[node])
        return int(self._name[node])

    def path(self, end: int) -> FloatArray:
        """(K, 3): poses from the root to `end`."""
        return np.asarray(self._pose[self._way(end)])

    def motions(self, end: int) -> FloatArray:
        """(K, 3): the motions along the path to `end` as they were made: bending does not change them."""
        return np.asarray(self._motion[self._way(end)])

    def bend(self, corrections: FloatArray) -> None:
        """Every node of depth k moves by `corrections[k]`, (D, 3), map frame."""
        depth = self._depth[: self._count]
        self._pose[: self._count] = compose_all(corrections[depth], self._pose[: self._count])

    def _way(self, end: int) -> NDArray[np.int64]:
        """Nodes from the root to `end`; what the path before had in common is taken over."""
        if end < 0:
            return np.zeros(0, np.int64)
        before = self._nodes
        nodes = np.empty(int(self._depth[end]) + 1, np.int64)
        node, depth = end, len(nodes) - 1
        while depth >= 0 and not (depth < len(before) and before[depth] == node):
            nodes[depth] = node
            node = int(self._parent[node])
            depth -= 1
        nodes[: depth + 1] = before[: depth + 1]
        self._nodes = nodes
        return nodes

    def _make_room(self, ends: NDArray[np.int64]) -> NDArray[np.int64]:
        """Forget dead branches; where that is not enough grow. Returns the new names of `ends`."""
        alive = np.zeros(self._count, bool)
        for end in set(ends[ends >= 0].tolist()):
            node = end
            while node >= 0 and not alive[node]:
                alive[node] = True
                node = int(self._parent[node])
        renamed = np.append(np.cumsum(alive) - 1, -1)  # index -1 stays -1
        keep = np.flatnonzero(alive)
        room = len(self._parent) * (2 if 2 * (len(keep) + len(ends)) > len(self._parent) else 1)
        parent = np.full(room, -1, np.int64)
        parent[: len(keep)] = renamed[self._parent[keep]]
        self._parent, self._count = parent, len(keep)
        self._name = _kept(self._name, keep, room)
        self._depth = _kept(self._depth, keep, room)
        self._pose = _kept(self._pose, keep, room)
        self._motion = _kept(self._motion, keep, room)
        self._nodes = np.zeros(0, np.int64)
        return np.asarray(renamed[ends])


def _kept(array: NDArray[_Number], keep: NDArray[np.int64], room: int) -> NDArray[_Number]:
    result = np.zeros((room, *array.shape[1:]), array.dtype)
    result[: len(keep)] = array[keep]
    return result
