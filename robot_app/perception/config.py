"""Parameters of the 3D object extraction; names and defaults follow table 3 of paper 1 where it has them."""

from __future__ import annotations

from dataclasses import dataclass, field


def _require(holds: bool, what: str) -> None:
    if not holds:
        raise ValueError(what)


@dataclass(frozen=True, slots=True)
class EdgeConfig:
    """Which points are edges (step 1, eqs 7-11)."""

    # Every 4th pixel: 8,600 to 14,100 points of a 640 x 480 image, as in table 4; edges are then found to the pixel.
    stride_px: int = 4
    range_min_m: float = 0.5  # the L515's range
    range_max_m: float = 9.0
    alpha: float = 3.9  # α
    # A step along the near surface of more pixel widths than this is a flying pixel or a surface seen edge-on.
    max_step_widths: float = 8.0
    max_hole_cells: int = 12  # how far to look for the other side of a hole: the shadow beside a near object
    # So many cells without return from the top of the image down are open space and not a cut of the sensor's.
    min_open_cells: int = 4
    depth_noise: float = 0.0015  # standard deviation at 1 m, in metres; grows with the square of the depth
    # Shorter lines on the floor are left out: what is so small is told by its outline, and they join what stands close.
    min_contact_m: float = 0.2
    crease_angle_rad: float = 0.70  # two flat surfaces that meet at a sharper angle make an edge
    # And so do uprights where a face is narrower than six cells; what is narrow and level is told by its outline.
    narrow_crease_angle_rad: float = 1.2
    min_step_m: float = 0.025  # between two flat surfaces of which one stands before the other
    floor_height_m: float = 0.02  # what is lower than this belongs to the floor,
    floor_slope: float = 0.012  # and this much more for each metre of distance: the car's pitch under its springs
    sample_spacing_m: float = 0.02  # of the sample nodes along an edge
    corner_gain: float = 4.0  # by how much the end of an edge is preferred to its middle as a sample, a corner less
    min_curve_m: float = 0.06  # smaller edges are noise,
    min_curve_cells: float = 6.0  # and so are those of fewer cells of `stride_px`,
    max_roughness: float = 0.42  # and those that bend everywhere: the mean of 1 + cos of the angle at each point
    # Beyond this range, where depth is noisy, curves are noise whose points hang together more loosely than so many
    # cells: too far apart in the image and off in depth; and at any range those that are more loose and ragged than so
    # many and on no smooth surface's rim.
    loose_range_m: float = 2.1
    max_looseness: float = 1.9
    max_raggedness: float = 2.1
    # Where edges cover more of a neighbourhood than this, as in the L515's speckle, a curve may bend so much less.
    crowd_share: float = 0.20
    speckle_share: float = (
        0.25  # and what is near and not smooth there hides nothing: the edge is that of what it meets
    )
    corner_arm_points: int = 5  # how many edge points to either side tell a corner
    # Table 3 is for furniture: smaller things are learned with lengths in proportion to their size, down to a quarter.
    detail_curve_m: float = 0.5
    max_detail: float = 4.0
    full_curve_m: float = 0.8  # edges so large are preferred to smaller ones: outlines to the holes in them
    max_edges: int = 6000  # bounds the time of tracing: the lower part of a frame of noise is left out
    max_samples: int = 1500  # bounds the time of learning

    def __post_init__(self) -> None:
        _require(1 <= self.stride_px <= 32, "stride_px must be 1 to 32")
        _require(0 < self.range_min_m < self.range_max_m, "range_min_m must be positive and below range_max_m")
        _require(self.range_max_m * self.max_detail <= 45.0, "range_max_m times max_detail must not be above 45")
        _require(self.max_edges >= 2, "max_edges must be at least 2")
        _require(self.max_samples >= 2, "max_samples must be at least 2")
        _require(self.max_hole_cells >= 1, "max_hole_cells must be at least 1")


@dataclass(frozen=True, slots=True)
class LearningConfig:
    """Simplified FastGNG (steps 2-7, eqs 12-23)."""

    beta: float = 1.55  # β
    min_length_m: tuple[float, float, float] = (0.225, 0.150, 0.100)  # γ, by phase
    max_length_m: tuple[float, float, float] = (0.300, 0.225, 0.175)  # δ, by phase
    samples_per_node: tuple[float, float, float] = (10.0, 8.0, 6.0)  # σ, by phase
    max_nodes: int = 200  # bounds time and memory; the paper's networks have 145 to 158 before refinement

    def __post_init__(self) -> None:
        _require(2 <= self.max_nodes <= 2000, "max_nodes must be 2 to 2000")
        _require(
            all(0 < low <= high for low, high in zip(self.min_length_m, self.max_length_m, strict=True)),
            "min_length_m must be positive and not above max_length_m",
        )
        _require(min(self.samples_per_node) > 0, "samples_per_node must be positive")


@dataclass(frozen=True, slots=True)
class RefineConfig:
    """Post-processing (sections 3.2.1-3.2.5, eqs 24-33)."""

    ground_reach_m: float = 0.080  # g_x = g_z, horizontal
    ground_rise_m: float = 0.035  # g_y, vertical
    ground_band_m: float = 0.150  # only nodes lower than this can be ground: a table top is no floor
    straight_angle_rad: float = 2.7925  # 160°
    straight_offset_m: float = 0.015  # and a node is only removed when it lies so near the connection that replaces it
    eta_angle_per_deg: float = 0.01  # η1
    eta_distance_per_m: float = -0.95  # η2
    loop_reach_m: float = 0.35  # how far an open end looks for its partner
    min_connection_m: float = 0.1  # γ3; less for curves smaller than `detail_curve_m`
    node_reach_m: float = 0.2  # n_x = n_y = n_z
    node_support_m: float = 0.12  # the length of edge that has to lie within node_reach_m
    connection_reach_m: float = 0.06  # q_x = q_y = q_z
    loop_step_m: float = 0.015  # of the points that are looked at along what would close a loop
    connection_step_m: float = 0.04  # of the points that are looked at along a connection
    follow_cells: float = 2.0  # a stretch of a curve that is farther from all connections is drawn after all
    narrow_cells: float = 4.0  # an outline no wider than this, and four times as long at least, is drawn as a line
    most_nodes: int = 99  # "less than 100" in the paper: what looks smallest is left out

    def __post_init__(self) -> None:
        _require(self.connection_step_m > 0, "connection_step_m must be positive")
        _require(self.connection_reach_m > 0, "connection_reach_m must be positive")
        _require(self.narrow_cells >= 0, "narrow_cells must not be negative")
        _require(self.most_nodes >= 2, "most_nodes must be at least 2")


@dataclass(frozen=True, slots=True)
class TrackingConfig:
    """Which outlines of one frame are those of another."""

    reach_m: float = 0.03  # outlines so near each other are the same; the noise of a node
    reach_per_m: float = 0.02  # and this much for each metre that the object is away: its pixels and its depth's noise
    step_m: float = 0.03  # of the points that are looked at along an outline
    match_share: float = 0.25  # the least mean share of both outlines that lie along each other, for the same object
    keep_share: float = 0.8  # with such a share of both, nothing has changed
    nearer_share: float = 0.75  # what is seen from so much nearer is seen better, and replaces what is known
    patience_frames: int = 5  # so long a part, or an object that was seen as often, may be missing
    forget_frames: int = 50  # and so long its number is kept
    most_nodes: int = 99  # what is remembered must not add to those of a frame (`RefineConfig`)
    max_objects: int = 64  # bounds time and memory

    def __post_init__(self) -> None:
        _require(0 < self.match_share <= self.keep_share <= 1, "match_share must be positive and not above keep_share")
        _require(min(self.reach_m, self.step_m) > 0, "reach_m and step_m must be positive")
        _require(self.patience_frames >= 0, "patience_frames must not be negative")
        _require(self.forget_frames >= self.patience_frames, "forget_frames must not be below patience_frames")
        _require(self.most_nodes >= 2, "most_nodes must be at least 2")
        _require(1 <= self.max_objects <= 1000, "max_objects must be 1 to 1000")


@dataclass(frozen=True, slots=True)
class PerceptionConfig:
    edges: EdgeConfig = field(default_factory=EdgeConfig)
    learning: LearningConfig = field(default_factory=LearningConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
