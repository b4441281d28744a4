"""Where a robot can really get: an exhaustive search in the true room that shares nothing with the planner.

Poses in cells of 4 cm and 5 degrees are joined by short arcs of the car's tightest circle and by straight pieces, in
both directions, as long as the rectangle of the car touches none of the scenario's true boxes. A disc gets to all
places that are far enough from every box and joined to its own.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from shared.geometry.ackermann import CarGeometry
from shared.geometry.omni3 import OmniGeometry
from shared.geometry.se2 import Pose2
from tools.evaluate.goals import _kernels
from tools.simulator.scenario import Scenario
from tools.simulator.solids import solids_of

_CELL_M, _HEADINGS, _STEP_M = 0.04, 72, 0.06
_FAR_CELL_M = 0.02
_LOOKS_RAD = (-math.tau / 3, 0.0, math.tau / 3)


class Reach(Protocol):
    def poses_m(self) -> NDArray[np.float64]:
        """(N, 3): the middles of all cells of x, y and heading that the robot gets to, room frame."""
        ...

    def places(self) -> int:
        """In how many cells of x and y its origin can be."""
        ...

    def places_that_fit(self) -> int:
        """In how many it could be if it were put down there, with any heading."""
        ...


def reach_of(scenario: Scenario, body: CarGeometry | OmniGeometry, room_from_robot: Pose2, margin_m: float) -> Reach:
    """All that the robot with this body reaches from where it stands, with `margin_m` kept on all sides."""
    if isinstance(body, CarGeometry):
        return Reachable(scenario, body, room_from_robot, margin_m)
    return DiscReachable(scenario, body, room_from_robot, margin_m)


class DiscReachable:
    """It turns on the spot, so three headings stand for all that the scanner can look to."""

    def __init__(self, scenario: Scenario, omni: OmniGeometry, room_from_robot: Pose2, margin_m: float) -> None:
        self._fits = _far_m(scenario, _boxes(scenario)) >= omni.radius_m + margin_m
        islands, _ = ndimage.label(self._fits)
        row, column = (math.floor(v / _FAR_CELL_M) for v in (room_from_robot.y_m, room_from_robot.x_m))
        self._reached: NDArray[np.bool_] = (islands == islands[row, column]) & self._fits

    def poses_m(self) -> NDArray[np.float64]:
        row, column = np.nonzero(self._reached)
        places = np.column_stack((column + 0.5, row + 0.5)) * _FAR_CELL_M
        return np.vstack([np.column_stack((places, np.full(len(places), turn))) for turn in _LOOKS_RAD])

    def places(self) -> int:
        return int(self._reached.sum())

    def places_that_fit(self) -> int:
        return int(self._fits.sum())


class Reachable:
    """All that the car reaches from where it stands, with `margin_m` kept on all sides."""

    def __init__(self, scenario: Scenario, car: CarGeometry, room_from_robot: Pose2, margin_m: float) -> None:
        self._boxes = _boxes(scenario)
        self._car = np.array([car.rear_m + margin_m, car.front_m + margin_m, car.width_m / 2 + margin_m])
        self._far_m = _far_m(scenario, self._boxes)
        shape = (
            math.ceil(scenario.room.width_y_m / _CELL_M),
            math.ceil(scenario.room.length_x_m / _CELL_M),
            _HEADINGS,
        )
        self._seen = np.zeros(shape, bool)
        start, bend = room_from_robot.as_array(), 1.0 / car.min_turning_radius_m
        stack = np.empty((self._seen.size + 1, 3))
        self.poses: int = _kernels.flood(
            self._boxes, self._car, self._far_m, _FAR_CELL_M, start, bend, _STEP_M, _CELL_M, self._seen, stack
        )

    def __contains__(self, place_m: tuple[float, float]) -> bool:
        """Whether the car gets to this place, room frame, with any heading."""
        i, j = math.floor(place_m[1] / _CELL_M), math.floor(place_m[0] / _CELL_M)
        if not (0 <= i < self._seen.shape[0] and 0 <= j < self._seen.shape[1]):
            return False
        headings = np.flatnonzero(self._seen[i, j])
        return any(self._is_free(place_m, (k + 0.5) * math.tau / _HEADINGS) for k in headings.tolist())

    def poses_m(self) -> NDArray[np.float64]:
        """(N, 3): the middles of all cells of x, y and heading that the car gets to, room frame."""
        row, column, heading = np.nonzero(self._seen)
        turn = (heading + 0.5) * math.tau / _HEADINGS
        return np.column_stack(((column + 0.5) * _CELL_M, (row + 0.5) * _CELL_M, turn))

    def places(self) -> int:
        """In how many cells of x and y the rear axle can be."""
        return int(self._seen.any(axis=2).sum())

    def places_that_fit(self) -> int:
        """In how many it could be if the car were put down there, with any heading."""
        fits = np.zeros((*self._seen.shape[:2], _HEADINGS // 3), bool)
        _kernels.places_that_fit(self._boxes, self._car, self._far_m, _FAR_CELL_M, _CELL_M, fits)
        return int(fits.any(axis=2).sum())

    def _is_free(self, place_m: tuple[float, float], theta: float) -> bool:
        return bool(_kernels.is_free(self._boxes, self._car, self._far_m, _FAR_CELL_M, *place_m, theta))


def _boxes(scenario: Scenario) -> NDArray[np.float64]:
    """(B, 6) of everything that is as low as the robot."""
    height_m = scenario.body.height_m
    rows = [
        (*s.center_m[:2], math.cos(s.yaw_rad), math.sin(s.yaw_rad), *s.half_m[:2])
        for s in solids_of(scenario)
        if s.center_m[2] - s.half_m[2] < height_m
    ]
    return np.array(rows, dtype=np.float64)


def _far_m(scenario: Scenario, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """To the nearest box from the middle of each cell; saves most of the exact tests."""
    x = (np.arange(math.ceil(scenario.room.length_x_m / _FAR_CELL_M)) + 0.5) * _FAR_CELL_M
    y = (np.arange(math.ceil(scenario.room.width_y_m / _FAR_CELL_M)) + 0.5) * _FAR_CELL_M
    grid_x, grid_y = np.meshgrid(x, y)
    far = np.full(grid_x.shape, math.inf)
    for px, py, c, s, hx, hy in boxes:
        dx, dy = grid_x - px, grid_y - py
        along = np.maximum(np.abs(c * dx + s * dy) - hx, 0.0)
        aside = np.maximum(np.abs(-s * dx + c * dy) - hy, 0.0)
        far = np.minimum(far, np.hypot(along, aside))
    return far
