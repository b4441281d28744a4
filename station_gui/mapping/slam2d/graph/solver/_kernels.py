"""Kernels of the block-sparse Cholesky factorisation: plain arrays and scalars.

Every kernel does at most about `budget` units of work and can be called again to go on: what it needs to know is in
the arrays it is given. A unit is about what one product of two 3 × 3 blocks costs. They return the units they took.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int32]
State = NDArray[np.int64]

# Of `state`, which is shared by the kernels of one phase:
AT = 0  # node, edge, position or column to go on with
INNER = 1  # where within it
POOL = 2  # numbers of the pool in use
LEAST = 3  # no node has fewer neighbours
STORED = 4  # blocks of the factor that have a place
STAMP = 5
FAILED = 6  # a pivot was not positive
NO_ROOM = 7  # a pool is full: enlarge it and call again

_EDGE_COST = 16
_MERGE_COST = 16
_SLOT_COST = 4
_COLUMN_COST = 4


@njit(nogil=True, cache=True)
def begin_lists(
    nodes: int, start: IndexArray, length: IndexArray, room: IndexArray, first_room: int, state: State, budget: int
) -> int:
    """Give the nodes from `state[AT]` on an empty list of neighbours each."""
    last = min(nodes, state[AT] + budget)
    done = last - state[AT]
    for k in range(state[AT], last):
        start[k] = k * first_room
        length[k] = 0
        room[k] = first_room
    state[AT] = last
    state[POOL] = nodes * first_room
    return int(done + 1)


@njit(nogil=True, cache=True)
def _append(
    node: int, other: int, start: IndexArray, length: IndexArray, room: IndexArray, pool: IndexArray, state: State
) -> None:
    """A list that is full moves to the end of the pool, where it has twice the room; the caller has seen to it."""
    if length[node] == room[node]:
        target = state[POOL]
        for k in range(length[node]):
            pool[target + k] = pool[start[node] + k]
        start[node] = target
        room[node] *= 2
        state[POOL] += room[node]
    pool[start[node] + length[node]] = other
    length[node] += 1


@njit(nogil=True, cache=True)
def list_neighbours(
    ends: IndexArray,
    edges: int,
    start: IndexArray,
    length: IndexArray,
    room: IndexArray,
    pool: IndexArray,
    state: State,
    budget: int,
) -> int:
    """Neighbours of each unknown, each once; unknown k is node k + 1, node 0 being held."""
    work = 0
    while state[AT] < edges and work < budget:
        a = ends[state[AT], 0] - 1
        b = ends[state[AT], 1] - 1
        work += _EDGE_COST
        if a >= 0 and b >= 0 and a != b:
            if state[POOL] + 2 * (room[a] + room[b]) > pool.shape[0]:
                state[NO_ROOM] = 1
                return work
            shorter = a if length[a] < length[b] else b
            other = a + b - shorter
            known = False
            for k in range(start[shorter], start[shorter] + length[shorter]):
                known = known or pool[k] == other
            work += length[shorter]
            if not known:
                _append(a, b, start, length, room, pool, state)
                _append(b, a, start, length, room, pool, state)
        state[AT] += 1
    return work


@njit(nogil=True, cache=True)
def _push(node: int, degree: int, head: IndexArray, after: IndexArray, before: IndexArray) -> None:
    after[node] = head[degree]
    before[node] = -1
    if head[degree] >= 0:
        before[head[degree]] = node
    head[degree] = node


@njit(nogil=True, cache=True)
def _unlink(node: int, degree: int, head: IndexArray, after: IndexArray, before: IndexArray) -> None:
    if before[node] >= 0:
        after[before[node]] = after[node]
    else:
        head[degree] = after[node]
    if after[node] >= 0:
        before[after[node]] = before[node]


@njit(nogil=True, cache=True)
def sort_by_degree(
    nodes: int,
    length: IndexArray,
    head: IndexArray,
    after: IndexArray,
    before: IndexArray,
    mark: State,
    state: State,
    budget: int,
) -> int:
    """Fill the lists of unknowns of equal degree; first half of the passes clears their heads."""
    work = 0
    while state[AT] < 2 * nodes and work < budget:
        k = state[AT]
        if k < nodes:
            head[k] = -1
            mark[k] = 0
        else:
            _push(2 * nodes - 1 - k, length[2 * nodes - 1 - k], head, after, before)
        state[AT] += 1
        work += 2
    return work


@njit(nogil=True, cache=True)
def eliminate(
    nodes: int,
    start: IndexArray,
    length: IndexArray,
    room: IndexArray,
    pool: IndexArray,
    head: IndexArray,
    after: IndexArray,
    before: IndexArray,
    mark: State,
    order: IndexArray,
    position: IndexArray,
    column_start: IndexArray,
    rows: IndexArray,
    state: State,
    budget: int,
) -> int:
    """Order of elimination by minimum degree (Tinney and Walker 1967, scheme 2), and the structure of the factor.

    The unknown with the fewest neighbours goes first; those become neighbours of each other. `rows` are unknowns
    still, column after column.
    """
    work = 0
    while state[AT] < nodes and work < budget:
        if state[INNER] == 0:
            while head[state[LEAST]] < 0:
                state[LEAST] += 1
            pivot = head[state[LEAST]]
            degree = length[pivot]
            if state[STORED] + degree > rows.shape[0]:
                state[NO_ROOM] = 1
                return work
            _unlink(pivot, degree, head, after, before)
            order[state[AT]] = pivot
            position[pivot] = state[AT]
            column_start[state[AT]] = state[STORED]
            for k in range(degree):
                rows[state[STORED] + k] = pool[start[pivot] + k]
            state[STORED] += degree
            column_start[state[AT] + 1] = state[STORED]
        first = column_start[state[AT]]
        last = column_start[state[AT] + 1]
        pivot = order[state[AT]]
        while first + state[INNER] < last and work < budget:
            node = rows[first + state[INNER]]
            grown = room[node]
            while grown < length[node] + last - first:
                grown *= 2
            if state[POOL] + 2 * grown > pool.shape[0]:
                state[NO_ROOM] = 1
                return work
            work += _MERGE_COST + length[node] + last - first
            _join_clique(node, pivot, first, last, start, length, room, pool, head, after, before, mark, rows, state)
            state[INNER] += 1
        if first + state[INNER] == last:
            state[INNER] = 0
            state[AT] += 1
            work += 1
    return work


@njit(nogil=True, cache=True)
def _join_clique(
    node: int,
    pivot: int,
    first: int,
    last: int,
    start: IndexArray,
    length: IndexArray,
    room: IndexArray,
    pool: IndexArray,
    head: IndexArray,
    after: IndexArray,
    before: IndexArray,
    mark: State,
    rows: IndexArray,
    state: State,
) -> None:
    """The pivot leaves the neighbours of `node`, the pivot's other neighbours come in."""
    _unlink(node, length[node], head, after, before)
    state[STAMP] += 1
    stamp = state[STAMP]
    mark[node] = stamp
    at_pivot = -1
    for k in range(start[node], start[node] + length[node]):
        if pool[k] == pivot:
            at_pivot = k
        mark[pool[k]] = stamp
    length[node] -= 1
    pool[at_pivot] = pool[start[node] + length[node]]
    for k in range(first, last):
        if mark[rows[k]] != stamp:
            _append(node, rows[k], start, length, room, pool, state)
    _push(node, length[node], head, after, before)
    state[LEAST] = min(state[LEAST], length[node])


@njit(nogil=True, cache=True)
def sort_rows(
    nodes: int, position: IndexArray, column_start: IndexArray, rows: IndexArray, state: State, budget: int
) -> int:
    """Each column's rows become positions in the order of elimination, ascending."""
    work = 0
    while state[AT] < nodes and work < budget:
        first = column_start[state[AT]]
        last = column_start[state[AT] + 1]
        for k in range(first, last):
            row = position[rows[k]]
            at = k
            while at > first and rows[at - 1] > row:
                rows[at] = rows[at - 1]
                at -= 1
                work += (k - at) & 1
            rows[at] = row
        work += 1 + (last - first) // 2
        state[AT] += 1
    return work


@njit(nogil=True, cache=True)
def find_slots(
    ends: IndexArray,
    edges: int,
    position: IndexArray,
    column_start: IndexArray,
    rows: IndexArray,
    slots: IndexArray,
    state: State,
    budget: int,
) -> int:
    """Which block of the factor the two ends of each edge share; -1 where one of them is held."""
    work = 0
    while state[AT] < edges and work < budget:
        a = ends[state[AT], 0] - 1
        b = ends[state[AT], 1] - 1
        slots[state[AT]] = -1
        if a >= 0 and b >= 0 and a != b:
            row = max(position[a], position[b])
            low = column_start[min(position[a], position[b])]
            high = column_start[min(position[a], position[b]) + 1]
            while low < high - 1:
                middle = (low + high) // 2
                if rows[middle] <= row:
                    low = middle
                else:
                    high = middle
            slots[state[AT]] = low
        state[AT] += 1
        work += _SLOT_COST
    return work


@njit(nogil=True, cache=True)
def clear(
    nodes: int,
    blocks: int,
    diagonal: FloatArray,
    below: FloatArray,
    right: FloatArray,
    list_head: IndexArray,
    state: State,
    budget: int,
) -> int:
    """Zeros everywhere, first the columns, then the blocks."""
    last = min(nodes + blocks, state[AT] + 2 * budget)
    done = last - state[AT]
    for k in range(state[AT], last):
        if k < nodes:
            list_head[k] = -1
            for m in range(3):
                right[k, m] = 0.0
            for m in range(9):
                diagonal[k, m] = 0.0
        else:
            for m in range(9):
                below[k - nodes, m] = 0.0
    state[AT] = last
    return int(done // 2 + 1)


@njit(nogil=True, cache=True)
def factor(
    nodes: int,
    column_start: IndexArray,
    rows: IndexArray,
    diagonal: FloatArray,
    below: FloatArray,
    right: FloatArray,
    list_head: IndexArray,
    list_next: IndexArray,
    cursor: IndexArray,
    slot_of_row: IndexArray,
    state: State,
    budget: int,
) -> int:
    """Left-looking Cholesky column by column, and the forward substitution of `right` with it.

    `list_head[k]`: first of the columns whose next row is k; `cursor`: that row's place in each.
    """
    work = 0
    while state[AT] < nodes and work < budget:
        k = state[AT]
        first = column_start[k]
        last = column_start[k + 1]
        if state[INNER] == 0:
            for q in range(first, last):
                slot_of_row[rows[q]] = q
            state[INNER] = 1
        while list_head[k] >= 0 and work < budget:
            j = list_head[k]
            list_head[k] = list_next[j]
            work += 1 + _subtract_column(k, j, column_start[j + 1], rows, diagonal, below, cursor[j], slot_of_row)
            cursor[j] += 1
            if cursor[j] < column_start[j + 1]:
                row = rows[cursor[j]]
                list_next[j] = list_head[row]
                list_head[row] = j
        if list_head[k] >= 0:
            return work
        if not _finish_column(k, first, last, rows, diagonal, below, right):
            state[FAILED] = 1
            state[AT] = nodes
            return work
        work += _COLUMN_COST + last - first
        if first < last:
            cursor[k] = first
            list_next[k] = list_head[rows[first]]
            list_head[rows[first]] = k
        state[AT] += 1
        state[INNER] = 0
    return work


@njit(nogil=True, cache=True)
def _subtract_column(
    k: int,
    j: int,
    last: int,
    rows: IndexArray,
    diagonal: FloatArray,
    below: FloatArray,
    place: int,
    slot_of_row: IndexArray,
) -> int:
    """Column k loses what column j gives to it: L[r, j] L[k, j]ᵀ of every row r from k on."""
    a0, a1, a2 = below[place, 0], below[place, 1], below[place, 2]
    b0, b1, b2 = below[place, 3], below[place, 4], below[place, 5]
    c0, c1, c2 = below[place, 6], below[place, 7], below[place, 8]
    for q in range(place, last):
        for m in range(3):
            x = below[q, 3 * m]
            y = below[q, 3 * m + 1]
            z = below[q, 3 * m + 2]
            if q == place:
                diagonal[k, 3 * m] -= x * a0 + y * a1 + z * a2
                diagonal[k, 3 * m + 1] -= x * b0 + y * b1 + z * b2
                diagonal[k, 3 * m + 2] -= x * c0 + y * c1 + z * c2
            else:
                slot = slot_of_row[rows[q]]
                below[slot, 3 * m] -= x * a0 + y * a1 + z * a2
                below[slot, 3 * m + 1] -= x * b0 + y * b1 + z * b2
                below[slot, 3 * m + 2] -= x * c0 + y * c1 + z * c2
    return last - place


@njit(nogil=True, cache=True)
def _finish_column(
    k: int, first: int, last: int, rows: IndexArray, diagonal: FloatArray, below: FloatArray, right: FloatArray
) -> bool:
    """Square root of the pivot (its lower triangle in place), division of the column by it, forward substitution."""
    d = diagonal[k]
    if not d[0] > 0.0:
        return False
    d[0] = math.sqrt(d[0])
    d[3] /= d[0]
    d[6] /= d[0]
    rest = d[4] - d[3] * d[3]
    if not rest > 0.0:
        return False
    d[4] = math.sqrt(rest)
    d[7] = (d[7] - d[6] * d[3]) / d[4]
    rest = d[8] - d[6] * d[6] - d[7] * d[7]
    if not rest > 0.0:
        return False
    d[8] = math.sqrt(rest)
    y0 = right[k, 0] / d[0]
    y1 = (right[k, 1] - d[3] * y0) / d[4]
    y2 = (right[k, 2] - d[6] * y0 - d[7] * y1) / d[8]
    right[k, 0], right[k, 1], right[k, 2] = y0, y1, y2
    for q in range(first, last):
        row = rows[q]
        for m in range(3):
            x = below[q, 3 * m] / d[0]
            y = (below[q, 3 * m + 1] - d[3] * x) / d[4]
            z = (below[q, 3 * m + 2] - d[6] * x - d[7] * y) / d[8]
            below[q, 3 * m], below[q, 3 * m + 1], below[q, 3 * m + 2] = x, y, z
            right[row, m] -= x * y0 + y * y1 + z * y2
    return True


@njit(nogil=True, cache=True)
def substitute_back(
    nodes: int,
    column_start: IndexArray,
    rows: IndexArray,
    diagonal: FloatArray,
    below: FloatArray,
    right: FloatArray,
    state: State,
    budget: int,
) -> int:
    """`right` becomes the solution, from the last position (`state[AT]` is 0) to the first."""
    work = 0
    while state[AT] < nodes and work < budget:
        k = nodes - 1 - state[AT]
        first = column_start[k]
        last = column_start[k + 1]
        x0, x1, x2 = right[k, 0], right[k, 1], right[k, 2]
        for q in range(first, last):
            row = rows[q]
            for m in range(3):
                x0 -= below[q, 3 * m] * right[row, m]
                x1 -= below[q, 3 * m + 1] * right[row, m]
                x2 -= below[q, 3 * m + 2] * right[row, m]
        x2 /= diagonal[k, 8]
        x1 = (x1 - diagonal[k, 7] * x2) / diagonal[k, 4]
        x0 = (x0 - diagonal[k, 3] * x1 - diagonal[k, 6] * x2) / diagonal[k, 0]
        right[k, 0], right[k, 1], right[k, 2] = x0, x1, x2
        state[AT] += 1
        work += 1 + (last - first) // 2
    return work
