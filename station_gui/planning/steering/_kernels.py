"""Kernels: the ways of a car from pose to pose (Reeds and Shepp 1990), where they are free, and what they cost.

Elements of a way are rows (curvature, signed length), the length negative in reverse. `costs` (5,): of a metre in
reverse, of a cusp, of changing the steering fully, of tightness, and the largest curvature. `start` (4,) is x, y, theta
and slack: within half a metre of it the body may come as near as it did at the start, `slack`, where that is less
than the margin. `field_m`, `frame` and `car` are as in `body`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from station_gui.planning.body._kernels import body_clearance

Floats = NDArray[np.float64]
_ESCAPE_M = 0.5
_CHECK_M = 0.03
_GLANCE_M = 0.25
_TINY = 1e-9
_TURN = 2.0 * math.pi
_QUARTER = 0.5 * math.pi


@njit(nogil=True, cache=True)
def advance(pose: Floats, curvature: float, length: float) -> None:
    """Move `pose` (3,) along an arc, exactly."""
    turn = curvature * length
    half = 0.5 * turn
    chord = length * (math.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6.0)
    pose[0] += chord * math.cos(pose[2] + half)
    pose[1] += chord * math.sin(pose[2] + half)
    pose[2] += turn


@njit(nogil=True, cache=True)
def copy_pose(source: Floats, target: Floats) -> None:
    """Element by element: an array assignment takes numba seconds to compile."""
    for k in range(3):
        target[k] = source[k]


@njit(nogil=True, cache=True)
def copy_elements(source: Floats, target: Floats, count: int) -> None:
    for k in range(count):
        target[k, 0] = source[k, 0]
        target[k, 1] = source[k, 1]


@njit(nogil=True, cache=True)
def pose_cost(field_m: Floats, frame: Floats, car: Floats, start: Floats, costs: Floats, pose: Floats) -> float:
    """What tightness adds to the cost of a metre at this pose; infinite where the body does not fit."""
    clear = body_clearance(field_m, frame, car, pose[0], pose[1], pose[2])
    if clear < car[3]:
        near = math.hypot(pose[0] - start[0], pose[1] - start[1]) < _ESCAPE_M
        if not (near and clear >= start[3]):
            return math.inf
    tight = max(0.0, 1.0 - (clear - car[3]) / car[4])
    return float(costs[3] * tight * tight)


@njit(nogil=True, cache=True)
def drive_element(
    field_m: Floats,
    frame: Floats,
    car: Floats,
    start: Floats,
    costs: Floats,
    pose: Floats,
    curvature: float,
    length: float,
    limit: float,
) -> float:
    """Move `pose` (3,) along an element; returns its cost, infinite when the body does not fit or above the limit."""
    steps = max(1, math.ceil(abs(length) / _CHECK_M))
    step = length / steps
    plain = abs(length) * (1.0 if step > 0 else costs[0])
    extra = 0.0
    for _ in range(steps):
        advance(pose, curvature, step)
        extra += abs(step) * pose_cost(field_m, frame, car, start, costs, pose)
        if extra > limit - plain or extra == math.inf:
            return math.inf
    return plain + extra


@njit(nogil=True, cache=True)
def change_cost(costs: Floats, curvature: float, length: float, next_curvature: float, next_length: float) -> float:
    """What it costs to go from one element to the next; a length of 0 is the standing start."""
    if length == 0.0:
        return 0.0
    cost = costs[2] * abs(next_curvature - curvature) / costs[4]
    return float(cost + (costs[1] if length * next_length < 0.0 else 0.0))


@njit(nogil=True, cache=True)
def least_cost(costs: Floats, before: Floats, elements: Floats) -> float:
    """The cost of elements (5, 2), those of no length left out, where nothing is tight. `before` (2,): the last one."""
    curvature = before[0]
    length = before[1]
    cost = 0.0
    for e in range(len(elements)):
        if abs(elements[e, 1]) < 1e-6:
            continue
        cost += change_cost(costs, curvature, length, elements[e, 0], elements[e, 1])
        cost += abs(elements[e, 1]) * (1.0 if elements[e, 1] > 0 else costs[0])
        curvature = elements[e, 0]
        length = elements[e, 1]
    return cost


@njit(nogil=True, cache=True)
def _hits(
    field_m: Floats, frame: Floats, car: Floats, start: Floats, costs: Floats, pose: Floats, elements: Floats
) -> bool:  # fmt: skip
    """Whether a glance at a few poses along elements (5, 2) shows that the body does not fit; `pose` stays."""
    x, y, theta = pose[0], pose[1], pose[2]
    hit = False
    for e in range(len(elements)):
        if hit or abs(elements[e, 1]) < 1e-6:
            continue
        parts = math.ceil(abs(elements[e, 1]) / _GLANCE_M)
        for _ in range(parts):
            advance(pose, elements[e, 0], elements[e, 1] / parts)
            if pose_cost(field_m, frame, car, start, costs, pose) == math.inf:
                hit = True
                break
    pose[0], pose[1], pose[2] = x, y, theta
    return hit


@njit(nogil=True, cache=True)
def drive_elements(
    field_m: Floats,
    frame: Floats,
    car: Floats,
    start: Floats,
    costs: Floats,
    pose: Floats,
    before: Floats,
    elements: Floats,
    limit: float,
) -> float:
    """Move `pose` along elements (5, 2); returns their cost, infinite where the body does not fit or at the limit."""
    cost = least_cost(costs, before, elements)
    if cost >= limit or _hits(field_m, frame, car, start, costs, pose, elements):
        return math.inf
    for e in range(len(elements)):
        length = elements[e, 1]
        if abs(length) < 1e-6:
            continue
        plain = abs(length) * (1.0 if length > 0 else costs[0])
        # Most ways that cannot pay are given up early so: all that is to come costs at least what it does untight.
        whole = drive_element(
            field_m, frame, car, start, costs, pose, elements[e, 0], length, limit - cost + plain
        )  # fmt: skip
        cost += whole - plain
        if cost >= limit:
            return math.inf
    return cost


@njit(nogil=True, cache=True)
def _mod(angle: float) -> float:
    """Into (-pi, pi]."""
    return angle - _TURN * math.ceil(angle / _TURN - 0.5)


@njit(nogil=True, cache=True)
def _put(
    out: Floats, k: int, flips: int, s0: int, a: float, s1: int, b: float, s2: int, c: float,
    s3: int, d: float, s4: int, e: float,
) -> int:  # fmt: skip
    """Write one word: sides (1 left, 0 straight, -1 right) and signed lengths, in circles of radius 1."""
    way = -1.0 if flips & 1 else 1.0
    side = -1.0 if flips & 2 else 1.0
    out[k, 0, 0], out[k, 0, 1] = side * s0, way * a
    out[k, 1, 0], out[k, 1, 1] = side * s1, way * b
    out[k, 2, 0], out[k, 2, 1] = side * s2, way * c
    out[k, 3, 0], out[k, 3, 1] = side * s3, way * d
    out[k, 4, 0], out[k, 4, 1] = side * s4, way * e
    return k + 1


@njit(nogil=True, cache=True)
def _ccc(x: float, y: float, phi: float) -> tuple[bool, float, float, float]:
    """Formula 8.3: left, right in reverse, left."""
    xi = x - math.sin(phi)
    eta = y - 1.0 + math.cos(phi)
    rho = math.hypot(xi, eta)
    if rho > 4.0:
        return False, 0.0, 0.0, 0.0
    u = -2.0 * math.asin(0.25 * rho)
    t = _mod(math.atan2(eta, xi) + 0.5 * u + math.pi)
    return t >= -_TINY and u <= _TINY, t, u, _mod(phi - t + u)


@njit(nogil=True, cache=True)
def _tau_omega(u: float, v: float, xi: float, eta: float, phi: float) -> tuple[float, float]:
    """The first and the last turn of four."""
    delta = _mod(u - v)
    a = math.sin(u) - math.sin(delta)
    b = math.cos(u) - math.cos(delta) - 1.0
    lead = math.atan2(eta * a - xi * b, xi * a + eta * b)
    if 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0 < 0.0:
        lead += math.pi
    tau = _mod(lead)
    return tau, _mod(tau - u + v - phi)


@njit(nogil=True, cache=True)
def _ccs(x: float, y: float, phi: float, opposite: bool) -> tuple[bool, float, float, float]:
    """Formulas 8.9 and 8.10: left, a quarter right in reverse, straight in reverse, left (8.9) or right."""
    if opposite:
        xi = x + math.sin(phi)
        eta = y - 1.0 - math.cos(phi)
        rho = math.hypot(xi, eta)
        t = math.atan2(xi, -eta)
        u = 2.0 - rho
        v = _mod(t + _QUARTER - phi)
        return rho >= 2.0 and t >= -_TINY and v <= _TINY, t, u, v
    xi = x - math.sin(phi)
    eta = y - 1.0 + math.cos(phi)
    rho = math.hypot(xi, eta)
    if rho < 2.0:
        return False, 0.0, 0.0, 0.0
    r = math.sqrt(rho * rho - 4.0)
    t = _mod(math.atan2(eta, xi) + math.atan2(r, -2.0))
    v = _mod(phi - _QUARTER - t)
    return t >= -_TINY and v <= _TINY, t, 2.0 - r, v


@njit(nogil=True, cache=True)
def words(x: float, y: float, phi: float, out: Floats) -> int:
    """All ways of Reeds and Shepp from the origin to a pose, circles of radius 1: writes `out` (44, 5, 2), returns
    their count. The shortest of them is the shortest way of a car that may reverse."""
    k = 0
    for flips in range(4):
        fx = -x if flips & 1 else x
        fy = -y if flips & 2 else y
        f = phi if flips in {0, 3} else -phi
        s = math.sin(f)
        c = math.cos(f)
        same_x, same_y = fx - s, fy - 1.0 + c  # to the middle of the last circle if that is a left one
        other_x, other_y = fx + s, fy - 1.0 - c
        t = math.atan2(same_y, same_x)  # 8.1
        v = _mod(f - t)
        if t >= -_TINY and v >= -_TINY:
            k = _put(out, k, flips, 1, t, 0, math.hypot(same_x, same_y), 1, v, 0, 0.0, 0, 0.0)
        rho2 = other_x * other_x + other_y * other_y
        if rho2 >= 4.0:  # 8.2
            u = math.sqrt(rho2 - 4.0)
            t = _mod(math.atan2(other_y, other_x) + math.atan2(2.0, u))
            v = _mod(t - f)
            if t >= -_TINY and v >= -_TINY:
                k = _put(out, k, flips, 1, t, 0, u, -1, v, 0, 0.0, 0, 0.0)
        bx = fx * c + fy * s
        by = fx * s - fy * c
        fits, t, u, v = _ccc(fx, fy, f)  # 8.3
        if fits:
            k = _put(out, k, flips, 1, t, -1, u, 1, v, 0, 0.0, 0, 0.0)
        fits, t, u, v = _ccc(bx, by, f)
        if fits:
            k = _put(out, k, flips, 1, v, -1, u, 1, t, 0, 0.0, 0, 0.0)
        rho = 0.25 * (2.0 + math.sqrt(rho2))
        if rho <= 1.0:  # 8.7
            u = math.acos(rho)
            t, v = _tau_omega(u, -u, other_x, other_y, f)
            if t >= -_TINY and v <= _TINY:
                k = _put(out, k, flips, 1, t, -1, u, 1, -u, -1, v, 0, 0.0)
        rho = (20.0 - rho2) / 16.0
        if 0.0 <= rho <= 1.0:  # 8.8
            u = -math.acos(rho)
            t, v = _tau_omega(u, u, other_x, other_y, f)
            if t >= -_TINY and v >= -_TINY:
                k = _put(out, k, flips, 1, t, -1, u, 1, u, -1, v, 0, 0.0)
        for opposite in range(2):
            last = -1 if opposite else 1
            fits, t, u, v = _ccs(fx, fy, f, opposite == 1)
            if fits:
                k = _put(out, k, flips, 1, t, -1, -_QUARTER, 0, u, last, v, 0, 0.0)
            fits, t, u, v = _ccs(bx, by, f, opposite == 1)
            if fits:
                k = _put(out, k, flips, last, v, 0, u, -1, -_QUARTER, 1, t, 0, 0.0)
        if rho2 >= 4.0:  # 8.11
            u = 4.0 - math.sqrt(rho2 - 4.0)
            if u <= _TINY:
                t = _mod(math.atan2((4.0 - u) * other_x - 2.0 * other_y, -2.0 * other_x + (u - 4.0) * other_y))
                v = _mod(t - f)
                if t >= -_TINY and v >= -_TINY:
                    k = _put(out, k, flips, 1, t, -1, -_QUARTER, 0, u, 1, -_QUARTER, -1, v)
    return k


@njit(nogil=True, cache=True)
def ways(pose: Floats, goal: Floats, tightest: float, out: Floats) -> int:
    """Like `words`, from `pose` to `goal` (3,), in metres and curvatures up to `tightest`."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    dx = (goal[0] - pose[0]) * tightest
    dy = (goal[1] - pose[1]) * tightest
    count = words(c * dx + s * dy, -s * dx + c * dy, _mod(goal[2] - pose[2]), out)
    for k in range(count):
        for e in range(5):
            out[k, e, 0] *= tightest
            out[k, e, 1] /= tightest
    return count


@njit(nogil=True, cache=True)
def ways_to_point(pose: Floats, goal: Floats, tightest: float, out: Floats) -> int:
    """The four ways turn, straight (forward or in reverse) to the point of `goal`, whatever the heading there."""
    c = math.cos(pose[2])
    s = math.sin(pose[2])
    k = 0
    for flips in range(4):
        x = (c * (goal[0] - pose[0]) + s * (goal[1] - pose[1])) * tightest
        y = (-s * (goal[0] - pose[0]) + c * (goal[1] - pose[1])) * tightest
        x = -x if flips & 1 else x
        y = -y if flips & 2 else y
        rho2 = x * x + (y - 1.0) * (y - 1.0)
        if rho2 < 1.0:
            continue
        straight = math.sqrt(rho2 - 1.0)
        turn = math.atan2(y - 1.0, x) - math.atan2(-1.0, straight)
        turn -= _TURN * math.floor(turn / _TURN + 1e-9)
        k = _put(out, k, flips, 1, max(turn, 0.0), 0, straight, 0, 0.0, 0, 0.0, 0, 0.0)
        for e in range(5):
            out[k - 1, e, 0] *= tightest
            out[k - 1, e, 1] /= tightest
    return k


@njit(nogil=True, cache=True)
def cheapest_way(pose: Floats, before: Floats, goal: Floats, costs: Floats, table: Floats, out: Floats) -> float:
    """The cheapest way from `pose` to `goal` if nothing were tight: writes `out` (5, 2), returns its cost."""
    best = math.inf
    for k in range(ways(pose, goal, costs[4], table)):
        cost = least_cost(costs, before, table[k])
        if cost < best:
            best = cost
            copy_elements(table[k], out, 5)
    return best


@njit(nogil=True, cache=True)
def best_connection(
    field_m: Floats,
    frame: Floats,
    car: Floats,
    start: Floats,
    costs: Floats,
    pose: Floats,
    before: Floats,
    goal: Floats,
    free_heading: bool,
    limit: float,
    table: Floats,
    out: Floats,
) -> float:
    """The cheapest free way that costs less than `limit`; its elements go to `out` (5, 2). inf if there is none.

    `before` (2,): the element that led to `pose`. `table` (44, 5, 2) is overwritten.
    """
    at = np.empty(3)
    best = limit
    found = False
    count = ways_to_point(pose, goal, costs[4], table) if free_heading else ways(pose, goal, costs[4], table)
    for k in range(count):
        if least_cost(costs, before, table[k]) >= best:
            continue
        copy_pose(pose, at)
        cost = drive_elements(field_m, frame, car, start, costs, at, before, table[k], best)
        if cost < best:
            best = cost
            found = True
            copy_elements(table[k], out, 5)
    return best if found else math.inf


@njit(nogil=True, cache=True)
def prices(
    field_m: Floats, frame: Floats, car: Floats, start: Floats, costs: Floats, elements: Floats, count: int,
    poses: Floats, spent: Floats,
) -> None:  # fmt: skip
    """Write where each element begins, `poses` (count + 1, 3), and what it costs to get there, `spent` (count + 1,)."""
    copy_pose(start, poses[0])
    spent[0] = 0.0
    for k in range(count):
        copy_pose(poses[k], poses[k + 1])
        cost = 0.0
        if k > 0:
            cost = change_cost(costs, elements[k - 1, 0], elements[k - 1, 1], elements[k, 0], elements[k, 1])
        cost += drive_element(
            field_m, frame, car, start, costs, poses[k + 1], elements[k, 0], elements[k, 1], math.inf
        )  # fmt: skip
        spent[k + 1] = spent[k] + cost


@njit(nogil=True, cache=True)
def shorten(
    field_m: Floats,
    frame: Floats,
    car: Floats,
    start: Floats,
    costs: Floats,
    goal: Floats,
    free_heading: bool,
    elements: Floats,
    count: int,
) -> int:
    """One round of shortcuts: replace stretches of `elements` (cap, 2) by cheaper free ways; returns the new count."""
    poses = np.empty((len(elements) + 1, 3))
    spent = np.empty(len(elements) + 1)
    table = np.empty((44, 5, 2))
    way = np.empty((5, 2))
    before = np.zeros(2)
    prices(field_m, frame, car, start, costs, elements, count, poses, spent)
    first = 0
    while first < count:
        if first > 0:
            before[0], before[1] = elements[first - 1, 0], elements[first - 1, 1]
        for last in range(count, first + 1, -1):
            at_goal = last == count
            limit = spent[last] - spent[first] - 1e-3
            target = goal if at_goal else poses[last]
            if not at_goal:
                here, after = elements[last - 1], elements[last]
                limit += change_cost(costs, here[0], here[1], after[0], after[1])
            cost = best_connection(
                field_m, frame, car, start, costs, poses[first], before, target, at_goal and free_heading,
                limit, table, way,
            )  # fmt: skip
            if cost == math.inf:
                continue
            joined = 0.0
            length = 0
            for e in range(5):
                if abs(way[e, 1]) > 1e-6:
                    if not at_goal:
                        joined = change_cost(costs, way[e, 0], way[e, 1], elements[last, 0], elements[last, 1])
                    length += 1
            if cost + joined >= limit or count - (last - first) + length > len(elements):
                continue
            count = _splice(elements, count, first, last, way)
            prices(field_m, frame, car, start, costs, elements, count, poses, spent)
            break
        first += 1
    return count


@njit(nogil=True, cache=True)
def _splice(elements: Floats, count: int, first: int, last: int, way: Floats) -> int:
    """Put the elements of `way` that have a length in the place of those from `first` to `last`."""
    length = 0
    for e in range(5):
        length += abs(way[e, 1]) > 1e-6
    shift = length - (last - first)
    if shift > 0:
        for k in range(count - 1, last - 1, -1):
            elements[k + shift, 0], elements[k + shift, 1] = elements[k, 0], elements[k, 1]
    elif shift < 0:
        for k in range(last, count):
            elements[k + shift, 0], elements[k + shift, 1] = elements[k, 0], elements[k, 1]
    k = first
    for e in range(5):
        if abs(way[e, 1]) > 1e-6:
            elements[k, 0], elements[k, 1] = way[e, 0], way[e, 1]
            k += 1
    return count + shift
