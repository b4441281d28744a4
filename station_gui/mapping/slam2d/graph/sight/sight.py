"""How much of what one visit to a place saw stands where another visit saw that nothing is.

What a scanner of short reach sees of a place depends on the side it comes from: most of it may be new to the place's
map, which says nothing against the place. What stands in space that the map has seen free does.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.graph.sight import _kernels
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.share import Share

FloatArray = NDArray[np.float64]

_SECTORS = 360
_UNITS_PER_POINT = 4  # an arc tangent and a root


@dataclass(slots=True, eq=False)
class Horizon:
    """How far a scan saw in each direction; made when it is first asked for, which takes as long as the rest."""

    keyframe: Keyframe
    _nearest_m: FloatArray | None = field(default=None, init=False)

    def nearest_m(self, share: Share) -> FloatArray:
        """(360,): from the scanner to the nearest point in each sector of the robot frame, 0 where there is none."""
        if self._nearest_m is None:
            self._nearest_m = np.zeros(_SECTORS)
            _kernels.fill_sectors(self.keyframe.points_m, self.keyframe.scanner_m, self._nearest_m)
            share.take(_SECTORS // 10 + _UNITS_PER_POINT * len(self.keyframe.points_m))
        return self._nearest_m


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A scan of a place. `in_place`: (3,), the robot's pose."""

    in_place: FloatArray
    horizon: Horizon

    @property
    def keyframe(self) -> Keyframe:
        return self.horizon.keyframe


def seen_through_share(
    points_m: FloatArray,
    place_from_query: FloatArray,
    views: Sequence[View],
    margin_m: float,
    margin_ratio: float,
    share: Share,
) -> Generator[None, None, float]:
    """Of `points_m`, (N, 2) in the query's frame: those that at least one view has looked through.

    A point counts when the view saw farther than it by `margin_m` and `margin_ratio` of its range.
    """
    through = np.zeros(len(points_m), np.bool_)
    for view in views:
        if share.left <= 0:
            yield
        _kernels.mark_seen_through(
            points_m, place_from_query, view.in_place, view.keyframe.scanner_m, view.horizon.nearest_m(share), margin_m,
            margin_ratio, through,
        )  # fmt: skip
        share.take(_UNITS_PER_POINT * len(points_m))
    return float(through.mean()) if len(through) else 0.0
