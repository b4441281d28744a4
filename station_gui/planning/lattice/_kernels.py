"""Kernels: way to go without a heading, and hybrid A* (Dolgov et al. 2010).

`field_m`, `frame` and `car` are as in `body`, `start`, `costs` and elements as in `steering`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from shared.heap._kernels import heap_pop, heap_push
from station_gui.planning.steering._kernels import (
    advance,
    best_connection,
    change_cost,
    copy_elements,
    copy_pose,
    drive_element,
    pose_cost,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Singles = NDArray[np.float32]
_TURN = 2.0 * math.pi


@njit(nogil=True, cache=True)
def ways_to_goal(passable: NDArray[np.bool_], cell_m: float, row: int, column: int, way_m: Floats) -> None:
    """Dijkstra: write how far each cell is from the goal cell over passable cells, infinite where there is no way."""
    rows, columns = passable.shape
    way_m.fill(math.inf)
    keys = np.empty(9 * rows * columns)
    items = np.empty(9 * rows * columns, np.int64)
    way_m[row, column] = 0.0
    size = heap_push(keys, items, 0, 0.0, row * columns + column)
    while size > 0:
        size = heap_pop(keys, items, size)
        here = items[size]
        walked = keys[size]
        i = here // columns
        j = here % columns
        if walked > way_m[i, j]:
            continue
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a = i + di
                b = j + dj
                if a < 0 or b < 0 or a >= rows or b >= columns or not passable[a, b]:
                    continue
                way = walked + cell_m * math.hypot(di, dj)
                if way < way_m[a, b] - 1e-9:
                    way_m[a, b] = way
                    size = heap_push(keys, items, size, way, a * columns + b)


@njit(nogil=True, cache=True)
def search(
    field_m: Floats,
    frame: Floats,
    car: Floats,
    start: Floats,
    costs: Floats,
    goal: Floats,
    free_heading: bool,
    way_m: Floats,
    way_cell: float,
    headings: int,
    step_m: float,
    expansions: int,
    nodes: Floats,
    led: Floats,
    parents: Ints,
    best: Singles,
    keys: Floats,
    items: Ints,
    counts: Ints,
    final: Floats,
    final_cost: float,
) -> float:
    """Hybrid A* (Dolgov et al. 2010), so many expansions of it; returns the cost of the best way that is known.

    `way_m` guides: the way to the goal of a point, on a coarser grid with cells of `way_cell`. All from `nodes` on is
    the state of the search: `nodes` (N, 4) x, y, theta, cost so far; `led` (N, 2) the element that led there;
    `best` the least cost of each cell and heading; `counts` (3,) of nodes, of the heap, and the node from which the
    elements `final` (5, 2) lead to the goal. The search has ended when its heap is empty.
    """
    rows, columns = way_m.shape
    pose = np.empty(3)
    tail = np.zeros((5, 2))
    table = np.empty((44, 5, 2))
    count = counts[0]
    size = counts[1]
    for expansion in range(expansions):
        if size == 0:
            break
        size = heap_pop(keys, items, size)
        node = items[size]
        if keys[size] >= final_cost:
            size = 0
            break
        i = min(max(int((nodes[node, 1] - frame[1]) / way_cell), 0), rows - 1)
        j = min(max(int((nodes[node, 0] - frame[0]) / way_cell), 0), columns - 1)
        if way_m[i, j] < 1.0 or expansion % 10 == 0:
            copy_pose(nodes[node], pose)
            cost = best_connection(
                field_m, frame, car, start, costs, pose, led[node], goal, free_heading,
                final_cost - nodes[node, 3], table, tail,
            )  # fmt: skip
            if nodes[node, 3] + cost < final_cost:
                final_cost = nodes[node, 3] + cost
                counts[2] = node
                copy_elements(tail, final, 5)
        for move in range(6):
            curvature = costs[4] * (move % 3 - 1)
            length = step_m if move < 3 else -step_m
            copy_pose(nodes[node], pose)
            advance(pose, curvature, length)
            i = int((pose[1] - frame[1]) / way_cell)
            j = int((pose[0] - frame[0]) / way_cell)
            if i < 0 or j < 0 or i >= rows or j >= columns or way_m[i, j] == math.inf or count >= len(nodes):
                continue
            h = int((pose[2] / _TURN - math.floor(pose[2] / _TURN)) * headings) % headings
            state = (i * columns + j) * headings + h
            cost = nodes[node, 3] + change_cost(costs, led[node, 0], led[node, 1], curvature, length)
            limit = min(final_cost - way_m[i, j], best[state] - 1e-6) - cost
            if limit <= step_m * (1.0 if move < 3 else costs[0]):
                continue
            copy_pose(nodes[node], pose)
            cost += drive_element(field_m, frame, car, start, costs, pose, curvature, length, limit)
            if cost == math.inf:
                continue
            best[state] = cost
            nodes[count, 0] = pose[0]
            nodes[count, 1] = pose[1]
            nodes[count, 2] = pose[2]
            nodes[count, 3] = cost
            led[count, 0] = curvature
            led[count, 1] = length
            parents[count] = node
            size = heap_push(keys, items, size, cost + way_m[i, j], count)
            count += 1
    counts[0] = count
    counts[1] = size
    return final_cost


@njit(nogil=True, cache=True)
def closed_in(
    field_m: Floats,
    frame: Floats,
    car: Floats,
    start: Floats,
    costs: Floats,
    goal: Floats,
    free_heading: bool,
    cell: float,
    headings: int,
    step_m: float,
    near_m: float,
    seen: NDArray[np.bool_],
    stack: Floats,
) -> bool:
    """Whether a car at the goal gets to no more poses than `stack` (N, 3) has room for, and not `near_m` the start.

    What it drives it can drive in reverse, so that then no car gets to the goal. `seen` (rows, columns, headings) is
    false everywhere at first; a pose stands for all in its cell.
    """
    rows, columns, sectors = seen.shape
    pose = np.empty(3)
    size = 0
    for k in range(headings if free_heading else 1):
        copy_pose(goal, stack[size])
        if free_heading:
            stack[size, 2] = _TURN * k / headings
        if pose_cost(field_m, frame, car, start, costs, stack[size]) < math.inf:
            size += 1
    met = size
    while size > 0:
        size -= 1
        x, y, theta = stack[size]
        if math.hypot(x - start[0], y - start[1]) < near_m:
            return False
        for move in range(6):
            length = step_m if move < 3 else -step_m
            curvature = costs[4] * (move % 3 - 1)
            pose[0], pose[1], pose[2] = x, y, theta
            advance(pose, curvature, length)
            i = int((pose[1] - frame[1]) / cell)
            j = int((pose[0] - frame[0]) / cell)
            if i < 0 or j < 0 or i >= rows or j >= columns:
                continue
            h = int((pose[2] / _TURN - math.floor(pose[2] / _TURN)) * sectors) % sectors
            if seen[i, j, h]:
                continue
            pose[0], pose[1], pose[2] = x, y, theta
            if drive_element(field_m, frame, car, start, costs, pose, curvature, length, math.inf) == math.inf:
                continue
            seen[i, j, h] = True
            met += 1
            if met >= len(stack):
                return False
            copy_pose(pose, stack[size])
            size += 1
    return True


@njit(nogil=True, cache=True)
def unwind(parents: Ints, led: Floats, node: int, final: Floats, elements: Floats) -> int:
    """Write the elements from the root to `node` and then those of the final connection; returns their count."""
    depth = 0
    at = node
    while parents[at] >= 0:
        depth += 1
        at = parents[at]
    if depth + 5 > len(elements):
        return 0
    at = node
    for k in range(depth - 1, -1, -1):
        elements[k, 0] = led[at, 0]
        elements[k, 1] = led[at, 1]
        at = parents[at]
    for e in range(5):
        if abs(final[e, 1]) > 1e-6:
            elements[depth, 0] = final[e, 0]
            elements[depth, 1] = final[e, 1]
            depth += 1
    return depth
