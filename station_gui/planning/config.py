"""Everything that can be set about the planning."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from station_gui.planning.costmap import CostmapConfig


@dataclass(frozen=True, slots=True)
class LatticeConfig:
    """Of hybrid A*, which finds a cheap way, or that there is none."""

    headings: int = 72
    step_m: float = 0.12
    cell_m: float = 0.05
    max_states: int = 12_000_000  # the search's cells grow with the map beyond this
    expansions: int = 8_000  # for a way that is cheaper than one that is known
    max_expansions: int = 50_000  # for any way: what these do not find would take longer than half a second
    pocket: int = 20_000  # poses: a goal that is joined to fewer, and not to the start, is refused at once
    batch: int = 500  # between two looks at the clock, which are some 5 ms apart then


@dataclass(frozen=True, slots=True)
class TreeConfig:
    """Of RRT* and of RRT."""

    first_samples: int = 2000  # of RRT, for any way
    first_detour: float = (
        1.3  # every other batch of RRT is drawn where ways lead that are so much longer than the least
    )
    samples: int = 600  # of RRT*, for a better one: a count and no time, so that the same map gives the same path
    most_samples: int = 20_000  # of RRT where it is the method
    batch: int = 100  # between two looks at the clock
    reach_m: float = 1.2  # longest edge
    goal_share: float = 0.1  # of the samples at the goal
    path_share: float = 0.4  # of the others of RRT* near the best path so far
    path_spread_m: float = 0.15
    path_spread_rad: float = 0.35
    seed: int = 1


@dataclass(frozen=True, slots=True)
class PlannerConfig:
    method: Literal["rrt_star", "rrt"] = "rrt_star"  # "rrt" is that of paper 1
    costmap: CostmapConfig = field(default_factory=CostmapConfig)
    lattice: LatticeConfig = field(default_factory=LatticeConfig)
    tree: TreeConfig = field(default_factory=TreeConfig)
    timeout_s: float = 0.4  # then the best way so far is taken
    give_up_s: float = 2.0  # where none is known by then
    margin_m: float = 0.05  # kept from everything; the robot itself insists on 3 cm
    check_margin_m: float = 0.02  # a path stays free while this much is left of it
    comfort_m: float = 0.15  # beyond the margin; a path costs more where there is less
    turning_reserve: float = 1.08  # the path's circles are this much wider than the car's smallest
    reverse_cost: float = 1.6  # of a metre in reverse, in metres forward
    cusp_cost_m: float = 0.30
    steering_cost_m: float = 0.03
    tight_cost: float = 2.0  # of a metre at the margin
    spacing_m: float = 0.04
