"""Whether what a match leaves over is new ground, or speaks against it.

A scan that comes round a corner shows much that the map does not know yet, as does one of a robot that was carried off.
They differ in what the newest scans of the map say: they have looked through what is wrong, and it looks through them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import NewGroundConfig
from station_gui.mapping.slam2d.graph.sight.sight import Horizon, View, seen_through_share
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan
from station_gui.mapping.slam2d.share import result_at_once

FloatArray = NDArray[np.float64]


class NewGround:
    """Judges a match by those of its points that the map says something of."""

    def __init__(self, config: NewGroundConfig) -> None:
        self._config = config
        self._horizons: dict[int, Horizon] = {}  # of the newest keyframes, by their number

    def picked(self, keyframes: Sequence[Keyframe]) -> list[Horizon]:
        """Those to ask of a map's keyframes, the newest first; always of the same map."""
        every, count = self._config.every, len(keyframes)
        first = max(-1, count - 1 - every * self._config.views)
        for number in [number for number in self._horizons if number <= first]:
            del self._horizons[number]
        return [self._horizon(number, keyframes) for number in range(count - 1, first, -every)]

    def _horizon(self, number: int, keyframes: Sequence[Keyframe]) -> Horizon:
        if number not in self._horizons:
            self._horizons[number] = Horizon(keyframes[number])
        return self._horizons[number]

    def may_be(self, share: float, surprise: float, points: int) -> bool:
        """Whether there is something to ask; `share` of the `points` fitted, `surprise`: as of `StoredSlam`."""
        config = self._config
        enough = config.least_share <= share < config.enough_share and share * points >= config.min_points
        return enough and surprise <= config.max_sigmas

    def fair_share(self, share: float, here: View, keyframes: Sequence[View]) -> float:
        """`share` of the points that fitted `here`, without new ground; as it is where that is not sure.

        `keyframes`: those picked, in the same frame as `here`.
        """
        config = self._config
        views = [
            view
            for view in keyframes
            if len(view.keyframe.points_m) and np.hypot(*(view.in_place - here.in_place)[:2]) <= config.view_m
        ]
        if not views:
            return share
        of_scan = self._looked_through(here, views)
        of_map = float(np.mean([self._looked_through(view, [here]) for view in views]))
        fair = share / (share + max(of_scan, of_map))
        return fair if fair >= config.sure_share else share

    def _looked_through(self, points: View, views: Sequence[View]) -> float:
        config = self._config
        every = max(1, -(-len(points.keyframe.points_m) // config.view_points))
        points_m = points.keyframe.points_m[::every].astype(np.float64)
        return result_at_once(
            lambda share: seen_through_share(
                points_m, points.in_place, views, config.margin_m, config.margin_ratio, share
            )
        )


def view_of(scan: LineScan, scanner_m: FloatArray, pose: FloatArray) -> View:
    """A scan that is no keyframe yet; `pose`: (3,)."""
    points_m, normals = scan.points_m.astype(np.float32), scan.normals.astype(np.float32)
    return View(pose, Horizon(Keyframe(0.0, 0, np.zeros(3), points_m, normals, scanner_m)))
