"""Plans a path that the car can drive, forward and in reverse, to a point of the map."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2
from shared.runtime.clock import stopwatch_s
from station_gui.mapping.snapshot import GridMap
from station_gui.planning.config import PlannerConfig
from station_gui.planning.costmap import Costmap, make_costmap
from station_gui.planning.guide import Guide, coarsening, make_guide
from station_gui.planning.lattice.search import LatticeSearch, is_closed_in
from station_gui.planning.road import MOST_ELEMENTS, Road, body_clearance_m, walk
from station_gui.planning.rrt import Tree
from station_gui.planning.target import Target

_ROUNDS = 3  # of shortcuts at the end, at most; one for a way that is only a beginning


class Refusal(Enum):
    """Why there is no plan."""

    OUTSIDE_MAP = "the goal is outside the map"
    UNKNOWN = "the goal is in unknown space"
    OCCUPIED = "the goal is inside an obstacle"
    TOO_NEAR = "the goal is too near to an obstacle"
    ROBOT_BLOCKED = "the robot stands against an obstacle in the map"
    NO_WAY = "there is no way for the car to the goal"
    NOT_FOUND = "no way to the goal was found in time"


class PlanningError(Exception):
    """There is no plan; the text says why."""

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.value)
        self.refusal = refusal


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """`path`: (N, 3) float64, x_m, y_m, theta_rad of the robot, map frame, at most `spacing_m` apart.

    Where the heading points against the way to the next point, the car goes in reverse.
    `clearance_m`: of the body to anything that is not free, along the way; at most margin and comfort together.
    `cost_m`: what the planner makes small: metres, more of them where it is tight, in reverse and for each cusp.
    """

    path: NDArray[np.float64]
    length_m: float
    clearance_m: float
    cost_m: float
    planning_s: float


class PathPlanner:
    """Plans on occupancy grids; keeps nothing between calls."""

    def __init__(self, car: CarGeometry, config: PlannerConfig, now_s: Callable[[], float] = stopwatch_s) -> None:
        """`now_s` tells the time for the time-out: a clock that stands still makes a plan a function of the map."""
        self._now_s = now_s
        self._car = car
        self._config = config
        self._body = np.array([car.rear_m, car.front_m, car.width_m / 2, config.margin_m, config.comfort_m])

    def for_body(self, car: CarGeometry) -> PathPlanner:
        """One that plans in the same way for another robot."""
        return PathPlanner(car, self._config, self._now_s)

    def plan(
        self,
        grid: GridMap,
        map_from_robot: Pose2,
        goal_m: tuple[float, float],
        goal_heading_rad: float | None = None,
    ) -> Plan:
        """From where the robot stands to `goal_m`, map frame; raises `PlanningError`. Any heading will do if None."""
        began_s, time_is_up = stopwatch_s(), self._timer(self._config.timeout_s)
        costmap = make_costmap(grid, self._car, self._config.costmap, map_from_robot)
        self._check_goal(costmap, goal_m)
        road = self._road(costmap, map_from_robot)
        goal = self._target(road, goal_m, goal_heading_rad)
        guide = self._guide(costmap, road, goal)
        elements = self._way(road, guide, goal, time_is_up)
        path = walk(map_from_robot, elements, self._config.spacing_m)
        return Plan(
            path,
            float(np.abs(elements[:, 1]).sum()),
            self._clearance_m(costmap, path),
            road.cost(elements),
            stopwatch_s() - began_s,
        )

    def path_is_free(self, path: NDArray[np.floating], grid: GridMap, map_from_robot: Pose2 | None = None) -> bool:
        """Whether the car can still go along `path`, (N, 3), map frame; hand in what is left of it."""
        costmap = make_costmap(grid, self._car, self._config.costmap, map_from_robot)
        return self._clearance_m(costmap, np.asarray(path, np.float64)) >= self._config.check_margin_m

    def _way(self, road: Road, guide: Guide, goal: Target, time_is_up: Callable[[], bool]) -> NDArray[np.float64]:
        """Elements (M, 2) of the way by the method that is configured."""
        tree = self._config.tree
        if self._config.method == "rrt":
            found = self._explore(road, guide, goal, tree.most_samples, _ROUNDS, time_is_up)
            if found is None:
                raise PlanningError(Refusal.NOT_FOUND)
            return found
        first = self._first(road, guide, goal, time_is_up)
        if tree.samples == 0:
            return first
        growing = Tree(road, guide, goal, tree, tree.samples + MOST_ELEMENTS)
        if not growing.plant(first):
            return first
        better = road.shorten(growing.improve(tree.samples, time_is_up), goal.pose, goal.free_heading, _ROUNDS)
        return min(first, better, key=road.cost)

    def _first(self, road: Road, guide: Guide, goal: Target, time_is_up: Callable[[], bool]) -> NDArray[np.float64]:
        """A way, (M, 2): that of RRT, or a cheaper one of the lattice, which alone can tell that there is none."""
        config = self._config
        found = self._explore(road, guide, goal, config.tree.first_samples, 1, time_is_up)
        if found is None:
            if is_closed_in(road, guide, goal, config.lattice):
                raise PlanningError(Refusal.NO_WAY)
            search = LatticeSearch(road, guide, goal, config.lattice, config.lattice.max_expansions, math.inf)
            searched = search.find(time_is_up, self._timer(config.give_up_s))
        else:
            search = LatticeSearch(road, guide, goal, config.lattice, config.lattice.expansions, road.cost(found))
            searched = search.find(time_is_up, time_is_up)
        if searched is not None:
            searched = road.shorten(searched, goal.pose, goal.free_heading, rounds=1)
        ways = [way for way in (found, searched) if way is not None]
        if not ways:
            raise PlanningError(Refusal.NO_WAY if search.exhausted else Refusal.NOT_FOUND)
        return min(ways, key=road.cost)

    def _explore(
        self, road: Road, guide: Guide, goal: Target, samples: int, rounds: int, time_is_up: Callable[[], bool]
    ) -> NDArray[np.float64] | None:
        """The way by RRT, (M, 2), shortened in so many rounds."""
        way = Tree(road, guide, goal, self._config.tree, samples + 1).find(samples, time_is_up)
        return None if way is None else road.shorten(way, goal.pose, goal.free_heading, rounds)

    def _timer(self, seconds: float) -> Callable[[], bool]:
        """Tells whether so much time has passed since now."""
        until_s = self._now_s() + seconds
        return lambda: self._now_s() > until_s

    def _check_goal(self, costmap: Costmap, goal_m: tuple[float, float]) -> None:
        cell = costmap.cell_of(*goal_m)
        if cell is None:
            raise PlanningError(Refusal.OUTSIDE_MAP)
        if costmap.occupied[cell]:
            raise PlanningError(Refusal.OCCUPIED)
        if costmap.unknown[cell]:
            raise PlanningError(Refusal.UNKNOWN)

    def _target(self, road: Road, goal_m: tuple[float, float], heading_rad: float | None) -> Target:
        """The goal, if the car can stand there."""
        headings: NDArray[np.float64] = np.linspace(0.0, math.tau, self._config.lattice.headings, endpoint=False)
        if heading_rad is not None:
            headings = np.array([heading_rad])
        poses = np.column_stack((np.tile(goal_m, (len(headings), 1)), headings))
        fitting = headings[body_clearance_m(road.field_m, road.frame, road.car, poses) >= self._config.margin_m]
        if not len(fitting):
            raise PlanningError(Refusal.TOO_NEAR)
        return Target(np.array([*goal_m, heading_rad or 0.0]), heading_rad is None, fitting)

    def _road(self, costmap: Costmap, map_from_robot: Pose2) -> Road:
        config = self._config
        pose = map_from_robot.as_array()
        frame = np.array([*costmap.origin_m, costmap.cell_m])
        clear = float(body_clearance_m(costmap.clearance_m, frame, self._body, pose[None])[0])
        if clear <= 0.0:
            raise PlanningError(Refusal.ROBOT_BLOCKED)
        tightest = 1.0 / (config.turning_reserve * self._car.min_turning_radius_m)
        return Road(
            field_m=costmap.clearance_m,
            frame=frame,
            car=self._body,
            start=np.array([*pose, min(max(clear - 0.005, 0.003), config.margin_m)]),
            costs=np.array(
                [config.reverse_cost, config.cusp_cost_m, config.steering_cost_m, config.tight_cost, tightest]
            ),
        )

    def _guide(self, costmap: Costmap, road: Road, goal: Target) -> Guide:
        config = self._config.lattice
        factor = coarsening(costmap, config.cell_m, config.headings, config.max_states)
        guide = make_guide(road, goal.pose[:2], factor)
        if not guide.connected:
            raise PlanningError(Refusal.NO_WAY)
        return guide

    def _clearance_m(self, costmap: Costmap, path: NDArray[np.float64]) -> float:
        frame = np.array([*costmap.origin_m, costmap.cell_m])
        clear = body_clearance_m(costmap.clearance_m, frame, self._body, path)
        return float(clear.min(initial=math.inf))
