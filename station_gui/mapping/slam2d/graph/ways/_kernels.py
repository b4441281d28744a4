"""Kernels of distances in a pose graph: plain arrays and scalars.

Each goes on from `state`, does about `budget` units of work and returns what it took.
Half edge 2 e leads from the first end of edge e to the second, half edge 2 e + 1 back.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int32]
State = NDArray[np.int64]

# Of `state`:
DONE = 0
WAITING = 1  # entries of the heap
SETTLED = 2
WANTED = 3  # nodes that are asked for and not settled yet
STAMP = 4  # marks what belongs to the present run
_SIZE = 5

_SETTLE_COST = 6


@njit(nogil=True, cache=True)
def _push(keys: FloatArray, nodes: IndexArray, size: int, key: float, node: int) -> None:
    at = size
    while at > 0 and (keys[(at - 1) // 2] > key or (keys[(at - 1) // 2] == key and nodes[(at - 1) // 2] > node)):
        keys[at] = keys[(at - 1) // 2]
        nodes[at] = nodes[(at - 1) // 2]
        at = (at - 1) // 2
    keys[at] = key
    nodes[at] = node


@njit(nogil=True, cache=True)
def _pop(keys: FloatArray, nodes: IndexArray, size: int) -> None:
    """Remove the first; `size` counts it."""
    key = keys[size - 1]
    node = nodes[size - 1]
    at = 0
    while True:
        child = 2 * at + 1
        if child >= size - 1:
            break
        if child + 1 < size - 1 and (
            keys[child + 1] < keys[child] or (keys[child + 1] == keys[child] and nodes[child + 1] < nodes[child])
        ):
            child += 1
        if keys[child] > key or (keys[child] == key and nodes[child] >= node):
            break
        keys[at] = keys[child]
        nodes[at] = nodes[child]
        at = child
    keys[at] = key
    nodes[at] = node


@njit(nogil=True, cache=True)
def begin_ways(
    source: int,
    wanted: IndexArray,
    distance: FloatArray,
    reached: State,
    asked: State,
    keys: FloatArray,
    nodes: IndexArray,
    state: State,
) -> None:
    state[STAMP] += 1
    for k in range(wanted.shape[0]):
        asked[wanted[k]] = state[STAMP]
    distance[source] = 0.0
    reached[source] = state[STAMP]
    keys[0] = 0.0
    nodes[0] = source
    state[WAITING] = 1
    state[SETTLED] = 0
    state[WANTED] = wanted.shape[0]
    state[DONE] = 0


@njit(nogil=True, cache=True)
def settle(
    known: int,
    first_half: IndexArray,
    next_half: IndexArray,
    ends: IndexArray,
    length_m: FloatArray,
    limit_m: float,
    distance: FloatArray,
    reached: State,
    asked: State,
    keys: FloatArray,
    nodes: IndexArray,
    settled: IndexArray,
    state: State,
    budget: int,
) -> int:
    """Dijkstra's algorithm among the first `known` nodes, until all that are asked for are settled.

    It ends beyond `limit_m` and when `settled` is full. `distance[k]` holds where `reached[k]` is the run's stamp.
    """
    work = 0
    stamp = state[STAMP]
    while work < budget and state[DONE] == 0:
        if state[WAITING] == 0 or state[WANTED] == 0 or state[SETTLED] == settled.shape[0]:
            state[DONE] = 1
            break
        node = nodes[0]
        way_m = keys[0]
        _pop(keys, nodes, state[WAITING])
        state[WAITING] -= 1
        work += _SETTLE_COST
        if way_m > distance[node]:
            continue
        if way_m > limit_m:
            state[DONE] = 1
            break
        settled[state[SETTLED]] = node
        state[SETTLED] += 1
        if asked[node] == stamp:
            state[WANTED] -= 1
        half = first_half[node]
        while half >= 0:
            other = ends[half >> 1, 1 - (half & 1)]
            longer_m = way_m + length_m[half >> 1]
            if other < known and (reached[other] != stamp or longer_m < distance[other]):
                reached[other] = stamp
                distance[other] = longer_m
                _push(keys, nodes, state[WAITING], longer_m, other)
                state[WAITING] += 1
            half = next_half[half]
            work += 1
    return work


@njit(nogil=True, cache=True)
def nodes_within(
    poses: FloatArray, count: int, x: float, y: float, radius_m: float, found: IndexArray, state: State, budget: int
) -> int:
    """`found` gets the first `count` nodes nearer than `radius_m` to (x, y); `state[1]` counts them."""
    last = min(count, state[0] + 8 * budget)
    done = last - state[0]
    for k in range(state[0], last):
        dx = poses[k, 0] - x
        dy = poses[k, 1] - y
        if dx * dx + dy * dy < radius_m * radius_m:
            found[state[1]] = k
            state[1] += 1
    state[0] = last
    return int(done // 8 + 1)
