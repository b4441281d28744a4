"""How far it is to a place for a point that may turn on the spot: what guides the searches of the car's way."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.planning.body import _kernels as body
from station_gui.planning.costmap import Costmap
from station_gui.planning.lattice import _kernels as lattice
from station_gui.planning.road import Road

_HEADINGS = 24


@dataclass(frozen=True, slots=True, eq=False)
class Guide:
    """`to_goal_m`, `from_start_m`: (rows, columns), infinite where there is no way; cells of `cell_m`."""

    to_goal_m: NDArray[np.float64]
    from_start_m: NDArray[np.float64]
    origin_m: tuple[float, float]
    cell_m: float

    @property
    def connected(self) -> bool:
        """Whether a point gets from the start to the goal."""
        return bool(np.isfinite(self.to_goal_m + self.from_start_m).any())

    @property
    def shortest_m(self) -> float:
        """The way of a point from the start to the goal."""
        return float((self.to_goal_m + self.from_start_m).min())

    def cells_within_m(self, way_m: float) -> NDArray[np.float64]:
        """(M, 2): the lower left corners of the cells through which a way of that length may lead."""
        both = self.to_goal_m + self.from_start_m
        # Cells are walked in eight directions: at most 8.3 % too far.
        rows, columns = np.nonzero(np.isfinite(both) & (0.92 * both <= way_m + 2 * self.cell_m))
        return np.column_stack((columns * self.cell_m + self.origin_m[0], rows * self.cell_m + self.origin_m[1]))


def make_guide(road: Road, goal_m: NDArray[np.float64], factor: int) -> Guide:
    """`factor` cells of the map, each way, make one of the guide.

    The point is the rear axle; it goes where the bare car fits with some heading. The margin, which is more than half
    a cell, makes up for looking at the middles of cells alone.
    """
    rows, columns = (-(-k // factor) for k in road.field_m.shape)
    cell_m = factor * float(road.frame[2])
    fits = np.empty((rows, columns), bool)
    body.where_it_fits(road.field_m, road.frame, road.car, cell_m, _HEADINGS, fits)
    ways = []
    for point in (goal_m, road.start[:2]):
        way_m = np.empty((rows, columns))
        column, row = ((point - road.frame[:2]) / cell_m).astype(int)
        row, column = min(max(int(row), 0), rows - 1), min(max(int(column), 0), columns - 1)
        lattice.ways_to_goal(fits, cell_m, row, column, way_m)
        ways.append(way_m)
    return Guide(ways[0], ways[1], (float(road.frame[0]), float(road.frame[1])), cell_m)


def coarsening(costmap: Costmap, cell_m: float, headings: int, max_states: int) -> int:
    """How many cells of the map make one of the search, so that its states stay bounded."""
    wanted = max(cell_m / costmap.cell_m, math.sqrt(costmap.clearance_m.size * headings / max_states))
    return max(1, math.ceil(wanted - 1e-9))
