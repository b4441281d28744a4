"""How much of what one visit to a place saw stands where another visit saw that nothing is.

What a scanner of short reach sees of a place depends on the side it comes from: most of it may be new to the place's
map, which says nothing against the place. What stands in space that the map has seen free does.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.graph.sight import _kernels
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.share import Share

FloatArray = NDArray[np.float64]

_SECTORS = 360
_UNITS_PER_POINT = 3  # an arc tangent and a root


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A scan of a place. `in_place`: (3,), the robot's pose."""

    in_place: FloatArray
    keyframe: Keyframe


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
    nearest_m = np.zeros(_SECTORS)
    for view in views:
        if share.left <= 0:
            yield
        keyframe = view.keyframe
        _kernels.mark_seen_through(
            points_m, place_from_query, keyframe.points_m, view.in_place, keyframe.scanner_m, nearest_m, margin_m,
            margin_ratio, through,
        )  # fmt: skip
        share.take(_SECTORS // 10 + _UNITS_PER_POINT * (len(points_m) + len(keyframe.points_m)))
    return float(through.mean()) if len(through) else 0.0
