"""Kernels: trees of poses joined by the ways of a car, rewired or not (LaValle 1998; Karaman and Frazzoli 2011).

A tree is a handful of arrays with a row per node: `poses` (cap, 3), `costs` (cap,) from the root, `driven` (cap,) of
the edge alone, `parents`, `child` (the first), `sibling` (the next) (cap,), -1 where there is none, `edges` (cap, 5, 2)
and `ends` (cap, 2, 2), the edge's first and last element that has a length, and `at_goal` (cap,). Node 0 is the root.
`field_m`, `frame` and `car` are as in `body`, `start`, `costs_of` (there: `costs`) and elements as in `steering`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from station_gui.planning.steering._kernels import (
    advance,
    change_cost,
    cheapest_way,
    copy_elements,
    copy_pose,
    drive_elements,
    pose_cost,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]
_TURN = 2.0 * math.pi
_RADIAN_M = 0.05  # what a radian counts in the choice of neighbours, however far they are
_MOST_NEIGHBOURS = 32
_GUIDE_SHARE = 0.92  # an 8-connected way is at most 1 / 0.924 of the shortest


@njit(nogil=True, cache=True)
def _folded(angle: float) -> float:
    """How far from a whole turn, 0 to pi."""
    return abs(angle - _TURN * math.ceil(angle / _TURN - 0.5))


@njit(nogil=True, cache=True)
def gap_m(a: Floats, b: Floats, radius: float) -> float:
    """About how far it is for a car from one pose to the other, at a fraction of the cost of the exact way.

    Without a cusp the heading changes by no more than the way over the radius, and as much to each side of the line
    between the two places; whatever is more has to be turned on the spot.
    """
    dx = b[0] - a[0]
    dy = b[1] - a[1]
    way = math.hypot(dx, dy)
    turn = _folded(b[2] - a[2])
    skew = _folded(a[2] + b[2] - 2.0 * math.atan2(dy, dx)) if way > 1e-9 else 0.0
    excess = max(0.0, radius * turn - way) + max(0.0, radius * skew - way)
    return way + excess + _RADIAN_M * (turn + skew)


@njit(nogil=True, cache=True)
def nearest(
    poses: Floats, count: int, pose: Floats, radius: float, wanted: int, found: Ints, apart: Floats
) -> int:  # fmt: skip
    """The nodes nearest to a pose by `gap_m`, nearest first, into `found` and `apart`; returns how many."""
    size = 0
    for n in range(count):
        if size == wanted and math.hypot(poses[n, 0] - pose[0], poses[n, 1] - pose[1]) >= apart[size - 1]:
            continue
        gap = gap_m(poses[n], pose, radius)
        if size == wanted and gap >= apart[size - 1]:
            continue
        k = size if size < wanted else size - 1
        size = k + 1
        while k > 0 and apart[k - 1] > gap:
            apart[k] = apart[k - 1]
            found[k] = found[k - 1]
            k -= 1
        apart[k] = gap
        found[k] = n
    return size


@njit(nogil=True, cache=True)
def set_edge(edges: Floats, ends: Floats, node: int, edge: Floats) -> None:
    """Write the edge (5, 2) that leads to a node."""
    first = True
    for e in range(5):
        edges[node, e, 0] = edge[e, 0]
        edges[node, e, 1] = edge[e, 1]
        if abs(edge[e, 1]) < 1e-6:
            continue
        if first:
            ends[node, 0, 0], ends[node, 0, 1] = edge[e, 0], edge[e, 1]
            first = False
        ends[node, 1, 0], ends[node, 1, 1] = edge[e, 0], edge[e, 1]


@njit(nogil=True, cache=True)
def hang(parents: Ints, child: Ints, sibling: Ints, node: int, parent: int) -> None:
    """Take a node from where it hangs, if it does, and hang it on another."""
    old = parents[node]
    if old >= 0:
        if child[old] == node:
            child[old] = sibling[node]
        else:
            at = child[old]
            while sibling[at] != node:
                at = sibling[at]
            sibling[at] = sibling[node]
    parents[node] = parent
    sibling[node] = child[parent]
    child[parent] = node


@njit(nogil=True, cache=True)
def _spread(
    costs_of: Floats, costs: Floats, driven: Floats, ends: Floats, child: Ints, sibling: Ints, node: int, stack: Ints
) -> None:
    """Give everything that hangs below a node its new cost."""
    stack[0] = node
    size = 1
    while size > 0:
        size -= 1
        above = stack[size]
        below = child[above]
        while below >= 0:
            last, first = ends[above, 1], ends[below, 0]
            costs[below] = costs[above] + change_cost(costs_of, last[0], last[1], first[0], first[1]) + driven[below]
            stack[size] = below
            size += 1
            below = sibling[below]


@njit(nogil=True, cache=True)
def _cut(edge: Floats, pose: Floats, longest: float) -> None:
    """Keep no more than `longest` metres of a way and move `pose` along them."""
    left = longest
    for e in range(5):
        length = edge[e, 1]
        if abs(length) > left:
            length = math.copysign(left, length)
            edge[e, 1] = length
        left -= abs(length)
        advance(pose, edge[e, 0], length)


@njit(nogil=True, cache=True)
def _guide_m(way_m: Floats, frame: Floats, way_cell: float, pose: Floats) -> float:
    rows, columns = way_m.shape
    i = min(max(int((pose[1] - frame[1]) / way_cell), 0), rows - 1)
    j = min(max(int((pose[0] - frame[0]) / way_cell), 0), columns - 1)
    return float(_GUIDE_SHARE * max(0.0, way_m[i, j] - 2.0 * way_cell))


@njit(nogil=True, cache=True)
def grow(
    field_m: Floats,
    frame: Floats,
    car: Floats,
    start: Floats,
    costs_of: Floats,
    targets: Floats,
    to_goal: Flags,
    way_m: Floats,
    way_cell: float,
    reach_m: float,
    rewire: bool,
    poses: Floats,
    costs: Floats,
    driven: Floats,
    parents: Ints,
    child: Ints,
    sibling: Ints,
    edges: Floats,
    ends: Floats,
    at_goal: Flags,
    count: int,
) -> int:
    """Grow the tree towards each of `targets` (N, 3); returns the new count of nodes.

    With `rewire` it is RRT*: the best of the neighbours becomes the parent, and others hang on the new node where
    that is cheaper; what cannot be part of a better way to the goal is left out, by `way_m`, the way of a point to
    the goal. Without it is RRT, which ends at the first node at the goal.
    """
    found = np.empty(_MOST_NEIGHBOURS, np.int64)
    apart = np.empty(_MOST_NEIGHBOURS)
    bounds = np.empty(_MOST_NEIGHBOURS)
    nearby = np.empty((_MOST_NEIGHBOURS, 5, 2))
    table = np.empty((44, 5, 2))
    edge = np.empty((5, 2))
    stack = np.empty(len(poses), np.int64)
    new = np.empty(3)
    at = np.empty(3)
    nothing = np.zeros(2)
    for t in range(len(targets)):
        if count >= len(poses):
            break
        goes_to_goal = to_goal[t]
        wanted = min(_MOST_NEIGHBOURS, max(1, int(3.6 * math.log(count + 1.0)))) if rewire else 1
        copy_pose(targets[t], new)
        size = nearest(poses, count, new, 1.0 / costs_of[4], wanted, found, apart)
        if apart[0] > reach_m or not rewire:
            n = found[0]
            cheapest_way(poses[n], ends[n, 1], targets[t], costs_of, table, edge)
            copy_pose(poses[n], new)
            _cut(edge, new, reach_m)
            if math.hypot(new[0] - targets[t, 0], new[1] - targets[t, 1]) > 1e-6:
                goes_to_goal = False
            if rewire:
                size = nearest(poses, count, new, 1.0 / costs_of[4], wanted, found, apart)
        if pose_cost(field_m, frame, car, start, costs_of, new) == math.inf:
            continue
        limit = math.inf
        if rewire:
            for n in range(count):
                if at_goal[n]:
                    limit = min(limit, costs[n])
            limit -= _guide_m(way_m, frame, way_cell, new)
        for k in range(size):
            n = found[k]
            bounds[k] = costs[n] + cheapest_way(poses[n], ends[n, 1], new, costs_of, table, nearby[k])
        best = limit
        parent = -1
        for _ in range(size):
            k = int(np.argmin(bounds[:size]))
            if bounds[k] >= best:
                break
            n = found[k]
            before = bounds[k]
            bounds[k] = math.inf
            copy_pose(poses[n], at)
            cost = drive_elements(
                field_m, frame, car, start, costs_of, at, ends[n, 1], nearby[k], best - costs[n]
            )  # fmt: skip
            if before - costs[n] > 1e-6 and costs[n] + cost < best:
                best = costs[n] + cost
                parent = n
                copy_elements(nearby[k], edge, 5)
        if parent < 0:
            continue
        copy_pose(new, poses[count])
        parents[count] = child[count] = sibling[count] = -1
        set_edge(edges, ends, count, edge)
        hang(parents, child, sibling, count, parent)
        last, first = ends[parent, 1], ends[count, 0]
        driven[count] = best - costs[parent] - change_cost(costs_of, last[0], last[1], first[0], first[1])
        costs[count] = best
        at_goal[count] = goes_to_goal
        count += 1
        if not rewire:
            if goes_to_goal:
                break
            continue
        for k in range(size):
            n = found[k]
            if n == parent:
                continue
            bound = best + cheapest_way(new, ends[count - 1, 1], poses[n], costs_of, table, edge)
            if bound >= costs[n] - 1e-6:
                continue
            copy_pose(new, at)
            alone = drive_elements(field_m, frame, car, start, costs_of, at, nothing, edge, costs[n] - best)
            if alone == math.inf:
                continue
            whole = alone
            for e in range(5):
                if abs(edge[e, 1]) > 1e-6:
                    last = ends[count - 1, 1]
                    whole += change_cost(costs_of, last[0], last[1], edge[e, 0], edge[e, 1])
                    break
            if best + whole < costs[n] - 1e-6:
                set_edge(edges, ends, n, edge)
                hang(parents, child, sibling, n, count - 1)
                driven[n] = alone
                costs[n] = best + whole
                _spread(costs_of, costs, driven, ends, child, sibling, n, stack)
    return count


@njit(nogil=True, cache=True)
def unwind(parents: Ints, edges: Floats, node: int, elements: Floats) -> int:
    """Write the elements (cap, 2) from the root to a node; returns their count, 0 where they do not fit."""
    depth = 0
    at = node
    while parents[at] >= 0:
        for e in range(5):
            depth += abs(edges[at, e, 1]) > 1e-6
        at = parents[at]
    if depth > len(elements):
        return 0
    k = depth
    at = node
    while parents[at] >= 0:
        for e in range(4, -1, -1):
            if abs(edges[at, e, 1]) > 1e-6:
                k -= 1
                elements[k, 0] = edges[at, e, 0]
                elements[k, 1] = edges[at, e, 1]
        at = parents[at]
    return depth
