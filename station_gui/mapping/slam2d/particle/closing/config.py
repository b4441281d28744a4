"""Parameters of closing loops.

Where no source is named a value is graph SLAM's, which has the same task between the same scans.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SearchConfig:
    """Search for places seen before, and what a closure must show to be believed."""

    cell_m: float = 0.1
    levels: int = 5  # coarsest step: 2**levels cells
    min_way_m: float = 12.0  # along the graph: nearer ones are joined by the particles' maps
    drift_ratio: float = 0.03  # of the way along the graph: how far the estimate may be off
    drift_fixed_m: float = 0.3
    max_search_m: float = 8.0
    search_turn_rad: float = math.radians(20.0)
    overlap_m: float = 3.0  # nodes this far apart still see the same
    neighbours: int = 3  # nodes on each side that make the place's map
    query_neighbours: int = 1
    query_stride: int = 3  # of the query's scans
    max_query_points: int = 300
    min_query_points: int = 30
    max_candidates: int = 2  # per new node; 0: no loop is looked for
    max_waiting: int = 200
    min_score: float = 0.55  # mean likelihood of branch and bound
    min_inlier_share: float = 0.7
    max_refinement_m: float = 0.5  # what least squares may still move after the search
    max_branches: int = 20_000
    place_size_m: float = 51.2
    place_reach_cells: int = 8
    max_place_surfels: int = 20_000
    agreement_m: float = 0.3  # with the path, or of two far closures that confirm each other
    agreement_rad: float = math.radians(3.0)
    agreement_nodes: int = 15  # between two closures that confirm each other
    max_unconfirmed: int = 30


@dataclass(frozen=True, slots=True)
class BendConfig:
    """Nodes and edges of the path, and how it is bent."""

    node_distance_m: float = 1.0
    node_turn_rad: float = math.radians(60.0)
    shift_sigma_m: float = 0.01  # of an edge, on top of what its match says
    turn_sigma_rad: float = math.radians(0.15)
    reach_m: float = 30.0  # along the graph: what is farther may have drifted against the robot
    bend_chi2: float = 4.0  # a closure that the path agrees with better needs no bending
    bend_nodes: int = 8  # small corrections wait until this many nodes have come
    held_chi2: float = 12.0  # a closure that the bent path does not agree with is dropped
    draws_per_scan: int = 150  # scans of the bent map, while the particles go on
    tail_steps: int = 10  # particles that parted from the best one longer ago go on as its copies
