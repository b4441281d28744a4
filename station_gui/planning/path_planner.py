"""Plans a path that the car can drive, forward and in reverse, to a point of the map (hybrid A*)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2
from shared.runtime.clock import stopwatch_s
from station_gui.mapping.snapshot import GridMap
from station_gui.planning import _kernels
from station_gui.planning.costmap import Costmap, CostmapConfig, make_costmap
from station_gui.planning.shortcuts import Road, shorten, walk


@dataclass(frozen=True, slots=True)
class PlannerConfig:
    costmap: CostmapConfig = field(default_factory=CostmapConfig)
    margin_m: float = 0.05  # kept from everything; the robot itself insists on 3 cm
    check_margin_m: float = 0.02  # a path stays free while this much is left of it
    escape_m: float = 0.05  # a start that is so much too near to something is still a start
    comfort_m: float = 0.15  # beyond the margin; a path costs more where there is less
    turning_reserve: float = 1.08  # the path's circles are this much wider than the car's smallest
    discs: int = 4  # that cover the car
    headings: int = 72
    step_m: float = 0.12
    search_cell_m: float = 0.05
    max_states: int = 12_000_000  # the search's cells grow with the map beyond this
    max_expansions: int = 60_000
    reverse_cost: float = 1.6  # of a metre in reverse, in metres forward
    cusp_cost_m: float = 0.30
    steering_cost_m: float = 0.03
    tight_cost: float = 2.0  # of a metre at the margin
    spacing_m: float = 0.04


class Refusal(Enum):
    """Why there is no plan."""

    OUTSIDE_MAP = "the goal is outside the map"
    UNKNOWN = "the goal is in unknown space"
    OCCUPIED = "the goal is inside an obstacle"
    TOO_NEAR = "the goal is too near to an obstacle"
    ROBOT_BLOCKED = "the robot stands against an obstacle in the map"
    NO_WAY = "there is no way for the car to the goal"


class PlanningError(Exception):
    """There is no plan; the text says why."""

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.value)
        self.refusal = refusal


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """`path`: (N, 3) float64, x_m, y_m, theta_rad of the robot, map frame, at most `spacing_m` apart.

    Where the heading points against the way to the next point, the car goes in reverse.
    `clearance_m`: of the body to anything that is not free, along the way.
    """

    path: NDArray[np.float64]
    length_m: float
    clearance_m: float
    planning_s: float


class PathPlanner:
    """Plans on occupancy grids; keeps nothing between calls."""

    def __init__(self, car: CarGeometry, config: PlannerConfig) -> None:
        self._car = car
        self._config = config
        self._discs_m, self._radius_m = _cover(car, config.discs)

    def plan(
        self,
        grid: GridMap,
        map_from_robot: Pose2,
        goal_m: tuple[float, float],
        goal_heading_rad: float | None = None,
    ) -> Plan:
        """From where the robot stands to `goal_m`, map frame; raises `PlanningError`. Any heading will do if None."""
        began_s = stopwatch_s()
        costmap = make_costmap(grid, self._car, self._config.costmap, map_from_robot)
        self._check_goal(costmap, goal_m)
        road = self._road(costmap, map_from_robot)
        goal = np.array([*goal_m, 0.0 if goal_heading_rad is None else goal_heading_rad])
        elements = self._search(costmap, road, goal, goal_heading_rad is None)
        elements = shorten(road, elements, goal, goal_heading_rad is None)
        path = walk(map_from_robot, elements, self._config.spacing_m)
        return Plan(
            path,
            float(np.abs(elements[:, 1]).sum()),
            self._clearance_m(costmap, path),
            stopwatch_s() - began_s,
        )

    def path_is_free(self, path: NDArray[np.floating], grid: GridMap, map_from_robot: Pose2 | None = None) -> bool:
        """Whether the car can still go along `path`, (N, 3), map frame; hand in what is left of it."""
        costmap = make_costmap(grid, self._car, self._config.costmap, map_from_robot)
        return self._clearance_m(costmap, np.asarray(path, np.float64)) >= self._config.check_margin_m

    def _check_goal(self, costmap: Costmap, goal_m: tuple[float, float]) -> None:
        cell = costmap.cell_of(*goal_m)
        if cell is None:
            raise PlanningError(Refusal.OUTSIDE_MAP)
        if costmap.occupied[cell]:
            raise PlanningError(Refusal.OCCUPIED)
        if costmap.unknown[cell]:
            raise PlanningError(Refusal.UNKNOWN)
        if costmap.clearance_m[cell] < self._car.width_m / 2 + self._config.check_margin_m:
            raise PlanningError(Refusal.TOO_NEAR)

    def _road(self, costmap: Costmap, map_from_robot: Pose2) -> Road:
        config = self._config
        pose = map_from_robot.as_array()
        clear = self._body_clearance_m(costmap, pose)
        needed = self._radius_m + config.margin_m
        if clear < self._radius_m - config.escape_m:
            raise PlanningError(Refusal.ROBOT_BLOCKED)
        tightest = 1.0 / (config.turning_reserve * self._car.min_turning_radius_m)
        return Road(
            clearance_m=costmap.clearance_m,
            origin_m=costmap.origin_m,
            cell_m=costmap.cell_m,
            discs_m=self._discs_m,
            radius_m=needed,
            comfort_m=config.comfort_m,
            start=np.array([*pose, min(clear - 0.005, needed)]),
            costs=np.array(
                [config.reverse_cost, config.cusp_cost_m, config.steering_cost_m, config.tight_cost, tightest]
            ),
        )

    def _search(
        self, costmap: Costmap, road: Road, goal: NDArray[np.float64], free_heading: bool
    ) -> NDArray[np.float64]:
        config = self._config
        factor = self._coarsening(costmap)
        passable = ndimage.maximum_filter(costmap.clearance_m, factor)[factor // 2 :: factor, factor // 2 :: factor]
        way_m = np.empty(passable.shape)
        cell_m = factor * costmap.cell_m
        column, row = ((goal[:2] - costmap.origin_m) / cell_m).astype(int)
        row, column = min(row, passable.shape[0] - 1), min(column, passable.shape[1] - 1)
        _kernels.ways_to_goal(passable >= self._car.width_m / 2, cell_m, row, column, way_m)
        elements = np.zeros((2000, 2))
        count = _kernels.search(
            road.clearance_m,
            road.origin_m[0],
            road.origin_m[1],
            road.cell_m,
            road.discs_m,
            road.radius_m,
            road.comfort_m,
            road.start,
            road.costs,
            goal,
            free_heading,
            way_m,
            cell_m,
            config.headings,
            config.step_m,
            config.max_expansions,
            elements,
        )
        if count == 0:
            raise PlanningError(Refusal.NO_WAY)
        return elements[:count]

    def _coarsening(self, costmap: Costmap) -> int:
        """How many cells of the map make one of the search, so that its states stay bounded."""
        cells = costmap.clearance_m.size * self._config.headings
        wanted = max(self._config.search_cell_m / costmap.cell_m, math.sqrt(cells / self._config.max_states))
        return max(1, math.ceil(wanted - 1e-9))

    def _body_clearance_m(self, costmap: Costmap, pose: NDArray[np.float64]) -> float:
        return _kernels.body_clearance(
            costmap.clearance_m,
            costmap.origin_m[0],
            costmap.origin_m[1],
            costmap.cell_m,
            self._discs_m,
            pose[0],
            pose[1],
            pose[2],
        )

    def _clearance_m(self, costmap: Costmap, path: NDArray[np.float64]) -> float:
        return min((self._body_clearance_m(costmap, pose) for pose in path), default=math.inf) - self._radius_m


def _cover(car: CarGeometry, count: int) -> tuple[NDArray[np.float64], float]:
    """The middles and the radius of discs along the car's axis that cover its rectangle."""
    part = (car.front_m + car.rear_m) / count
    middles = -car.rear_m + part * (np.arange(count, dtype=np.float64) + 0.5)
    return middles, math.hypot(part / 2, car.width_m / 2)
