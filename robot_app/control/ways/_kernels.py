"""Kernels: all ways of the car from where it stands, forward and in reverse.

`room_m` (rows, columns): how large a disc may stand at each cell; `frame` (3,): the odom position of its lower left
corner and the size of a cell. `discs` (D + 1,): the radius of the discs that cover the body, then where their centres
are ahead of the rear axle. A node is a row of `nodes` (M, 5): x, y, theta, its cost, and the last move.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from shared.heap._kernels import heap_pop, heap_push

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_TURN = 2.0 * math.pi
_NEAR_START_M = 0.5


@njit(nogil=True, cache=True)
def body_room(room_m: Floats, frame: Floats, discs: Floats, x: float, y: float, theta: float) -> float:
    """What is left round the body; not negative where it fits. The border of the window is a wall."""
    rows, columns = room_m.shape
    c = math.cos(theta)
    s = math.sin(theta)
    least = math.inf
    for k in range(1, len(discs)):
        j = math.floor((x + discs[k] * c - frame[0]) / frame[2])
        i = math.floor((y + discs[k] * s - frame[1]) / frame[2])
        if i < 0 or j < 0 or i >= rows or j >= columns:
            return -math.inf
        least = min(least, room_m[i, j] - discs[0])
    return least


@njit(nogil=True, cache=True)
def find_ways(
    room_m: Floats,
    frame: Floats,
    discs: Floats,
    start: Floats,
    curvature: float,
    step_m: float,
    cell_m: float,
    headings: int,
    checks: int,
    costs: Floats,
    best: NDArray[np.float32],
    nodes: Floats,
    parents: Ints,
    keys: Floats,
    items: Ints,
) -> int:
    """Dijkstra over poses from `start` (4,): x, y, theta, and the direction it drives in (0 stands).

    Ten moves: five steerings of up to `curvature`, forward and in reverse. `costs` (4,): of a metre in reverse, of a
    change of direction, of a full change of steering, and of a metre where the body has less than 0.1 m of room (in
    part). `best` (states or more): room to work in. Near the start the body may have as little room as it has there.
    Returns how many nodes there are; the last move is 0 to 4 forward, right to left, 5 to 9 in reverse, -1 at the
    start.
    """
    rows = int(room_m.shape[0] * frame[2] / cell_m) + 1
    columns = int(room_m.shape[1] * frame[2] / cell_m) + 1
    slack = min(0.0, body_room(room_m, frame, discs, start[0], start[1], start[2]) - 0.5 * frame[2])
    nodes[0, 0], nodes[0, 1], nodes[0, 2], nodes[0, 3], nodes[0, 4] = start[0], start[1], start[2], 0.0, -1.0
    parents[0] = -1
    count = 1
    best[: rows * columns * headings] = np.inf
    state = _state(start[0], start[1], start[2], frame, cell_m, headings, rows, columns)
    if state >= 0:
        best[state] = 0.0
    size = heap_push(keys, items, 0, 0.0, 0)
    while size > 0:
        size = heap_pop(keys, items, size)
        here = items[size]
        x0, y0, t0 = nodes[here, 0], nodes[here, 1], nodes[here, 2]
        spent, last = nodes[here, 3], nodes[here, 4]
        state = _state(x0, y0, t0, frame, cell_m, headings, rows, columns)
        if state < 0 or spent > best[state]:  # a cheaper way here was found since
            continue
        for move in range(10):
            forward = move < 5
            bend = curvature * 0.5 * (move % 5 - 2)
            part = (step_m if forward else -step_m) / checks
            x, y, t = x0, y0, t0
            least = math.inf
            needed = slack if spent < _NEAR_START_M else 0.0
            for _ in range(checks):
                x += part * math.cos(t + 0.5 * part * bend)
                y += part * math.sin(t + 0.5 * part * bend)
                t += part * bend
                least = min(least, body_room(room_m, frame, discs, x, y, t))
                if least < needed:
                    break
            if least < needed:
                continue
            cost = step_m * (1.0 if forward else costs[0])
            cost += step_m * costs[3] * max(0.0, 1.0 - max(least, 0.0) / 0.1)
            was_forward = last < 5.0 if last >= 0.0 else start[3] > 0.0
            if (last >= 0.0 or start[3] != 0.0) and was_forward != forward:
                cost += costs[1]
            if last >= 0.0:
                cost += costs[2] * abs(last % 5.0 - move % 5) / 4.0
            total = float(np.float32(spent + cost))  # as `best` holds it
            state = _state(x, y, t, frame, cell_m, headings, rows, columns)
            if state < 0 or total >= best[state] or count >= len(nodes) or size >= len(keys):
                continue
            best[state] = total
            nodes[count, 0], nodes[count, 1], nodes[count, 2], nodes[count, 3], nodes[count, 4] = x, y, t, total, move
            parents[count] = here
            size = heap_push(keys, items, size, total, count)
            count += 1
    return count


@njit(nogil=True, cache=True)
def _state(
    x: float, y: float, theta: float, frame: Floats, cell_m: float, headings: int, rows: int, columns: int
) -> int:
    """-1 outside of the window."""
    i = math.floor((y - frame[1]) / cell_m)
    j = math.floor((x - frame[0]) / cell_m)
    if i < 0 or j < 0 or i >= rows or j >= columns:
        return -1
    h = int((theta / _TURN - math.floor(theta / _TURN)) * headings) % headings
    return int((i * columns + j) * headings + h)


@njit(nogil=True, cache=True)
def worst_room(room_m: Floats, frame: Floats, discs: Floats, path: Floats) -> float:
    """The least room of the body along `path` (N, 3)."""
    least = math.inf
    for k in range(len(path)):
        least = min(least, body_room(room_m, frame, discs, path[k, 0], path[k, 1], path[k, 2]))
    return least
