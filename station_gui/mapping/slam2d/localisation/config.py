"""Parameters of finding the robot in a map: one set for every map.

Where no source is named a value was found on the simulated lab, on rooms that are not the lab, and on Intel and FR079.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from station_gui.mapping.slam2d.config import GraphSlamConfig, LocalMapConfig, LoopConfig


@dataclass(frozen=True, slots=True)
class ReferenceConfig:
    """The map as it is searched."""

    spacing_m: float = 0.25  # of the scans that it is made of: the newest in each square
    spacing_rad: float = math.radians(30.0)  # and turn
    cell_m: float = 0.05  # doubled until the map has no more than
    max_cells: int = 9_000_000
    grid_cell_m: float = 0.05  # of the free space, doubled until that has no more than
    max_grid_cells: int = 4_000_000
    search_cells: int = 100_000  # the same for the likelihood that is searched,
    search_reach_m: float = 8.0  # with points no farther from the robot: others would only ask for finer turns
    reach_m: float = 0.4  # a scan may be this far off and still find its surfel
    max_surfels: int = 2_000_000
    margin_m: float = 1.0  # round the map
    far_m: float = 15.0  # from where the robot was: what is seen beyond is left out
    free_below: float = 0.35  # probability of a cell that is known to be free
    stand_off_m: float = 0.2  # a scanner stands no farther than this from a place that is known to be free
    depth: int = 5  # of the pyramid


@dataclass(frozen=True, slots=True)
class SearchConfig:
    """Branch and bound over the whole map."""

    points: int = 180
    spacing_m: float = 0.1  # of the points, so that what is near does not count more
    min_points: int = 30
    min_score: float = 0.45  # mean likelihood
    behind_best: float = 0.25  # what is farther below the best place is none
    keep_level: int = 3  # one place per square of 2**3 cells and turn
    max_found: int = 4096
    apart_m: float = 0.25  # places nearer to a better one, and turned less, are the same
    apart_rad: float = math.radians(10.0)
    max_places: int = 200  # in a corridor very many look alike until their beams are judged


@dataclass(frozen=True, slots=True)
class VerifyConfig:
    """When a place is believed."""

    points: int = 700
    spacing_m: float = 0.04
    inlier_m: float = 0.06
    margin_m: float = 0.2
    min_cosine: float = 0.4
    free_below: float = 0.35
    min_good_share: float = 0.92  # of the beams that the map can judge
    min_support: float = 0.55  # good less bad ones, of all beams
    uniqueness: float = 0.25  # by which the support of the second place must be less
    keep_support: float = 0.3  # what is below is no hypothesis
    keep_good_share: float = 0.7
    min_points: int = 100  # with fewer, rooms that are not the map fit it by chance
    scan_share: float = 0.75  # of the newest scan's points that fit, each time
    confirmations: int = 3  # scans in a row that say the same


@dataclass(frozen=True, slots=True)
class DoubtConfig:
    """When a robot that is followed may have been carried off."""

    fit_drop: float = 0.06  # a scan that fits so much worse than usual is odd,
    jump_sigmas: float = 10.0  # and one that lies so far from where odometry says
    usual_rate: float = 0.05  # at which the usual fit follows the newest one
    odd_scans: int = 3  # so many begin a doubt,
    calm_scans: int = 3  # so many others in a row end it
    rest_scans: int = 50  # after a doubt that was unfounded
    min_keyframes: int = 10  # in the map
    reach_m: float = 15.0  # nobody carries it farther between two scans
    max_keyframes: int = 400  # evenly chosen
    view_m: float = 3.0  # scans of the map this near to the robot are asked whether it may be there
    views: int = 8
    view_points: int = 90  # of a scan
    view_margin_m: float = 0.15
    view_margin_ratio: float = 0.02  # of the range
    usual_keyframes: int = 3  # that say how many impossible points are usual
    impossible: float = 0.04  # more than is usual
    apart_m: float = 1.0  # a place that is nearer to where the robot is followed,
    apart_rad: float = math.radians(20.0)  # and turned less, is the drift of the map
    rival_share: float = 0.1  # of the beams, that another place has to explain better
    longest_scans: int = 30  # after a search that found nothing better
    longest_m: float = 0.3  # driven, for meanwhile the map does not grow, and new places fit worse,
    turn_m: float = 0.6  # with so much for each radian
    standing_m: float = 0.02  # a robot that has gone no farther stands
    patience_scans: int = 8  # in doubt: a robot that stands on after these,
    units_per_step: int = 30_000
    hasty_units_per_step: int = 60_000  # or has jumped while it stood, gets so many


def small_slam() -> GraphSlamConfig:
    """For a short way: large windows would take long to make."""
    return GraphSlamConfig(local_map=LocalMapConfig(size_m=25.6), loops=LoopConfig(cached_places=1))


@dataclass(frozen=True, slots=True)
class LocalisationConfig:
    reference: ReferenceConfig = field(default_factory=ReferenceConfig)
    search: SearchConfig = field(default_factory=SearchConfig)
    verify: VerifyConfig = field(default_factory=VerifyConfig)
    doubt: DoubtConfig = field(default_factory=DoubtConfig)
    trail: GraphSlamConfig = field(default_factory=small_slam)  # follows the robot while it is lost
    units_per_step: int = 250_000  # a unit is about 15 ns
    trail_m: float = 4.0  # how much of the way so far is looked for
    trail_scans: int = 40
    longest_trail_scans: int = 300  # in the trail: then it is begun anew
    look_again_scans: int = 50  # at one place, in doubt: the robot looks anew
    search_again_m: float = 0.4  # driven, after a search that has found nothing to believe
    lost_scans: int = 8  # in a row that do not fit: the robot is lost
    give_up_m: float = 4.0  # driven where no place of the map fits: a new piece begins, in a map that may grow
    beside_m: float = 10.0  # it lies so far from the map, and as far again as the robot sees, up to the same
