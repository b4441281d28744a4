"""Scans that wait outside the map until it is clear whether the robot is where it is followed."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.config import KeyframeConfig
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan
from station_gui.mapping.slam2d.se2_arrays import between

_MOST = 32  # a doubt does not last longer than some decimetres
_DENSER = 0.5  # than keyframes: not all that are held will enter


@dataclass(frozen=True, slots=True, eq=False)
class HeldScan:
    """`in_node`: (3,), where it was tracked; `fit`: as of `StoredSlam`."""

    scan: PointScan
    lines: LineScan
    in_node: NDArray[np.float64]
    fit: float


class HeldScans:
    """Of one node, in the order they came."""

    def __init__(self, config: KeyframeConfig) -> None:
        self._config = config
        self._held: deque[HeldScan] = deque(maxlen=_MOST)

    def hold(self, held: HeldScan) -> None:
        """Unless it is where the last one was."""
        if not self._held or is_apart(self._config, self._held[-1].in_node, held.in_node, _DENSER):
            self._held.append(held)

    def release(self) -> list[HeldScan]:
        """All of them; none is left."""
        held = list(self._held)
        self._held.clear()
        return held


def is_apart(
    config: KeyframeConfig, first: NDArray[np.float64], second: NDArray[np.float64], ratio: float = 1.0
) -> bool:
    """Whether two scans, (3,) each in the frame of one node, are so far apart, times `ratio`, that both are of use."""
    step = between(first, second)
    return bool(np.hypot(step[0], step[1]) >= ratio * config.distance_m or abs(step[2]) >= ratio * config.turn_rad)
