"""What a lost robot has seen lately, as one cloud in the frame of its trail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.slam2d.keyframes import Keyframe

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Query:
    """`points_m`, `normals`, `scanners_m`: (N, 2), trail frame. `at`: (3,), the newest scanner, headed as the robot."""

    points_m: FloatArray
    normals: FloatArray
    scanners_m: FloatArray
    at: FloatArray


def recent(trajectory: FloatArray, way_m: float, scans: int) -> int:
    """The first of the keyframes, `trajectory` (K, 4) as of `Slam`, that the last `way_m` and `scans` hold."""
    steps = np.hypot(*np.diff(trajectory[:, 1:3], axis=0).T)
    way_to_end = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
    return max(int(np.argmax(way_to_end <= way_m)), len(trajectory) - scans, 0)


def gather(keyframes: Sequence[Keyframe], poses: FloatArray, spacing_m: float, limit: int) -> Query:
    """The newest points first, one per square of `spacing_m`, then every n-th so that no more than `limit` are left.

    `poses`: (K, 3), trail frame.
    """
    points, normals, scanners = [], [], []
    for keyframe, pose in zip(reversed(keyframes), poses[::-1], strict=True):
        place = Pose2.from_array(pose)
        points.append(place.apply(keyframe.points_m))
        normals.append(Pose2(0.0, 0.0, place.theta_rad).apply(keyframe.normals))
        scanners.append(np.repeat(place.apply(keyframe.scanner_m[None]), len(keyframe.points_m), axis=0))
    kept = thinned(np.vstack(points), spacing_m, limit)
    at = np.array([*scanners[0][0], poses[-1, 2]]) if len(scanners[0]) else poses[-1].copy()
    return Query(
        points_m=np.ascontiguousarray(np.vstack(points)[kept]),
        normals=np.ascontiguousarray(np.vstack(normals)[kept]),
        scanners_m=np.ascontiguousarray(np.vstack(scanners)[kept]),
        at=at,
    )


def thinned(points_m: FloatArray, spacing_m: float, limit: int) -> NDArray[np.int64]:
    """Indices of the first point of each square, and of these every n-th."""
    cells = np.floor(points_m / spacing_m).astype(np.int64)
    first = np.sort(np.unique(cells, axis=0, return_index=True)[1])
    return np.asarray(first[:: max(1, -(-len(first) // limit))])
