"""Parameters of graph SLAM: one set for every log and for the robot.

Where no source is named a value was found on synthetic rooms and checked on all logs at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class NormalConfig:
    """How a scan's own points become lines."""

    half_window: int = 3  # neighbours on each side
    max_gap_m: float = 0.5  # between consecutive points of one surface
    max_rms_m: float = 0.05  # of the points about their line
    max_lonely_m: float = 0.3  # a point without a line and without a neighbour this near would hold the robot back


@dataclass(frozen=True, slots=True)
class LocalMapConfig:
    """The window of surfels round the robot that scans are matched with."""

    cell_m: float = 0.05  # Cartographer's and iris_lama's grid
    size_m: float = 51.2
    reach_cells: int = 8  # a scan may be this far off and still find its surfel
    max_surfels: int = 60_000
    max_count: float = 100.0  # older hits fade after this many
    graph_reach_m: float = 30.0  # along the graph: what is farther may have drifted against the robot
    view_m: float = 18.0  # keyframes this near to the robot are in the window
    rebuild_distance_m: float = 4.0  # driven between two rebuilds
    units_per_step: int = 12_000  # spreads a rebuild over the steps that follow; a unit is about 15 ns
    max_scans: int = 900
    max_nodes: int = 1000  # that are asked whether they are near


@dataclass(frozen=True, slots=True)
class MatchConfig:
    """Least squares on the local map, and the search when the prediction is doubtful."""

    wide_kernel_m: float = 0.2
    fine_kernel_m: float = 0.05
    inlier_m: float = 0.1
    point_weight: float = 0.3  # of a surfel without a normal, against one with
    max_iterations: int = 20
    min_points: int = 12
    doubtful_share: float = 0.8  # below this share of inliers the neighbourhood is searched
    better_share: float = 0.05  # what the search must win to be believed against the prediction
    lost_share: float = 0.6  # below this the odometry is believed,
    far_share: float = 0.9  # and below this when the match is as far as
    far_sigmas: float = 5.0  # from it: a robot that was carried off fits somewhere near by chance
    patience_scans: int = 20  # lost for longer than this a new piece of map begins
    noise_m: float = 0.03  # of one residual, beams of one wall being correlated
    odometry_shift_m: float = 0.03  # prior: fixed part and part of the way
    odometry_shift_ratio: float = 0.2
    odometry_turn_rad: float = math.radians(1.0)
    odometry_turn_ratio: float = 0.2
    weak_points: float = 15.0  # a direction that fewer points hold is left to the odometry,
    weak_weight: float = 10.0  # which then weighs as much as this many
    search_shift_m: float = 0.1
    search_shifts: int = 5
    search_turn_rad: float = math.radians(2.0)
    search_turns: int = 10
    search_points: int = 90


@dataclass(frozen=True, slots=True)
class NewGroundConfig:
    """When points that do not fit are taken for what the map does not know yet."""

    least_share: float = 0.3  # of the points have to fit all the same,
    min_points: float = 30.0  # and so many,
    max_sigmas: float = 5.0  # no farther than this from the prediction
    enough_share: float = 0.95  # with so many there is nothing to ask
    sure_share: float = 0.9  # of what the map knows has to fit
    views: int = 8  # newest scans that are asked, each so many keyframes after the other
    every: int = 3
    view_m: float = 3.0  # no farther than this
    view_points: int = 90  # of a scan
    margin_m: float = 0.15
    margin_ratio: float = 0.02  # of the range


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """What is made of odometry."""

    scale_prior_m: float = 10.0  # so much way says that its scale is right
    scale_memory_m: float = 100.0
    scale_points: float = 60.0  # that must hold the robot along its way for the scale to be learnt: 4 times weak
    silent_scans: int = 5  # odometry that says nothing in so many moving scans is not there
    moved_m: float = 0.02
    moved_rad: float = math.radians(1.0)
    silent_shift_m: float = 0.1  # how far off a robot may be that is taken to go on as before
    silent_turn_rad: float = math.radians(5.0)


@dataclass(frozen=True, slots=True)
class KeyframeConfig:
    """When a scan enters the map, and when a new node of the graph begins."""

    distance_m: float = 0.1
    turn_rad: float = math.radians(6.0)
    node_distance_m: float = 1.0
    node_turn_rad: float = math.radians(60.0)


@dataclass(frozen=True, slots=True)
class LoopConfig:
    """Search for places seen before."""

    cell_m: float = 0.1
    levels: int = 5  # coarsest step: 2**levels cells
    min_graph_distance_m: float = 12.0  # nearer ones are joined by tracking
    drift_ratio: float = 0.03  # of the way along the graph: how far the estimate may be off
    drift_fixed_m: float = 0.3
    max_search_m: float = 8.0
    search_turn_rad: float = math.radians(20.0)
    overlap_m: float = 3.0  # nodes this far apart still see the same
    neighbours: int = 3  # nodes on each side that make the place's map
    query_neighbours: int = 1
    query_every: int = 3  # of their scans
    max_query_points: int = 300
    min_query_points: int = 30
    max_candidates: int = 2  # per new node
    min_score: float = 0.55  # mean likelihood of branch and bound
    min_inlier_share: float = 0.7
    max_partial_search_m: float = 1.5  # so near a place is also known from another side, of which little is in its map:
    min_partial_score: float = 0.35
    min_partial_share: float = 0.35
    max_through_share: float = 0.12  # in space that was seen free, of the points that the place says something of
    min_held_share: float = 0.06  # of all points, that hold the weaker direction; none of 52 on six logs was wrong
    witness_held_share: float = 0.04  # with so many it only counts beside one of the next nodes that says the same
    sure_held_share: float = 0.08  # with so many it needs no second closure either, where the estimate agrees
    through_margin_m: float = 0.15
    through_margin_ratio: float = 0.02
    view_every: int = 3  # of a place's scans, those that tell which space is free
    max_refinement_m: float = 0.5  # what least squares may still move after the search
    better_share: float = 0.15  # by which a place that was searched for has to fit better than the estimate does
    max_branches: int = 20_000
    cached_places: int = 8
    max_place_surfels: int = 20_000
    units_per_step: int = 5_000  # a unit is about 15 ns,
    hurry_nodes: int = 50  # and as many again for each so many nodes that wait to be looked from
    weak_share: float = 0.05  # a direction that so few of the points hold is hardly known
    closure_length_m: float = 0.5  # the way that the drift over a closure is worth
    agreement_m: float = 0.3  # of two far closures that confirm each other
    agreement_rad: float = math.radians(3.0)
    agreement_nodes: int = 15  # they are no farther apart than this


@dataclass(frozen=True, slots=True)
class PoseGraphConfig:
    """Optimisation of the nodes."""

    shift_sigma_m: float = 0.01  # of an edge, on top of what its match says
    turn_sigma_rad: float = math.radians(0.15)
    misfit_ratio: float = 10.0  # wider by so much for each share of points that did not fit on its way: there it drifts
    lost_shift_sigma_m: float = 0.3
    lost_turn_sigma_rad: float = math.radians(10.0)
    unknown_shift_sigma_m: float = 1e3  # of an edge to a piece that may be anywhere
    unknown_turn_sigma_rad: float = 1e2
    found_shift_sigma_m: float = 0.03  # of an edge to a place where a lost robot was found
    found_turn_sigma_rad: float = math.radians(1.0)
    switch_chi2: float = 12.0  # a closure whose error is above this loses weight (dynamic covariance scaling);
    switch_shrink: float = 0.2  # at first the worst new one keeps it, then by this factor fewer do each time
    iterations: int = 12
    blocks_per_step: int = 10_000  # products of 3 × 3 blocks, or as much work: about 0.2 ms
    optimise_chi2: float = 4.0  # a closure that the graph agrees with better is not worth an optimisation now
    optimise_nodes: int = 8  # small corrections wait until this many nodes have come
    moved_m: float = 0.005  # poses that move less are not a new revision


@dataclass(frozen=True, slots=True)
class GridConfig:
    """The occupancy grid that is shown and planned in."""

    cell_m: float = 0.02  # doubled as often as the map outgrows `max_cells`
    max_cells: int = 16_000_000
    coarsest_cell_m: float = 0.16
    max_range_m: float = 50.0
    hit_log_odds: float = 0.85
    miss_log_odds: float = -0.2
    limit_log_odds: float = 6.0
    thin_share: float = 0.5  # a cell with fewer hits than this share of a near cell's is the noise of that one
    thin_reach_cells: int = 2
    moved_cells: float = 0.25  # a scan whose pose changed more is drawn again

    def __post_init__(self) -> None:
        if not 0.001 <= self.cell_m <= self.coarsest_cell_m or self.max_cells < 1:
            raise ValueError("cell_m must be from 0.001 to coarsest_cell_m, and max_cells positive")


@dataclass(frozen=True, slots=True)
class GraphSlamConfig:
    normals: NormalConfig = field(default_factory=NormalConfig)
    local_map: LocalMapConfig = field(default_factory=LocalMapConfig)
    match: MatchConfig = field(default_factory=MatchConfig)
    new_ground: NewGroundConfig = field(default_factory=NewGroundConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    keyframes: KeyframeConfig = field(default_factory=KeyframeConfig)
    loops: LoopConfig = field(default_factory=LoopConfig)
    pose_graph: PoseGraphConfig = field(default_factory=PoseGraphConfig)
    grid: GridConfig = field(default_factory=GridConfig)
