"""Kernels that standard GNG and FastGNG share.

node: (3, N) float32, the nodes' x, y and z, m; in rows, so that distances are computed several at a time.
beside: (N, D) int32, the neighbours of each node; age: (N, D) int32, of those connections; degree: (N,) int32.
state: (1,) uint64, of the random numbers, never 0.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from robot_app.perception._kernels import UNCOUNTED

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
U8 = NDArray[np.uint8]
U64 = NDArray[np.uint64]

MOST_NEIGHBOURS = 16  # D; twice of what is met


@njit(nogil=True, cache=True, **UNCOUNTED)
def draw(state: U64, count: int) -> int:
    """A random number from 0 to `count` - 1, all equally likely to within 2^-32 (xorshift64*, Vigna 2016)."""
    x = state[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    state[0] = x
    high = (x * np.uint64(2685821657736338717)) >> np.uint64(32)
    return int((np.int64(high) * count) >> 32)  # signed: numba makes a float of signed and unsigned together


@njit(nogil=True, cache=True, **UNCOUNTED)
def nearest_two(x: np.float32, y: np.float32, z: np.float32, node: F32, nodes: int, square: F32) -> tuple[int, int]:
    """s1 and s2 (eqs 13 and 18) of a point; `square`: (N,) is left with the squared distances to all nodes."""
    for k in range(nodes):
        dx, dy, dz = node[0, k] - x, node[1, k] - y, node[2, k] - z
        square[k] = dx * dx + dy * dy + dz * dz
    s1, s2 = -1, -1
    best = second = np.float32(np.inf)
    for k in range(nodes):
        if square[k] < second:
            if square[k] < best:
                s2, second = s1, best
                s1, best = k, square[k]
            else:
                s2, second = k, square[k]
    return s1, s2


@njit(nogil=True, cache=True, **UNCOUNTED)
def slot_of(beside: I32, degree: I32, a: int, b: int) -> int:
    """Where b stands among the neighbours of a; -1 when they are not connected."""
    for slot in range(degree[a]):
        if beside[a, slot] == b:
            return slot
    return -1


@njit(nogil=True, cache=True, **UNCOUNTED)
def _remove_slot(beside: I32, age: I32, degree: I32, a: int, slot: int) -> None:
    last = degree[a] - 1
    beside[a, slot], age[a, slot] = beside[a, last], age[a, last]
    degree[a] = last


@njit(nogil=True, cache=True, **UNCOUNTED)
def disconnect(beside: I32, age: I32, degree: I32, a: int, b: int) -> None:
    slot = slot_of(beside, degree, a, b)
    if slot >= 0:
        _remove_slot(beside, age, degree, a, slot)
        _remove_slot(beside, age, degree, b, slot_of(beside, degree, b, a))


@njit(nogil=True, cache=True, **UNCOUNTED)
def _make_room(beside: I32, age: I32, degree: I32, a: int) -> None:
    if degree[a] < beside.shape[1]:
        return
    oldest = 0
    for slot in range(1, degree[a]):
        if age[a, slot] > age[a, oldest]:
            oldest = slot
    disconnect(beside, age, degree, a, beside[a, oldest])


@njit(nogil=True, cache=True, **UNCOUNTED)
def connect(beside: I32, age: I32, degree: I32, a: int, b: int) -> None:
    """A new connection, or an old one that is young again; where there is no room the oldest one goes."""
    slot = slot_of(beside, degree, a, b)
    if slot >= 0:
        age[a, slot] = 0
        age[b, slot_of(beside, degree, b, a)] = 0
        return
    _make_room(beside, age, degree, a)
    _make_room(beside, age, degree, b)
    beside[a, degree[a]], age[a, degree[a]] = b, 0
    beside[b, degree[b]], age[b, degree[b]] = a, 0
    degree[a] += 1
    degree[b] += 1


@njit(nogil=True, cache=True, **UNCOUNTED)
def grow_older(beside: I32, age: I32, degree: I32, a: int, by: int) -> None:
    """Every connection of a ages by `by`."""
    for slot in range(degree[a]):
        b = beside[a, slot]
        age[a, slot] += by
        age[b, slot_of(beside, degree, b, a)] += by


@njit(nogil=True, cache=True, **UNCOUNTED)
def take_place(node: F32, beside: I32, age: I32, degree: I32, free: int, last: int) -> None:
    """Node `last` moves to the place `free`, whose node has no connection any more."""
    if free == last:
        return
    for axis in range(3):
        node[axis, free] = node[axis, last]
    degree[free] = degree[last]
    degree[last] = 0
    for slot in range(degree[free]):
        b = beside[last, slot]
        beside[free, slot], age[free, slot] = b, age[last, slot]
        for other in range(degree[b]):
            if beside[b, other] == last:
                beside[b, other] = free


@njit(nogil=True, cache=True, **UNCOUNTED)
def hand_over(node: F32, beside: I32, degree: I32, nodes: int, node_m: F32, linked: U8) -> None:
    """Write the network as (N, 3) positions and a matrix of connections."""
    for a in range(nodes):
        for axis in range(3):
            node_m[a, axis] = node[axis, a]
        for b in range(nodes):
            linked[a, b] = 0
        for slot in range(degree[a]):
            linked[a, beside[a, slot]] = 1
