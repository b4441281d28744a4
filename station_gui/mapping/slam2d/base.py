"""What the mapping pipeline asks of a 2D SLAM method."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan
from station_gui.mapping.snapshot import GridMap


class MappingError(Exception):
    """Mapping cannot use what it was given; the last map stays."""


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
