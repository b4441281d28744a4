"""Which stored nodes and edges are seen again, and the new ones. One walk for both directions.

`places` (M, 3): mm, odom frame, on a grid of `step`; `used` (M,): number of the observation that last had it, 0 when
empty; `last` (M,) 1 when the last network had it; `edges` (E, 3): two nodes of the store and whether the last network
had it, -1 when empty.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from shared.protocol.compact.casting._kernels import bearing
from shared.protocol.compact.mixing._kernels import CONTEXT, Bytes, Ints, Refined, Slots, Weights, mixed, number, slot

_GRID_BITS = 27


@njit(nogil=True, cache=True)
def _outlook(place: Ints, pose: Ints, atans: Ints) -> int:
    """How likely the camera sees a place: 4 classes of distance within 3 of direction."""
    dx = place[0] - pose[0]
    dy = place[1] - pose[1]
    far = max(abs(dx), abs(dy))
    away = (bearing(dx, dy, atans) - pose[2]) & 1048575
    if away >= 524288:
        away = 1048576 - away
    side = 0 if away < 87381 else 1 if away < 116508 else 2
    distance = 0 if far < 800 else 1 if far < 2000 else 2 if far < 4000 else 3
    return side * 4 + distance


@njit(nogil=True, cache=True)
def _oldest(used: Ints, now: int) -> int:
    """The slot to be given away."""
    best = 0
    for i in range(used.shape[0]):
        if used[i] < used[best]:
            best = i
    return best


@njit(nogil=True, cache=True)
def _join(edges: Ints, a: int, b: int) -> None:
    """Store an edge of the present network where none of it is."""
    for e in range(edges.shape[0]):
        if edges[e, 0] < 0 or edges[e, 2] == 0:
            edges[e, 0] = min(a, b)
            edges[e, 1] = max(a, b)
            edges[e, 2] = 1
            return


@njit(nogil=True, cache=True)
def code_kept(
    coder: Ints,
    data: Bytes,
    pose: Ints,
    places: Ints,
    used: Ints,
    last: Ints,
    edges: Ints,
    now: int,
    kept: Ints,
    slots: Slots,
    weights: Weights,
    refined: Refined,
    tables: Ints,
    atans: Ints,
) -> None:
    """Code which of the stored nodes are in the network: `kept` (M,), 0 or 1; `around` is what their neighbours do."""
    around = np.zeros(places.shape[0], np.int64)
    before = 0
    for i in range(places.shape[0]):
        if used[i] == 0:
            kept[i] = 0
            continue
        outlook = _outlook(places[i], pose, atans)
        age = now - used[i]
        old = 0 if age <= 1 else 1 if age <= 4 else 2 if age <= 16 else 3 if age <= 64 else 4
        coder[CONTEXT] = slot(29, last[i], around[i], before, 0)
        coder[CONTEXT + 1] = slot(29, 8 + last[i], outlook, old, 1)
        coder[CONTEXT + 2] = slot(29, 16 + last[i], around[i], outlook, old)
        coder[CONTEXT + 3] = slot(30, min(around[i], 8), before, old, outlook >> 2)
        bit = mixed(
            coder, data, kept[i], 4, 309 + last[i], 311 + min(around[i], 3), 146 + last[i],
            slots, weights, refined, tables,
        )  # fmt: skip
        kept[i] = bit
        if last[i] == 1:
            before = 1 + bit
        for e in range(edges.shape[0]):
            other = -1
            if edges[e, 0] == i:
                other = edges[e, 1]
            elif edges[e, 1] == i:
                other = edges[e, 0]
            if other > i:
                around[other] = min(8, around[other] + (1 if bit == 1 else 3))


@njit(nogil=True, cache=True)
def code_network(
    coder: Ints,
    data: Bytes,
    pose: Ints,
    step: int,
    places: Ints,
    used: Ints,
    last: Ints,
    edges: Ints,
    now: int,
    kept: Ints,
    fresh: Ints,
    fresh_count: int,
    keep_edge: Ints,
    extra: Ints,
    extra_count: int,
    members: Ints,
    slots: Slots,
    weights: Weights,
    refined: Refined,
    tables: Ints,
) -> int:
    """Code the rest of a network once `kept` is known, and bring the store up to date; gives the number of nodes.

    `fresh` (F, 4): index of the node that it hangs on among kept and new ones (-1: none), grid x, y, z;
    `extra` (X, 2): edges between such indices; `members` (M,) out: their slots.
    """
    count = 0
    for i in range(places.shape[0]):
        if kept[i] == 1:
            members[count] = i
            used[i] = now
            count += 1
    for e in range(edges.shape[0]):
        if edges[e, 0] < 0:
            continue
        if kept[edges[e, 0]] == 0 or kept[edges[e, 1]] == 0:
            edges[e, 2] = 0
            continue
        coder[CONTEXT] = slot(31, edges[e, 2], 0, 0, 0)
        coder[CONTEXT + 1] = slot(31, edges[e, 2], last[edges[e, 0]], last[edges[e, 1]], 1)
        edges[e, 2] = mixed(
            coder, data, keep_edge[e], 2, 315, 316, 148, slots, weights, refined, tables
        )  # fmt: skip
    fresh_count = number(coder, data, fresh_count, 12, min(count, 1), 0, 9, slots, weights, refined, tables)
    fresh_count = max(0, min(fresh_count, fresh.shape[0], members.shape[0] - count))
    for n in range(fresh_count):
        hangs = 0
        if count > 0:
            coder[CONTEXT] = slot(32, 0, min(n, 2), 0, 0)
            coder[CONTEXT + 1] = slot(32, 1, min(fresh_count - n, 4), 0, 0)
            hangs = mixed(
                coder, data, 1 if fresh[n, 0] >= 0 else 0, 2, 317, 318, 149, slots, weights, refined, tables
            )  # fmt: skip
        parent = -1
        if hangs == 1:
            back = number(
                coder, data, count - 1 - fresh[n, 0], 13, 1 if n > 0 else 0, 0, 9, slots, weights, refined, tables
            )  # fmt: skip
            parent = min(count - 1, max(0, count - 1 - back))
        x = (pose[0] + step // 2) // step
        y = (pose[1] + step // 2) // step
        z = np.int64(0)
        if parent >= 0:
            x = places[members[parent], 0] // step
            y = places[members[parent], 1] // step
            z = places[members[parent], 2] // step
        kind = 16 if parent < 0 else 20
        flat = 1 if z == 0 else 0
        dz = number(coder, data, fresh[n, 3] - z, kind + 2, flat, 0, _GRID_BITS, slots, weights, refined, tables)
        up = 0 if dz == 0 else 1
        dx = number(coder, data, fresh[n, 1] - x, kind, up, flat, _GRID_BITS, slots, weights, refined, tables)
        near = min(3, abs(dx))
        dy = number(coder, data, fresh[n, 2] - y, kind + 1, up, near, _GRID_BITS, slots, weights, refined, tables)
        at = _oldest(used, now)
        for e in range(edges.shape[0]):
            if edges[e, 0] == at or edges[e, 1] == at:
                edges[e, 0] = -1
                edges[e, 1] = -1
                edges[e, 2] = 0
        places[at, 0] = (x + dx) * step
        places[at, 1] = (y + dy) * step
        places[at, 2] = (z + dz) * step
        used[at] = now
        members[count] = at
        if parent >= 0:
            _join(edges, at, members[parent])
        count += 1
    extra_count = number(
        coder, data, extra_count, 14, min(fresh_count, 2), 0, 9, slots, weights, refined, tables
    )  # fmt: skip
    extra_count = max(0, min(extra_count, extra.shape[0]))
    for n in range(extra_count):
        a = count - 1 - number(coder, data, count - 1 - extra[n, 0], 15, 0, 0, 10, slots, weights, refined, tables)
        b = a - number(coder, data, a - extra[n, 1], 15, 1, 0, 10, slots, weights, refined, tables)
        if 0 <= b < a < count:
            _join(edges, members[a], members[b])
    for i in range(places.shape[0]):
        last[i] = 1 if used[i] == now else 0
    return count
