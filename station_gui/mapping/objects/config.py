"""Parameters of the 2D–3D combination."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class CameraView:
    """What the robot's depth camera can see; must agree with `robot.toml`."""

    x_m: float = 0.28
    z_m: float = 0.17
    pitch_down_rad: float = 0.0
    horizontal_rad: float = math.radians(70.0)  # L515
    vertical_rad: float = math.radians(50.0)
    near_m: float = 0.6  # the L515 sees from 0.5 m on; an edge needs some surface round it
    far_m: float = 3.0  # farther edges are often missed, which says nothing
    scanner_z_m: float = 0.09
    rim: float = 0.90  # of the half image: an edge that ends outside may go on

    def __post_init__(self) -> None:
        if not 0 < self.near_m < self.far_m:
            raise ValueError("near_m must be positive and below far_m")
        if not (0 < self.horizontal_rad < math.pi and 0 < self.vertical_rad < math.pi):
            raise ValueError("horizontal_rad and vertical_rad must be between 0 and π")

    def as_array(self) -> NDArray[np.float64]:
        """(8,): as the kernels want it."""
        tangents = math.tan(self.horizontal_rad / 2), math.tan(self.vertical_rad / 2)
        return np.array([self.x_m, self.z_m, self.pitch_down_rad, *tangents, self.near_m, self.far_m, self.rim])


@dataclass(frozen=True, slots=True)
class FusionConfig:
    """Which edges are the same, and how sure one is of them."""

    upright_rad: float = math.radians(70.0)  # steeper is an upright edge,
    level_rad: float = math.radians(20.0)  # flatter a level one; what lies between is a chord over a corner
    shortest_m: float = 0.04
    reach_m: float = 0.025  # across: farther apart is another edge; those of a table's leg are 4 cm from one another
    rise_m: float = 0.05  # level edges that differ more in height are two
    gap_m: float = 0.12  # along: over a longer gap an edge is not continued
    turn_rad: float = math.radians(15.0)
    longest_m: float = 2.5  # a longer level edge is kept in pieces
    views: int = 40  # of an edge that are kept, the best; bounds time and memory
    # Of the upright edges seen in a simulated flat 1 % of those nearer than 2 m, 4 % at 2 to 2.5 m and 20 % of the
    # farther ones are no corner of anything: there the camera's measurement ends, in the middle of a surface. Of the
    # level ones on three maps 21 % had nothing true within 4 cm, but 70 % of those only seen from farther than 2.5 m;
    # after 15 such views it was 37 %, as after three from near.
    # Upright ones seen from farther are kept, for only they reach high, and wait until they are seen from near.
    sure_m: float = 2.5  # of depth: farther upright edges are no evidence,
    far_level: float = 0.4  # and farther level ones count for so much of a view
    noise_m: float = 0.008  # of an edge seen from near: pose and extraction …
    noise_per_m: float = 0.004  # … and for each metre of distance
    hit_log_odds: float = 0.6  # seen …
    miss_log_odds: float = -0.15  # … not seen though it was in view: the extraction leaves out many edges of a view
    through_log_odds: float = -0.8  # the scanner looked through it
    most_log_odds: float = 4.0  # so that what moved away goes in the end
    shown_log_odds: float = 0.8  # an edge is shown from here on …
    shown_views: int = 3  # … when it was seen from so many places
    least_log_odds: float = -1.5  # below, it is forgotten
    most_edges: int = 6000  # bounds time and memory: in a full map nothing new is taken

    def __post_init__(self) -> None:
        if not 0 <= self.level_rad < self.upright_rad <= math.pi / 2:
            raise ValueError("level_rad must be below upright_rad, both from 0 to π/2")
        if not (1 <= self.views <= 200 and 1 <= self.most_edges <= 100_000):
            raise ValueError("views must be 1 to 200 and most_edges 1 to 100000")


@dataclass(frozen=True, slots=True)
class ReferenceConfig:
    """Steps 2 to 5; the paper's values are those of table 5."""

    turn_rad: float = math.radians(10.0)  # θTh
    reach_m: float = 0.10  # dEps of step 2
    line_reach_m: float = 0.15  # dEps of step 4
    min_objects: int = 2  # minObj
    iterations_per_node: float = 1.5  # maxIteration = 1.5 n,
    most_iterations: int = 600  # but no more; bounds time
    inlier_m: float = 0.10  # inliersTh
    # Fronts that stand a few centimetres behind one another are two: an offset counts so many times as much as a gap.
    offset_weight: float = 2.0  # in step 2
    line_offset_weight: float = 5.0  # in step 4
    node_reach_m: float = 0.06  # occupied cells so near belong to a cluster
    min_nodes: int = 4
    lines_a_cluster: int = 8  # fronts that stand close behind one another
    same_m: float = 0.03  # in step 4: cells so near a line are its own
    most_m: float = 0.03  # a line farther away is of another surface
    # In step 5: of the line's place against the edge's own. On nine maps 0.3 to 0.5 gave errors 5 to 20 % below those
    # of 1, which is the paper's, and below those of 0.
    line_weight: float = 0.5


@dataclass(frozen=True, slots=True)
class SurfaceConfig:
    """What is drawn between the edges."""

    join_m: float = 0.06  # an edge's end so near another one meets it
    floor_m: float = 0.08  # what begins lower stands on the floor
    over_cell_m: float = 0.03  # an edge so near over an occupied cell goes on down to the floor
    longest_chord_m: float = 0.45  # a longer edge between two walls is one
    wall_height_m: float = 0.5  # of what only the 2D map knows
    tile_m: float = 1.0  # of the 2D map: what has not changed is not looked at again
    large_extent_m: float = 1.0  # from here on an object counts as a wall or a large object …
    large_height_m: float = 0.7  # … or from this height on


@dataclass(frozen=True, slots=True)
class CombineConfig:
    # Of the paper's five, to see what each is good for. Without 2, every network is shown as it came.
    steps: tuple[int, ...] = (1, 2, 3, 4, 5)
    # What was measured anew is taken at once. What only repeats the last networks
    keep_every_m: float = 0.05  # is taken when the robot has moved so far …
    keep_every_rad: float = 0.09  # … or turned so much since the last one …
    look_every_s: float = 1.0  # … and what stands still is looked at so often
    most_networks: int = 4000  # of step 1 alone; the oldest give way
    edges_at_once: int = 16  # placed again with each observation after a closure
    seed: int = 1  # of RANSAC's draws
    camera: CameraView = field(default_factory=CameraView)
    fusion: FusionConfig = field(default_factory=FusionConfig)
    reference: ReferenceConfig = field(default_factory=ReferenceConfig)
    surface: SurfaceConfig = field(default_factory=SurfaceConfig)

    def __post_init__(self) -> None:
        needs = {1: (), 2: (1,), 3: (1, 2), 4: (1, 2, 3), 5: (1, 2, 3)}
        for step in (1, *self.steps):
            if step not in needs or not set(needs[step]) <= set(self.steps) | {1} or 1 not in self.steps:
                raise ValueError("steps must be 1 and some of 2, 3, 4, 5; 3 needs 2, and 4 and 5 need 3")
