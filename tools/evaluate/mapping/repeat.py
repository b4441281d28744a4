"""How alike the maps of several trials are, all in the room's frame."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tools.evaluate.mapping.score import sampled

FloatArray = NDArray[np.float64]

_STEP_M = 0.01
_SAME_M = 0.10  # what is farther from everything in the other map is not there


@dataclass(frozen=True, slots=True)
class Repeatability:
    """Over all pairs of trials. Not a number where there are no two maps.

    `repeatability_m`: RMS distance from every centimetre of the edges of one 3D map to the other, of what is in both;
    `only_in_one`: the share of the edges with nothing of the other map within 10 cm. `grid_repeatability_m`: RMS
    distance of all occupied cells, without exception.
    """

    repeatability_m: float
    only_in_one: float
    grid_repeatability_m: float


def repeatability(edges_m: Sequence[NDArray[np.floating]], cells_m: list[FloatArray]) -> Repeatability:
    """`edges_m`: (S, 2, 3) of each trial; `cells_m`: (N, 2) of each trial."""
    edges = _distances([sampled(segments_m, _STEP_M)[0] for segments_m in edges_m])
    cells = _distances(cells_m)
    same = edges[edges <= _SAME_M]
    return Repeatability(_rms(same), 1 - len(same) / len(edges) if len(edges) else math.nan, _rms(cells))


def _distances(clouds_m: list[FloatArray]) -> FloatArray:
    """From every point of each cloud to the nearest of each other one."""
    filled = [cloud_m for cloud_m in clouds_m if len(cloud_m)]
    trees = [cKDTree(cloud_m) for cloud_m in filled]
    pairs = itertools.permutations(range(len(filled)), 2)
    return np.concatenate([trees[b].query(filled[a])[0] for a, b in pairs] or [np.zeros(0)])


def _rms(values: FloatArray) -> float:
    return math.sqrt(float(np.mean(np.square(values)))) if len(values) else math.nan
