"""Whether a scan can have been made where the robot is followed: a quick look, before the map is searched."""

from __future__ import annotations

from collections.abc import Generator, Sequence

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.graph.sight.sight import Horizon, View, seen_through_share
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.localisation.config import DoubtConfig
from station_gui.mapping.slam2d.share import Share, result_at_once

FloatArray = NDArray[np.float64]

_UNITS_PER_VIEW = 1000  # of asking, besides what is asked


class Contradiction:
    """Scans that look through each other's points were made in different places, or things have moved."""

    def __init__(self, config: DoubtConfig, keyframes: Sequence[Keyframe], poses: FloatArray) -> None:
        """`poses`: (K, 3) of the keyframes of the map, map frame."""
        self._config = config
        self._keyframes = keyframes
        self._poses = poses
        self._usual: FloatArray | None = None

    def found_by(self, scan: Keyframe, pose: FloatArray) -> bool:
        """See `look`; without a pause."""
        return result_at_once(lambda share: self.look(scan, pose, share))

    def look(self, scan: Keyframe, pose: FloatArray, share: Share) -> Generator[None, None, bool]:
        """Whether there is more of it than is usual here; `pose`: (3,), where the robot is followed."""
        limit = self._config.impossible
        impossible = yield from self._impossible(scan, pose, len(self._poses), share)
        if (impossible <= limit).all():
            return False
        if self._usual is None:
            self._usual = yield from self._usual_near(pose, share)
        return bool((impossible > self._usual + limit).any())

    def _usual_near(self, pose: FloatArray, share: Share) -> Generator[None, None, FloatArray]:
        """(2,): what the newest scans in the map near to there say of those before them."""
        newest = self._near(pose, len(self._poses))[-self._config.usual_keyframes :]
        usual = np.zeros(2)
        for k in newest.tolist():
            usual += yield from self._impossible(self._keyframes[k], self._poses[k], k, share)
        return usual / max(len(newest), 1)

    def _near(self, pose: FloatArray, before: int) -> NDArray[np.int64]:
        """Of the first `before` keyframes."""
        away_m = np.hypot(*(self._poses[:before, :2] - pose[:2]).T)
        return np.flatnonzero(away_m <= max(self._config.view_m, float(away_m.min(initial=np.inf))))

    def _impossible(
        self, scan: Keyframe, pose: FloatArray, before: int, share: Share
    ) -> Generator[None, None, FloatArray]:
        """(2,): the share of the scan's points that the map has looked through, and of the map's that the scan has."""
        near = self._near(pose, before)
        near = near[:: max(1, -(-len(near) // self._config.views))]
        views = [View(self._poses[k], Horizon(self._keyframes[k])) for k in near.tolist()]
        here = View(pose, Horizon(scan))
        of_scan = yield from self._looked_through(here, views, share)
        of_map = []
        for view in views:
            if len(view.keyframe.points_m):
                of_map.append((yield from self._looked_through(view, [here], share)))
                share.take(_UNITS_PER_VIEW)
        return np.array([of_scan, float(np.mean(of_map)) if of_map else 0.0])

    def _looked_through(self, points: View, views: Sequence[View], share: Share) -> Generator[None, None, float]:
        config = self._config
        stride = max(1, -(-len(points.keyframe.points_m) // config.view_points))
        points_m = points.keyframe.points_m[::stride].astype(np.float64)
        return seen_through_share(
            points_m, points.in_place, views, config.view_margin_m, config.view_margin_ratio, share
        )
