"""What the robot has done since the newest node of the graph began."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import KeyframeConfig


class NodeWay:
    """Way, turn and misfit of the scans of one node."""

    def __init__(self, config: KeyframeConfig) -> None:
        self._config = config
        self.begin()

    def begin(self) -> None:
        """A new node."""
        self.way_m = 0.0
        self._turn_rad = 0.0
        self._misfit = 0.0  # of its scans, the shares of points that did not fit
        self._scans = 0

    def count(self, step: NDArray[np.float64], share: float) -> float:
        """A scan later, `step` (3,) on, `share` of whose points fitted: how far that was, m."""
        way_m = float(np.hypot(step[0], step[1]))
        self.way_m += way_m
        self._turn_rad += abs(float(step[2]))
        self._misfit += 1.0 - share
        self._scans += 1
        return way_m

    @property
    def full(self) -> bool:
        """Another node is due."""
        return self.way_m >= self._config.node_distance_m or self._turn_rad >= self._config.node_turn_rad

    def looseness(self, misfit_ratio: float) -> float:
        """By how much wider the edge to the next node is than one of scans that fit; see `PoseGraphConfig`."""
        return 1.0 + misfit_ratio * self._misfit / max(self._scans, 1)
