"""A place seen again: where it may be, and what was found."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import LoopConfig
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """Node `new` lies at `measured`, (3,), in the frame of node `old`; `information` (3, 3) in that frame.

    `searched`: the estimate was not good enough to start from, so that the place itself may be mistaken.
    `partial`: much of what the new node saw is not known from the old one, and the rest does not hold it firmly.
    `witness`: so little firmly that it may only confirm another one.
    """

    old: int
    new: int
    measured: FloatArray
    information: FloatArray
    searched: bool
    partial: bool = False
    witness: bool = False


@dataclass(frozen=True, slots=True)
class Candidate:
    """A pair worth a search, and how far round the estimate; 0: the estimate is good, it only wants refining."""

    old: int
    new: int
    shift_m: float


def choose(
    config: LoopConfig, new: int, near: NDArray[np.integer], way_m: FloatArray, away_m: FloatArray
) -> list[Candidate]:
    """Those of the nodes `near` (N,) that `new` may see, nearest first, none next to another.

    `way_m`, `away_m`: (N,), how far each is along the graph and straight.
    """
    shift_m = np.minimum(config.drift_fixed_m + config.drift_ratio * way_m, config.max_search_m)
    far = way_m > config.min_graph_distance_m
    worth = (away_m < config.overlap_m + 0.5 * shift_m) & (far | (away_m <= 0.5 * config.overlap_m))
    chosen: list[Candidate] = []
    for k in np.flatnonzero(worth)[np.argsort(away_m[worth], kind="stable")].tolist():
        if len(chosen) == config.max_candidates:
            break
        old = int(near[k])
        if all(abs(old - other.old) > 2 * config.neighbours for other in chosen):
            chosen.append(Candidate(old, new, float(shift_m[k]) if far[k] else 0.0))
    return chosen


def joined(scans: Iterable[tuple[Keyframe, FloatArray]]) -> LineScan:
    """Scans and their poses, (3,), in a common frame as one scan in that frame."""
    points, normals = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for keyframe, (x, y, theta) in scans:
        c, s = math.cos(theta), math.sin(theta)
        turn = np.array([[c, s], [-s, c]])
        points.append(keyframe.points_m @ turn + (x, y))
        normals.append(keyframe.normals @ turn)
    return LineScan(np.ascontiguousarray(np.vstack(points)), np.ascontiguousarray(np.vstack(normals)))
