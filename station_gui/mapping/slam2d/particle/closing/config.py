"""Parameters of bending the path; how loops are found is graph SLAM's, which has the same task with the same scans."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class BendConfig:
    """Nodes and edges of the path, and how it is bent."""

    node_distance_m: float = 1.0
    node_turn_rad: float = math.radians(60.0)
    shift_sigma_m: float = 0.01  # of an edge, on top of what its match says
    turn_sigma_rad: float = math.radians(0.15)
    misfit_ratio: float = 10.0  # wider by so much for each share of points that did not fit on its way: graph SLAM's
    reach_m: float = 30.0  # along the graph: what is farther may have drifted against the robot
    bend_chi2: float = 4.0  # a closure that the path agrees with better needs no bending
    bend_nodes: int = 8  # small corrections wait until this many nodes have come
    held_chi2: float = 12.0  # a closure that the bent path does not agree with is dropped
    draws_per_scan: int = 150  # scans of the bent map, while the particles go on
    tail_steps: int = 10  # particles that parted from the best one longer ago go on as its copies
