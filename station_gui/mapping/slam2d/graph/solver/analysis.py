"""In which order the unknowns of a pose graph are eliminated, and which blocks their factor then has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.graph.solver import _kernels
from station_gui.mapping.slam2d.share import Share, Task

_FIRST_ROOM = 256
_LIST_ROOM = 4  # neighbours that a list has room for at first
_POOL_PER_NODE = 64

IndexArray = NDArray[np.int32]


class Analysis:
    """Minimum degree (Tinney and Walker 1967). Unknown k is node k + 1: node 0 is held.

    After `run`, of `unknowns` unknowns: `position` (unknowns,) in the order of elimination; column k of the factor
    has the rows `rows[column_start[k] : column_start[k + 1]]`, positions too; `slots` (edges,): the block that the
    ends of an edge share, -1 for none. All arrays have more room than that.
    """

    def __init__(self, share: Share) -> None:
        self._share = share
        self.unknowns = 0
        self.blocks = 0
        self.position: IndexArray = np.zeros(0, np.int32)
        self.column_start: IndexArray = np.zeros(1, np.int32)
        self.rows: IndexArray = np.zeros(0, np.int32)
        self.slots: IndexArray = np.zeros(0, np.int32)
        self._order = self._start = self._length = self._room = self.position
        self._head = self._after = self._before = self.position
        self._mark: NDArray[np.int64] = np.zeros(0, np.int64)
        self._pool: IndexArray = np.zeros(0, np.int32)

    def run(self, unknowns: int, ends: IndexArray, edges: int) -> Task:
        """`ends`: (edges or more, 2), nodes."""
        self.unknowns = unknowns
        self._reserve(unknowns, edges)
        yield from self._list_neighbours(ends, edges)
        yield from self._eliminate()
        state = _new_state()
        yield from self._share.spread(
            lambda s, b: _kernels.sort_rows(unknowns, self.position, self.column_start, self.rows, s, b),
            state,
            unknowns,
        )
        state = _new_state()
        yield from self._share.spread(
            lambda s, b: _kernels.find_slots(
                ends, edges, self.position, self.column_start, self.rows, self.slots, s, b
            ),
            state,
            edges,
        )

    def _list_neighbours(self, ends: IndexArray, edges: int) -> Task:
        n = self.unknowns
        state = _new_state()
        yield from self._share.spread(
            lambda s, b: _kernels.begin_lists(n, self._start, self._length, self._room, _LIST_ROOM, s, b), state, n
        )
        state[_kernels.AT] = 0
        yield from self._share.spread(lambda s, b: self._list_some(ends, edges, s, b), state, edges)
        self._pool_used = int(state[_kernels.POOL])

    def _list_some(self, ends: IndexArray, edges: int, state: NDArray[np.int64], budget: int) -> int:
        self._make_room(state)
        return _kernels.list_neighbours(ends, edges, self._start, self._length, self._room, self._pool, state, budget)

    def _eliminate(self) -> Task:
        n = self.unknowns
        state = _new_state()
        yield from self._share.spread(
            lambda s, b: _kernels.sort_by_degree(
                n, self._length, self._head, self._after, self._before, self._mark, s, b
            ),
            state,
            2 * n,
        )
        state = _new_state()
        state[_kernels.POOL] = self._pool_used
        yield from self._share.spread(self._eliminate_some, state, n)
        self.blocks = int(state[_kernels.STORED])

    def _eliminate_some(self, state: NDArray[np.int64], budget: int) -> int:
        self._make_room(state)
        return _kernels.eliminate(
            self.unknowns, self._start, self._length, self._room, self._pool, self._head, self._after, self._before,
            self._mark, self._order, self.position, self.column_start, self.rows, state, budget,
        )  # fmt: skip

    def _make_room(self, state: NDArray[np.int64]) -> None:
        """Twice the room where there was not enough."""
        if state[_kernels.NO_ROOM]:
            state[_kernels.NO_ROOM] = 0
            self._pool = _doubled(self._pool)
            self.rows = _doubled(self.rows)

    def _reserve(self, unknowns: int, edges: int) -> None:
        """Memory that is not written to is not taken from the machine: the pools may be generous."""
        if unknowns > len(self.position):
            room = max(_FIRST_ROOM, 2 * unknowns)
            self.position, self._order = _indices(room), _indices(room)
            self._start, self._length, self._room = _indices(room), _indices(room), _indices(room)
            self._head, self._after, self._before = _indices(room), _indices(room), _indices(room)
            self._mark = np.empty(room, np.int64)
            self.column_start = _indices(room + 1)
            self._pool, self.rows = _indices(_POOL_PER_NODE * room), _indices(_POOL_PER_NODE * room)
        self.column_start[0] = 0
        if edges > len(self.slots):
            self.slots = _indices(max(_FIRST_ROOM, 2 * edges))


def _new_state() -> NDArray[np.int64]:
    return np.zeros(8, np.int64)


def _indices(room: int) -> IndexArray:
    return np.empty(room, np.int32)


def _doubled(array: IndexArray) -> IndexArray:
    larger = np.empty(2 * len(array), array.dtype)
    larger[: len(array)] = array
    return larger
