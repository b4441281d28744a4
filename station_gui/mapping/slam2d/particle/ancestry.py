"""The paths of all particles as one tree: what they have in common is kept once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_FIRST_ROOM = 4096


class Ancestry:
    """Nodes with a parent and a pose. Branches without a living end are dropped as the tree grows."""

    def __init__(self) -> None:
        self._parent = np.full(_FIRST_ROOM, -1, np.int64)
        self._pose = np.zeros((_FIRST_ROOM, 3))
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def extend(self, ends: NDArray[np.int64], poses: NDArray[np.float64]) -> NDArray[np.int64]:
        """(N,): new ends that hang on `ends`, (N,), -1 for none, at `poses`, (N, 3). No other end lives on."""
        if self._count + len(ends) > len(self._parent):
            ends = self._make_room(ends)
        new = np.arange(self._count, self._count + len(ends))
        self._parent[new] = ends
        self._pose[new] = poses
        self._count += len(ends)
        return new

    def parent(self, node: int) -> int:
        return int(self._parent[: self._count][node])

    def path(self, end: int) -> NDArray[np.float64]:
        """(K, 3): poses from the root to `end`."""
        nodes = []
        node = end
        parents = self._parent
        while node >= 0:
            nodes.append(node)
            node = int(parents[node])
        return np.asarray(self._pose[nodes[::-1]])

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
        parent, pose = np.full(room, -1, np.int64), np.zeros((room, 3))
        parent[: len(keep)] = renamed[self._parent[keep]]
        pose[: len(keep)] = self._pose[keep]
        self._parent, self._pose, self._count = parent, pose, len(keep)
        return np.asarray(renamed[ends])
