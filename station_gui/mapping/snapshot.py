"""What the mapping hands to everybody else: immutable, complete, made at one moment."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2

OCCUPIED_PROBABILITY = 0.750  # paper 1, section 3.3, step 3


@dataclass(frozen=True, slots=True, eq=False)
class GridMap:
    """An occupancy grid: `probability` (rows, columns) float32, 0 free to 1 occupied, 0.5 where nothing is known.

    Row 0 is the lowest y. `origin_m` is the map position of the lower left corner of cell (0, 0).
    """

    probability: NDArray[np.float32]
    origin_m: tuple[float, float]
    cell_m: float

    def occupied_m(self) -> NDArray[np.float64]:
        """(N, 2): the centres of all occupied cells, map frame (the 2D map reference of paper 1, step 3)."""
        rows, columns = np.nonzero(self.probability > OCCUPIED_PROBABILITY)
        return np.column_stack(
            (self.origin_m[0] + (columns + 0.5) * self.cell_m, self.origin_m[1] + (rows + 0.5) * self.cell_m)
        )


class ObjectKind(IntEnum):
    LARGE = 0  # walls and large objects: red in the paper
    SMALL = 1  # blue
    FLAT = 2  # known from the 2D map alone, its height is assumed: panels only


@dataclass(frozen=True, slots=True, eq=False)
class Panels:
    """Flat pieces of surface: `corners_m` (P, 4, 3) float32, map frame, in order round each piece.

    `kind`: (P,) uint8, of `ObjectKind`. `cluster`: (P,) int32, the object that each belongs to, -1 for `FLAT` ones.
    """

    corners_m: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 4, 3), np.float32))
    kind: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    cluster: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))

    def triangles_m(self) -> NDArray[np.float32]:
        """(2 P, 3, 3): two for each piece, one after the other."""
        return np.ascontiguousarray(self.corners_m[:, [0, 1, 2, 0, 2, 3]]).reshape(-1, 3, 3)


@dataclass(frozen=True, slots=True, eq=False)
class ObjectMap:
    """The 3D objects, placed: their edges, each once, and their surfaces as far as they are known.

    `segments_m`: (S, 2, 3) float32, map frame. `kind`: (S,) uint8, of `ObjectKind`, never `FLAT`. `cluster`: (S,)
    int32, the object that each belongs to, counted from 0.
    """

    segments_m: NDArray[np.float32]
    kind: NDArray[np.uint8]
    cluster: NDArray[np.int32]
    panels: Panels = field(default_factory=Panels)


NO_OBJECTS = ObjectMap(np.zeros((0, 2, 3), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.int32))


class Tracking(IntEnum):
    """Whether the robot's place in the map is known."""

    LOCATED = 0
    SEARCHING = 1  # it is looked for, and some places may be where it is
    LOST = 2  # it is looked for, and no place of the map fits so far
    APART = 3  # in a piece of map that has not been joined to the rest


KNOWN_PLACE = frozenset({Tracking.LOCATED, Tracking.APART})


@dataclass(frozen=True, slots=True, eq=False)
class MapSnapshot:
    """The state of the map after one observation.

    `trajectory`: (K, 4) float64, stamp_s, x_m, y_m, theta_rad of every keyframe, map frame, after optimisation. Stamps
    are those of the robot's clock; in a map of several sessions later ones are moved to follow those before.
    `closures`: (L, 2) int32, indices into `trajectory`.
    """

    revision: int  # grows with every observation that entered a map
    stamp_s: float  # of the newest observation in it, robot clock
    map_from_robot: Pose2
    map_from_odom: Pose2
    grid: GridMap
    objects: ObjectMap
    trajectory: NDArray[np.float64]
    closures: NDArray[np.int32]
    observations: int
    slam_s: float  # how long the newest observation took
    combine_s: float
    tracking: Tracking = Tracking.LOCATED
    places: int = 0  # of the map that may be where the robot is, while it is searched for
    fixed: bool = False  # the map was given and is not changed

    @property
    def located(self) -> bool:
        """Whether `map_from_robot` is to be believed, in the whole map or in its newest piece."""
        return self.tracking in KNOWN_PLACE
