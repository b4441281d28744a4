"""What the mapping pipeline asks of a 2D SLAM method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.snapshot import GridMap, Tracking

if TYPE_CHECKING:
    from station_gui.mapping.saved_map import SavedMap


Admits = Callable[[float, float], bool]  # fit and surprise of a scan: whether it may enter the map


class MappingError(Exception):
    """Mapping cannot use what it was given; the last map stays."""


def admit_all(fit: float, surprise: float) -> bool:
    """Where nobody is in doubt."""
    return True


class Slam(Protocol):
    def add(self, scan: PointScan) -> Pose2:
        """Take the next scan; returns `map_from_robot` at its stamp. Scans come in the order they were made."""
        ...

    def finish(self) -> None:
        """No more scans come: do whatever improves the map and was put off."""
        ...

    def pose_of_scan(self, index: int) -> Pose2:
        """The pose of the index-th scan that was added, as it is believed now."""
        ...

    @property
    def revision(self) -> int:
        """Grows whenever poses that were given out have changed (a loop closure)."""
        ...

    def trajectory(self) -> NDArray[np.float64]:
        """(K, 4): stamp_s, x_m, y_m, theta_rad of every keyframe as it is believed now, map frame."""
        ...

    def closures(self) -> NDArray[np.int32]:
        """(L, 2): pairs of indices into `trajectory()` that a loop closure joined."""
        ...

    def grid(self) -> GridMap:
        """The occupancy grid as it is believed now."""
        ...


class StoredSlam(Slam, Protocol):
    """A method that can begin with a stored map, be told where the robot is, and says when it no longer fits."""

    def load(self, saved: SavedMap) -> None:
        """Begin with this map; the next scan has to come by `resume`."""
        ...

    def saved(self) -> SavedMap:
        """The map as it is believed now."""
        ...

    def resume(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        """As `add`, for a robot that somebody else has found to be at this place of the map."""
        ...

    def begin_piece(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        """As `resume`, for a robot whose place is not known: what comes now is a piece of map that is apart.

        `map_from_robot`: where the piece is drawn until it has been joined.
        """
        ...

    def join(self, scan: PointScan, map_from_robot: Pose2) -> Pose2:
        """As `resume`, where the robot is in a piece that is apart.

        A method that can moves the piece to where it belongs.
        """
        ...

    @property
    def apart(self) -> bool:
        """The robot is in a piece of map that has not been joined to the rest."""
        ...

    def keyframe_pieces(self) -> NDArray[np.int32]:
        """(K,): which piece each keyframe is in; 0 for the map itself."""
        ...

    @property
    def lost_scans(self) -> int:
        """How many scans in a row have not fitted."""
        ...

    @property
    def fit(self) -> float:
        """Share of the newest scan's points that fitted, 0 where the match was not believed."""
        ...

    @property
    def surprise(self) -> float:
        """How far the newest scan's match was from what odometry says, in standard deviations of that."""
        ...

    def guard(self, admits: Admits) -> None:
        """Ask `admits` from now on; what it turns away is only tracked."""
        ...

    @property
    def keyframes(self) -> Sequence[Keyframe]:
        """In the order of `trajectory()`."""
        ...

    def keyframe_poses(self) -> NDArray[np.float64]:
        """(K, 3): the poses of `trajectory()`, map frame; not to be written to."""
        ...


class SessionSlam(Slam, Protocol):
    """What the pipeline asks: a method that also knows whether it knows where the robot is."""

    def saved(self) -> SavedMap:
        """The map as it is believed now."""
        ...

    @property
    def tracking(self) -> Tracking: ...

    @property
    def places(self) -> int:
        """Of the map that may be where the robot is, while it is searched for."""
        ...

    @property
    def fixed(self) -> bool:
        """The map was given and is not changed."""
        ...
