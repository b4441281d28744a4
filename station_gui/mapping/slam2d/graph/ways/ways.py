"""Shortest ways along the edges of a growing graph."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.graph.ways import _kernels
from station_gui.mapping.slam2d.share import Share, Task

_FIRST_ROOM = 256
_ALL_AT_ONCE = 1 << 60
_Number = TypeVar("_Number", bound=np.generic)


class _Scratch:
    """What one run writes: it may rest while the other kind of run is made."""

    def __init__(self) -> None:
        self.distance = np.zeros(_FIRST_ROOM)
        self.reached = np.zeros(_FIRST_ROOM, np.int64)
        self.asked = np.zeros(_FIRST_ROOM, np.int64)
        self.settled = np.zeros(_FIRST_ROOM, np.int32)
        self.keys = np.zeros(2 * _FIRST_ROOM + 1)
        self.waiting = np.zeros(2 * _FIRST_ROOM + 1, np.int32)
        self.state = np.zeros(8, np.int64)

    def double_nodes(self) -> None:
        self.distance, self.settled = _doubled(self.distance), _doubled(self.settled)
        self.reached, self.asked = _doubled(self.reached), _doubled(self.asked)

    def double_edges(self) -> None:
        self.keys, self.waiting = _doubled(self.keys), _doubled(self.waiting)

    def begin(self, node: int, wanted: NDArray[np.int32]) -> None:
        _kernels.begin_ways(node, wanted, self.distance, self.reached, self.asked, self.keys, self.waiting, self.state)


class Ways:
    """Takes edges as they come and answers from one node at a time; memory is kept from one answer to the next."""

    def __init__(self) -> None:
        self.nodes = 0
        self._edges = 0
        self._first_half = np.full(_FIRST_ROOM, -1, np.int32)
        self._next_half = np.full(2 * _FIRST_ROOM, -1, np.int32)
        self._ends = np.zeros((_FIRST_ROOM, 2), np.int32)
        self._length_m = np.zeros(_FIRST_ROOM)
        self._near, self._far = _Scratch(), _Scratch()

    @property
    def length_m(self) -> NDArray[np.float64]:
        """(edges,): a view."""
        return self._length_m[: self._edges]

    def add_node(self) -> None:
        if self.nodes == len(self._first_half):
            self._first_half = np.concatenate((self._first_half, np.full_like(self._first_half, -1)))
            self._near.double_nodes()
            self._far.double_nodes()
        self.nodes += 1

    def add_edge(self, i: int, j: int, length_m: float) -> None:
        if self._edges == len(self._ends):
            self._ends, self._length_m = _doubled(self._ends), _doubled(self._length_m)
            self._next_half = _doubled(self._next_half)
            self._near.double_edges()
            self._far.double_edges()
        e = self._edges
        self._ends[e] = i, j
        self._length_m[e] = length_m
        for half, node in ((2 * e, i), (2 * e + 1, j)):
            self._next_half[half] = self._first_half[node]
            self._first_half[node] = half
        self._edges += 1

    def near(self, node: int, limit_m: float, most: int) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """The nodes within `limit_m` along the edges, nearest first, `most` of them: (K,) and their distances (K,)."""
        scratch = self._near
        scratch.begin(node, np.zeros(0, np.int32))
        scratch.state[_kernels.WANTED] = 1  # there is always one more to ask for
        self._settle(scratch, _ALL_AT_ONCE, self.nodes, limit_m, min(most, self.nodes))
        found = scratch.settled[: scratch.state[_kernels.SETTLED]].copy()
        return found, scratch.distance[found]

    def measure(
        self, share: Share, node: int, wanted: NDArray[np.int32], limit_m: float, distance_m: NDArray[np.float64]
    ) -> Task:
        """`distance_m` (K,) becomes the ways from `node` to `wanted` (K,), infinite beyond `limit_m`.

        Only nodes up to the greatest of them are gone through, so that what comes meanwhile changes nothing.
        One such task at a time.
        """
        scratch = self._far
        known = max(node, int(wanted.max(initial=0))) + 1
        scratch.begin(node, wanted)
        yield from share.spread(
            lambda _, budget: self._settle(scratch, budget, known, limit_m, known), scratch.state, 1
        )
        there = (scratch.reached[wanted] == scratch.state[_kernels.STAMP]) & (scratch.distance[wanted] <= limit_m)
        distance_m[:] = np.where(there, scratch.distance[wanted], np.inf)

    def _settle(self, scratch: _Scratch, budget: int, known: int, limit_m: float, most: int) -> int:
        return _kernels.settle(
            known, self._first_half, self._next_half, self._ends, self._length_m, limit_m, scratch.distance,
            scratch.reached, scratch.asked, scratch.keys, scratch.waiting, scratch.settled[:most], scratch.state,
            budget,
        )  # fmt: skip


def _doubled(array: NDArray[_Number]) -> NDArray[_Number]:
    return np.concatenate((array, np.zeros_like(array)))
