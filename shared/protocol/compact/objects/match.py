"""What of a network the other side already has: the encoder's own choice."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from shared.messages import ObjectNetwork
from shared.protocol.compact.objects.walk import MOST_NEW, STEP_MM, NetworkChoice
from shared.protocol.compact.state import NODES, State, Store

IntArray = NDArray[np.int64]

_NEAR_MM = 18.2  # … is sent as the stored one; rounded to whole millimetres twice it is still within 20
_NEW_TO_LAST_MM = 8.0  # by how much nearer a node must be that the last network did not have
_FURTHEST = (1 << 30) // STEP_MM


def choose(network: ObjectNetwork, state: State, most_new: int) -> tuple[NetworkChoice, bool]:
    """How to say a network, and whether all of it is said: at most `most_new` nodes that the store does not have."""
    places_mm = 1e3 * state.odom_from_robot.apply_3d(network.nodes_m)
    taken = _matches(places_mm, state.store)
    kept = np.zeros(NODES, np.int64)
    kept[taken[taken >= 0]] = 1
    neighbours = _neighbours(network)
    edges = {(min(a, b), max(a, b)) for a, b in network.edges.tolist() if a != b}
    index = _numbered(taken, kept)
    room = min(most_new, MOST_NEW, NODES - int(kept.sum()))
    fresh, index = _grow(places_mm, index, neighbours, int(kept.sum()), room)
    stored, keep_edge = _stored_edges(state.store, taken, edges)
    tree = {_pair(new, parent) for new, parent in enumerate((row[0] for row in fresh), int(kept.sum())) if parent >= 0}
    extra = _extra(edges - stored, index, tree)
    complete = len(index) == len(places_mm) and len(extra) <= MOST_NEW
    table = np.array(fresh, np.int64).reshape(-1, 4)
    return NetworkChoice(kept, keep_edge, table, np.array(extra[:MOST_NEW], np.int64).reshape(-1, 2)), complete


def _pair(a: int, b: int) -> tuple[int, int]:
    return (max(a, b), min(a, b))


def _matches(places_mm: NDArray[np.float64], store: Store) -> IntArray:
    """(N,) the stored node that stands for each, -1 where none does; nearest pairs first, each once."""
    taken = np.full(len(places_mm), -1, np.int64)
    if len(places_mm) == 0:
        return taken
    low, high = places_mm.min(axis=0) - _NEAR_MM, places_mm.max(axis=0) + _NEAR_MM
    held = np.flatnonzero((store.used > 0) & ((store.places >= low) & (store.places <= high)).all(axis=1))
    distance = np.linalg.norm(places_mm[:, None, :] - store.places[None, held, :], axis=2)
    near = distance <= _NEAR_MM
    rank = distance + np.where(store.last[held] == 1, 0.0, _NEW_TO_LAST_MM)
    nodes, columns = np.nonzero(near)
    free = np.ones(len(held), bool)
    for k in np.argsort(rank[nodes, columns], kind="stable"):
        if taken[nodes[k]] < 0 and free[columns[k]]:
            taken[nodes[k]] = held[columns[k]]
            free[columns[k]] = False
    return taken


def _neighbours(network: ObjectNetwork) -> list[list[int]]:
    neighbours: list[list[int]] = [[] for _ in network.nodes_m]
    for a, b in network.edges.tolist():
        if a != b:
            neighbours[a].append(b)
            neighbours[b].append(a)
    return neighbours


def _numbered(taken: IntArray, kept: IntArray) -> dict[int, int]:
    """The place of each kept node in the order of the store."""
    order = np.cumsum(kept) - 1
    return {node: int(order[slot]) for node, slot in enumerate(taken.tolist()) if slot >= 0}


def _grow(
    places_mm: NDArray[np.float64], index: dict[int, int], neighbours: list[list[int]], count: int, room: int
) -> tuple[list[tuple[int, int, int, int]], dict[int, int]]:
    """New nodes along the edges from what is known, then from a first node of each object; and all their places."""
    grid = np.round(places_mm / STEP_MM).astype(np.int64)
    grid = np.clip(grid, -_FURTHEST, _FURTHEST)
    fresh: list[tuple[int, int, int, int]] = []
    index = dict(index)
    waiting = deque((b, a) for a in sorted(index, key=lambda n: index[n]) for b in neighbours[a])
    roots = iter(range(len(places_mm)))
    while len(fresh) < room:
        while waiting and waiting[-1][0] in index:
            waiting.pop()
        if waiting:
            node, parent = waiting.pop()
        else:
            node, parent = next((n for n in roots if n not in index), -1), -1
            if node < 0:
                break
        x, y, z = (int(v) for v in grid[node])
        fresh.append((index[parent] if parent >= 0 else -1, x, y, z))
        index[node] = count
        count += 1
        waiting.extend((b, node) for b in neighbours[node])
    return fresh, index


def _stored_edges(store: Store, taken: IntArray, edges: set[tuple[int, int]]) -> tuple[set[tuple[int, int]], IntArray]:
    """The edges that the store has, and (EDGES,) 1 for each stored one that is wanted."""
    node_of = np.full(NODES + 1, -1, np.int64)
    node_of[taken[taken >= 0]] = np.flatnonzero(taken >= 0)
    ends = np.sort(node_of[store.edges[:, :2]], axis=1)
    keep = np.zeros(len(ends), np.int64)
    found: set[tuple[int, int]] = set()
    for e in np.flatnonzero(ends[:, 0] >= 0).tolist():
        pair = (int(ends[e, 0]), int(ends[e, 1]))
        if pair in edges and pair not in found:
            keep[e] = 1
            found.add(pair)
    return found, keep


def _extra(edges: set[tuple[int, int]], index: dict[int, int], tree: set[tuple[int, int]]) -> list[tuple[int, int]]:
    """The edges left over, larger place first."""
    pairs = {_pair(index[a], index[b]) for a, b in edges if a in index and b in index}
    return sorted(pairs - tree)
