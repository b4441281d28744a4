"""Where the body fits and what driving costs there: what every search of a path asks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.planning.body import _kernels as body
from station_gui.planning.steering import _kernels as steering

_PART_M = 0.25
MOST_ELEMENTS = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Road:
    """The arrays that the kernels of `body` and `steering` take."""

    field_m: NDArray[np.float64]
    frame: NDArray[np.float64]
    car: NDArray[np.float64]
    start: NDArray[np.float64]
    costs: NDArray[np.float64]

    def cost(self, elements: NDArray[np.float64]) -> float:
        """Of the way along `elements`, (M, 2), from the start; infinite where the body does not fit."""
        poses, spent = self.prices(elements)
        return float(spent[-1]) if len(poses) else 0.0

    def prices(self, elements: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(M + 1, 3) poses at the ends of the elements and (M + 1,) what it costs to get there."""
        poses, spent = np.empty((len(elements) + 1, 3)), np.empty(len(elements) + 1)
        steering.prices(
            self.field_m, self.frame, self.car, self.start, self.costs, elements, len(elements), poses, spent
        )
        return poses, spent

    def shorten(
        self, elements: NDArray[np.float64], goal: NDArray[np.float64], free_heading: bool, rounds: int
    ) -> NDArray[np.float64]:
        """Replace stretches of the way by cheaper free ones until none is found. `elements`: (M, 2)."""
        for _ in range(rounds):
            before = split(elements, _PART_M)
            room = np.zeros((max(len(before), MOST_ELEMENTS), 2))
            room[: len(before)] = before
            count = steering.shorten(
                self.field_m, self.frame, self.car, self.start, self.costs, goal, free_heading, room, len(before)
            )
            shorter = merge(room[:count])
            if len(shorter) == len(elements) and np.allclose(shorter, elements):
                break
            elements = shorter
        return elements


def body_clearance_m(
    field_m: NDArray[np.float64], frame: NDArray[np.float64], car: NDArray[np.float64], path: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N,): of the car's rectangle at each pose of `path`, (N, 3); at most margin and comfort together."""
    return np.array([body.body_clearance(field_m, frame, car, *pose) for pose in path.tolist()])


def split(elements: NDArray[np.float64], longest_m: float) -> NDArray[np.float64]:
    """Long elements in parts, so that shortcuts can begin and end within them."""
    rows = []
    for curvature, length in elements.tolist():
        parts = max(1, math.ceil(abs(length) / longest_m))
        rows += [(curvature, length / parts)] * parts
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def merge(elements: NDArray[np.float64]) -> NDArray[np.float64]:
    """Neighbours of one curvature and direction in one."""
    rows: list[list[float]] = []
    for curvature, length in elements.tolist():
        if rows and rows[-1][0] == curvature and rows[-1][1] * length > 0:
            rows[-1][1] += length
        else:
            rows.append([curvature, length])
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def walk(start: Pose2, elements: NDArray[np.float64], spacing_m: float) -> NDArray[np.float64]:
    """(N, 3): x, y, theta along the elements, a point at least every `spacing_m`, cusps included."""
    rows = [start.as_array()]
    for curvature, length in elements:
        parts = max(1, math.ceil(abs(length) / spacing_m))
        for _ in range(parts):
            pose = rows[-1].copy()
            steering.advance(pose, curvature, length / parts)
            rows.append(pose)
    return np.array(rows)
