"""Kernels of the planner: heap, way to go without a heading, the car's body in the clearance field, hybrid A*.

A clearance field is a (rows, columns) array of metres to the nearest cell that is not free, with `left`, `low` the
map position of its lower left corner. `discs` (K,) are the x positions of discs of radius `radius` that cover the
car, robot frame. `start` is (x, y, theta, slack): within half a metre of it the body may come as near as it did at
the start, `slack`, where that is less than the radius. Elements of a path are rows (curvature, signed length),
the length negative in reverse.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_ESCAPE_M = 0.5
_CHECK_M = 0.03


@njit(nogil=True, cache=True)
def heap_push(keys: Floats, items: Ints, size: int, key: float, item: int) -> int:
    """Put an item into the binary heap of `size` items; returns the new size. A full heap drops the item."""
    if size >= len(keys):
        return size
    i = size
    while i > 0:
        parent = (i - 1) // 2
        if keys[parent] <= key:
            break
        keys[i] = keys[parent]
        items[i] = items[parent]
        i = parent
    keys[i] = key
    items[i] = item
    return size + 1


@njit(nogil=True, cache=True)
def heap_pop(keys: Floats, items: Ints, size: int) -> int:
    """Take the item with the smallest key, which is then at index `size - 1`; the new size is `size - 1`."""
    top_key = keys[0]
    top_item = items[0]
    last = size - 1
    key = keys[last]
    item = items[last]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= last:
            break
        if child + 1 < last and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[i] = keys[child]
        items[i] = items[child]
        i = child
    keys[i] = key
    items[i] = item
    keys[last] = top_key
    items[last] = top_item
    return last


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
def _copy_pose(source: Floats, target: Floats) -> None:
    """Element by element: an array assignment takes numba seconds to compile."""
    for k in range(3):
        target[k] = source[k]


@njit(nogil=True, cache=True)
def _copy_elements(source: Floats, target: Floats) -> None:
    for k in range(3):
        target[k, 0] = source[k, 0]
        target[k, 1] = source[k, 1]


@njit(nogil=True, cache=True)
def clearance_at(field_m: Floats, left: float, low: float, cell: float, x: float, y: float) -> float:
    """The field at a point, bilinear; 0 outside the map."""
    rows, columns = field_m.shape
    u = (x - left) / cell - 0.5
    v = (y - low) / cell - 0.5
    if u < 0.0 or v < 0.0 or u >= columns - 1 or v >= rows - 1:
        return 0.0
    j = int(u)
    i = int(v)
    a = u - j
    b = v - i
    lower = (1 - a) * field_m[i, j] + a * field_m[i, j + 1]
    upper = (1 - a) * field_m[i + 1, j] + a * field_m[i + 1, j + 1]
    return float((1 - b) * lower + b * upper)


@njit(nogil=True, cache=True)
def body_clearance(
    field_m: Floats, left: float, low: float, cell: float, discs: Floats, x: float, y: float, theta: float
) -> float:
    """The smallest field value under the middles of the discs that cover the car."""
    c = math.cos(theta)
    s = math.sin(theta)
    least = math.inf
    for k in range(len(discs)):
        least = min(least, clearance_at(field_m, left, low, cell, x + discs[k] * c, y + discs[k] * s))
    return least


@njit(nogil=True, cache=True)
def drive_element(
    field_m: Floats,
    left: float,
    low: float,
    cell: float,
    discs: Floats,
    radius: float,
    soft: float,
    start: Floats,
    costs: Floats,
    pose: Floats,
    curvature: float,
    length: float,
) -> float:
    """Move `pose` (3,) along an element; returns its cost, infinite when the body does not fit.

    `costs` (5,): of a metre in reverse, of a cusp, of changing the steering fully, of tightness, largest curvature.
    """
    steps = max(1, math.ceil(abs(length) / _CHECK_M))
    step = length / steps
    turn = step * curvature
    total = 0.0
    for _ in range(steps):
        pose[0] += step * math.cos(pose[2] + 0.5 * turn)
        pose[1] += step * math.sin(pose[2] + 0.5 * turn)
        pose[2] += turn
        clear = body_clearance(field_m, left, low, cell, discs, pose[0], pose[1], pose[2])
        if clear < radius:
            near = math.hypot(pose[0] - start[0], pose[1] - start[1]) < _ESCAPE_M
            if not (near and clear >= start[3]):
                return math.inf
        tight = max(0.0, 1.0 - (clear - radius) / soft)
        weight = 1.0 if step > 0 else costs[0]
        total += abs(step) * (weight + costs[3] * tight * tight)
    return total


@njit(nogil=True, cache=True)
def change_cost(costs: Floats, curvature: float, length: float, next_curvature: float, next_length: float) -> float:
    """What it costs to go from one element to the next; a length of 0 is the standing start."""
    if length == 0.0:
        return 0.0
    cost = costs[2] * abs(next_curvature - curvature) / costs[4]
    return float(cost + (costs[1] if length * next_length < 0.0 else 0.0))


@njit(nogil=True, cache=True)
def _mod(angle: float) -> float:
    wrapped = angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi))
    return 0.0 if wrapped > 2.0 * math.pi - 1e-6 else wrapped


@njit(nogil=True, cache=True)
def connection(kind: int, pose: Floats, goal: Floats, free_heading: bool, radius: float, out: Floats) -> bool:
    """Turn, straight, turn (Dubins 1957) from `pose` to `goal` (x, y, theta): write three elements into `out` (3, 2).

    Bits of `kind`: 1 mirrored (right first), 2 in reverse, 4 the last turn goes against the first.
    With a free heading the last turn is left out.
    """
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    gx = c * (goal[0] - pose[0]) + s * (goal[1] - pose[1])
    gy = -s * (goal[0] - pose[0]) + c * (goal[1] - pose[1])
    gt = goal[2] - pose[2]
    side = -1.0 if kind & 1 else 1.0
    way = -1.0 if kind & 2 else 1.0
    gx *= way
    gy *= side
    gt *= side * way
    if free_heading:
        d2 = gx * gx + (gy - radius) * (gy - radius)
        if kind & 4 or d2 < radius * radius:
            return False
        straight = math.sqrt(d2 - radius * radius)
        first = _mod(math.atan2(gy - radius, gx) - math.atan2(-radius, straight))
        last = 0.0
        bend = 0.0
    else:
        opposite = -1.0 if kind & 4 else 1.0
        dx = gx - opposite * radius * math.sin(gt)
        dy = gy + opposite * radius * math.cos(gt) - radius
        distance = math.hypot(dx, dy)
        lead = math.atan2(dy, dx)
        straight = distance
        if kind & 4:
            if distance < 2.0 * radius:
                return False
            straight = math.sqrt(distance * distance - 4.0 * radius * radius)
            lead += math.atan2(2.0 * radius, straight)
        first = _mod(lead)
        last = _mod(opposite * (gt - lead))
        bend = opposite
    out[0, 0] = side / radius
    out[0, 1] = way * radius * first
    out[1, 0] = 0.0
    out[1, 1] = way * straight
    out[2, 0] = side * bend / radius
    out[2, 1] = way * radius * last
    return True


@njit(nogil=True, cache=True)
def best_connection(
    field_m: Floats,
    left: float,
    low: float,
    cell: float,
    discs: Floats,
    radius: float,
    soft: float,
    start: Floats,
    costs: Floats,
    pose: Floats,
    before: Floats,
    goal: Floats,
    free_heading: bool,
    limit: float,
    out: Floats,
) -> float:
    """The cheapest free connection that costs less than `limit`; its elements go to `out` (3, 2). inf if none.

    `before` (2,): the element that led to `pose`.
    """
    trial = np.empty((3, 2))
    at = np.empty(3)
    best = limit
    found = False
    for kind in range(8):
        if not connection(kind, pose, goal, free_heading, 1.0 / costs[4], trial):
            continue
        least = abs(trial[0, 1]) + abs(trial[1, 1]) + abs(trial[2, 1])
        if least * (costs[0] if kind & 2 else 1.0) >= best:
            continue
        _copy_pose(pose, at)
        cost = 0.0
        last_curvature = before[0]
        last_length = before[1]
        for e in range(3):
            if abs(trial[e, 1]) < 1e-6:
                continue
            cost += change_cost(costs, last_curvature, last_length, trial[e, 0], trial[e, 1])
            cost += drive_element(
                field_m, left, low, cell, discs, radius, soft, start, costs, at, trial[e, 0], trial[e, 1]
            )
            last_curvature = trial[e, 0]
            last_length = trial[e, 1]
            if cost >= best:
                break
        if cost < best:
            best = cost
            found = True
            _copy_elements(trial, out)
    return best if found else math.inf


@njit(nogil=True, cache=True)
def search(
    field_m: Floats,
    left: float,
    low: float,
    cell: float,
    discs: Floats,
    radius: float,
    soft: float,
    start: Floats,
    costs: Floats,
    goal: Floats,
    free_heading: bool,
    way_m: Floats,
    way_cell: float,
    headings: int,
    step_m: float,
    max_expansions: int,
    elements: Floats,
) -> int:
    """Hybrid A* (Dolgov et al. 2010): write the elements of the way to the goal; returns their count, 0 if none.

    `way_m` guides: the way to the goal of a point, on a coarser grid with cells of `way_cell`.
    """
    rows, columns = way_m.shape
    pool = 6 * max_expansions + 16
    nodes = np.empty((pool, 4))  # x, y, theta, cost so far
    led = np.zeros((pool, 2))  # the element that led here
    parents = np.empty(pool, np.int64)
    parents[0] = -1
    best = np.empty(rows * columns * headings, np.float32)
    best.fill(math.inf)
    keys = np.empty(pool)
    items = np.empty(pool, np.int64)
    pose = np.empty(3)
    tail = np.zeros((3, 2))
    final = np.zeros((3, 2))
    final_cost = math.inf
    final_node = -1
    nodes[0, 0] = start[0]
    nodes[0, 1] = start[1]
    nodes[0, 2] = start[2]
    nodes[0, 3] = 0.0
    count = 1
    size = heap_push(keys, items, 0, 0.0, 0)
    expansions = 0
    while size > 0 and expansions < max_expansions:
        size = heap_pop(keys, items, size)
        node = items[size]
        if keys[size] >= final_cost:
            break
        expansions += 1
        i = min(max(int((nodes[node, 1] - low) / way_cell), 0), rows - 1)
        j = min(max(int((nodes[node, 0] - left) / way_cell), 0), columns - 1)
        if way_m[i, j] < 1.0 or expansions % 10 == 1:
            _copy_pose(nodes[node], pose)
            cost = best_connection(
                field_m, left, low, cell, discs, radius, soft, start, costs, pose, led[node], goal, free_heading,
                final_cost - nodes[node, 3], tail,
            )  # fmt: skip
            if nodes[node, 3] + cost < final_cost:
                final_cost = nodes[node, 3] + cost
                final_node = node
                _copy_elements(tail, final)
        for move in range(6):
            curvature = costs[4] * (move % 3 - 1)
            length = step_m if move < 3 else -step_m
            _copy_pose(nodes[node], pose)
            cost = nodes[node, 3] + change_cost(costs, led[node, 0], led[node, 1], curvature, length)
            cost += drive_element(field_m, left, low, cell, discs, radius, soft, start, costs, pose, curvature, length)
            if cost >= final_cost or count >= pool:
                continue
            i = int((pose[1] - low) / way_cell)
            j = int((pose[0] - left) / way_cell)
            if i < 0 or j < 0 or i >= rows or j >= columns or way_m[i, j] == math.inf:
                continue
            h = int(_mod(pose[2]) / (2.0 * math.pi) * headings) % headings
            state = (i * columns + j) * headings + h
            if cost >= best[state] - 1e-6:
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
    if final_node < 0:
        return 0
    return _unwind(parents, led, final_node, final, elements)


@njit(nogil=True, cache=True)
def _unwind(parents: Ints, led: Floats, node: int, final: Floats, elements: Floats) -> int:
    """Write the elements from the root to `node` and then those of the final connection; returns their count."""
    depth = 0
    at = node
    while parents[at] >= 0:
        depth += 1
        at = parents[at]
    if depth + 3 > len(elements):
        return 0
    at = node
    for k in range(depth - 1, -1, -1):
        elements[k, 0] = led[at, 0]
        elements[k, 1] = led[at, 1]
        at = parents[at]
    for e in range(3):
        if abs(final[e, 1]) > 1e-6:
            elements[depth, 0] = final[e, 0]
            elements[depth, 1] = final[e, 1]
            depth += 1
    return depth
