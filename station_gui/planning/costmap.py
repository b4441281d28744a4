"""Where the car may be: the clearance to everything that is not known to be free."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2
from station_gui.mapping.snapshot import GridMap


@dataclass(frozen=True, slots=True)
class CostmapConfig:
    occupied_probability: float = 0.65  # at and above this a cell is an obstacle; the map calls 0.75 occupied
    free_probability: float = 0.45  # at and below this a cell is free; in between nothing is known
    speck_m2: float = 0.012  # unknown spots smaller than this amid free space are free: no beam hit just them
    blind_m: float = 0.10  # unknown cells so near to the standing robot are free: its scanner cannot see them


@dataclass(frozen=True, slots=True, eq=False)
class Costmap:
    """`clearance_m`: (rows, columns), from each cell's centre to the border of the nearest cell that is not free.

    Unknown space is not traversable. `unknown` and `occupied` are (rows, columns) bool.
    """

    clearance_m: NDArray[np.float64]
    unknown: NDArray[np.bool_]
    occupied: NDArray[np.bool_]
    origin_m: tuple[float, float]
    cell_m: float

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int] | None:
        """(row, column), None outside the map."""
        row = math.floor((y_m - self.origin_m[1]) / self.cell_m)
        column = math.floor((x_m - self.origin_m[0]) / self.cell_m)
        rows, columns = self.clearance_m.shape
        return (row, column) if 0 <= row < rows and 0 <= column < columns else None


def make_costmap(
    grid: GridMap, car: CarGeometry, config: CostmapConfig, map_from_robot: Pose2 | None = None
) -> Costmap:
    """The robot stands at `map_from_robot`, so nothing else does: the cells under it are free."""
    occupied = grid.probability >= config.occupied_probability
    unknown = ~occupied & (grid.probability > config.free_probability)
    unknown &= ~_specks(unknown, occupied, config.speck_m2 / grid.cell_m**2)
    if map_from_robot is not None:
        rows, columns = _window(grid, car, map_from_robot, config.blind_m)
        occupied[rows, columns] &= ~_near_car(grid, car, map_from_robot, rows, columns, grid.cell_m / 2)
        unknown[rows, columns] &= ~_near_car(grid, car, map_from_robot, rows, columns, config.blind_m)
    free = np.pad(~(occupied | unknown), 1, constant_values=False)  # beyond the map nothing is known
    distance = ndimage.distance_transform_edt(free)[1:-1, 1:-1]
    clearance = np.maximum(distance - 0.5, 0.0) * grid.cell_m
    return Costmap(clearance, unknown, occupied, grid.origin_m, grid.cell_m)


def _specks(unknown: NDArray[np.bool_], occupied: NDArray[np.bool_], cells: float) -> NDArray[np.bool_]:
    """Small unknown spots that no obstacle touches: what lies inside an obstacle stays unknown."""
    labels, count = ndimage.label(unknown)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    beside_obstacle = np.zeros(count + 1, bool)
    beside_obstacle[labels[1:][occupied[:-1]]] = True
    beside_obstacle[labels[:-1][occupied[1:]]] = True
    beside_obstacle[labels[:, 1:][occupied[:, :-1]]] = True
    beside_obstacle[labels[:, :-1][occupied[:, 1:]]] = True
    small = (sizes < cells) & ~beside_obstacle
    small[0] = False  # what is not unknown
    of_specks: NDArray[np.bool_] = small[labels]
    return of_specks


def _window(grid: GridMap, car: CarGeometry, map_from_robot: Pose2, slack: float) -> tuple[slice, slice]:
    """The rows and columns in which the car can be."""
    reach = math.hypot(max(car.rear_m, car.front_m), car.width_m / 2) + 2 * slack + grid.cell_m
    place = (map_from_robot.y_m - grid.origin_m[1], map_from_robot.x_m - grid.origin_m[0])
    low, high = ([max(0, math.floor((at + side) / grid.cell_m)) for at in place] for side in (-reach, reach))
    return slice(low[0], high[0] + 1), slice(low[1], high[1] + 1)


def _near_car(
    grid: GridMap, car: CarGeometry, map_from_robot: Pose2, rows: slice, columns: slice, slack: float
) -> NDArray[np.bool_]:
    """Whether the cells of some rows and columns are under the car or no farther from it than the slack."""
    height, width = grid.probability.shape
    x = grid.origin_m[0] + (np.arange(width)[columns] + 0.5) * grid.cell_m
    y = grid.origin_m[1] + (np.arange(height)[rows] + 0.5) * grid.cell_m
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    at = map_from_robot.inverse().apply(centres)
    inside = (
        (at[:, 0] >= -car.rear_m - slack)
        & (at[:, 0] <= car.front_m + slack)
        & (np.abs(at[:, 1]) <= car.width_m / 2 + slack)
    )
    return inside.reshape(len(y), len(x))
