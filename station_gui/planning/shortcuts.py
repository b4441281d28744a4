"""Takes the detours of a grid search out of a path: turn-straight-turn connections between its own poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.planning import _kernels

_ROUNDS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Road:
    """Where the body fits and what driving costs, as the kernels take it."""

    clearance_m: NDArray[np.float64]
    origin_m: tuple[float, float]
    cell_m: float
    discs_m: NDArray[np.float64]
    radius_m: float
    comfort_m: float
    start: NDArray[np.float64]
    costs: NDArray[np.float64]

    def drive(self, pose: NDArray[np.float64], curvature_per_m: float, length_m: float) -> float:
        """Move `pose`, (3,), along an element; returns its cost, infinite where the body does not fit."""
        cost: float = _kernels.drive_element(
            self.clearance_m,
            self.origin_m[0],
            self.origin_m[1],
            self.cell_m,
            self.discs_m,
            self.radius_m,
            self.comfort_m,
            self.start,
            self.costs,
            pose,
            curvature_per_m,
            length_m,
        )
        return cost

    def connect(
        self,
        pose: NDArray[np.float64],
        before: NDArray[np.float64],
        goal: NDArray[np.float64],
        free_heading: bool,
        limit: float,
        out: NDArray[np.float64],
    ) -> float:
        """The cheapest turn-straight-turn from `pose` to `goal` below `limit`; its elements go to `out`, (3, 2)."""
        cost: float = _kernels.best_connection(
            self.clearance_m,
            self.origin_m[0],
            self.origin_m[1],
            self.cell_m,
            self.discs_m,
            self.radius_m,
            self.comfort_m,
            self.start,
            self.costs,
            pose,
            before,
            goal,
            free_heading,
            limit,
            out,
        )
        return cost


def shorten(
    road: Road, elements: NDArray[np.float64], goal: NDArray[np.float64], free_heading: bool
) -> NDArray[np.float64]:
    """Replace stretches of the path by cheaper free connections until none is found. `elements`: (M, 2)."""
    for _ in range(_ROUNDS):
        shorter = _one_round(road, _split(elements), goal, free_heading)
        if len(shorter) == len(elements) and np.allclose(shorter, elements):
            break
        elements = shorter
    return _merge(elements)


def _split(elements: NDArray[np.float64], longest_m: float = 0.25) -> NDArray[np.float64]:
    """Long elements in parts, so that shortcuts can begin and end within them."""
    rows = []
    for curvature, length in elements:
        parts = max(1, math.ceil(abs(length) / longest_m))
        rows += [(curvature, length / parts)] * parts
    return np.array(rows).reshape(-1, 2)


def _merge(elements: NDArray[np.float64]) -> NDArray[np.float64]:
    rows: list[list[float]] = []
    for curvature, length in elements:
        if rows and rows[-1][0] == curvature and rows[-1][1] * length > 0:
            rows[-1][1] += length
        else:
            rows.append([float(curvature), float(length)])
    return np.array(rows).reshape(-1, 2)


def _one_round(
    road: Road, elements: NDArray[np.float64], goal: NDArray[np.float64], free_heading: bool
) -> NDArray[np.float64]:
    poses, costs = _prices(road, elements)
    out = np.zeros((3, 2))
    first = 0
    while first < len(elements):
        before = elements[first - 1] if first else np.zeros(2)
        for last in range(len(elements), first + 1, -1):
            at_goal = last == len(elements)
            target = goal if at_goal else poses[last]
            price = costs[last] - costs[first] - 1e-3
            if not at_goal:
                price -= _kernels.change_cost(
                    road.costs, elements[last - 1, 0], elements[last - 1, 1], elements[last, 0], elements[last, 1]
                )
            found = road.connect(poses[first], before, target, at_goal and free_heading, price, out)
            if math.isfinite(found):
                new = out[np.abs(out[:, 1]) > 1e-6]
                elements = np.vstack((elements[:first], new, elements[last:]))
                poses, costs = _prices(road, elements)
                break
        first += 1
    return elements


def _prices(road: Road, elements: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(M + 1, 3) poses at the ends of the elements and (M + 1,) what it costs to get there."""
    poses = np.empty((len(elements) + 1, 3))
    costs = np.zeros(len(elements) + 1)
    poses[0] = road.start[:3]
    before = np.zeros(2)
    for k, (curvature, length) in enumerate(elements):
        poses[k + 1] = poses[k]
        change = _kernels.change_cost(road.costs, before[0], before[1], curvature, length)
        driven = road.drive(poses[k + 1], curvature, length)
        costs[k + 1] = costs[k] + change + driven
        before = elements[k]
    return poses, costs


def walk(start: Pose2, elements: NDArray[np.float64], spacing_m: float) -> NDArray[np.float64]:
    """(N, 3): x, y, theta along the elements, a point at least every `spacing_m`, cusps included."""
    rows = [start.as_array()]
    pose = start
    for curvature, length in elements:
        parts = max(1, math.ceil(abs(length) / spacing_m))
        for k in range(1, parts + 1):
            way = length * k / parts
            turn = curvature * way
            chord = way * float(np.sinc(turn / math.tau))
            rows.append((pose @ Pose2(chord * math.cos(turn / 2), chord * math.sin(turn / 2), turn)).as_array())
        pose = Pose2.from_array(rows[-1])
    return np.array(rows)
