"""Runs every kernel of the planning once, so that neither compiling nor loading one holds up the first goal."""

from __future__ import annotations

from functools import cache

import numpy as np

from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2
from station_gui.mapping.snapshot import GridMap
from station_gui.planning.config import LatticeConfig, PlannerConfig, TreeConfig
from station_gui.planning.path_planner import PathPlanner, PlanningError

_CELLS = 100
_CELL_M = 0.02
_CAR = CarGeometry(0.26, 0.17, 0.04, 0.5, 0.305, 0.045, 0.20)


@cache
def rehearse() -> None:
    """Once in the life of the process: a way in reverse, a heading that is asked for, and a goal that is cut off."""
    grid = GridMap(np.zeros((_CELLS, _CELLS), np.float32), (-1.0, -1.0), _CELL_M)
    config = PlannerConfig(lattice=LatticeConfig(expansions=20, max_expansions=20), tree=TreeConfig(samples=20))
    planner = PathPlanner(_CAR, config)
    planner.plan(grid, Pose2(), (-0.4, 0.3))
    planner.plan(grid, Pose2(), (0.4, 0.2), 1.0)
    hopeless = PathPlanner(_CAR, PlannerConfig(lattice=config.lattice, tree=TreeConfig(first_samples=0)))
    try:
        hopeless.plan(grid, Pose2(), (-0.4, 0.3))
    except PlanningError:
        return
