"""Search of a whole neighbourhood for the pose of best likelihood (Hess et al. 2016, algorithm 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.search import _kernels


@dataclass(frozen=True, slots=True, eq=False)
class Pyramid:
    """`levels`: (L + 1, H, W) uint8; cell (r, c) of level h is the maximum over 2**h × 2**h cells from (r, c) on."""

    levels: NDArray[np.uint8]
    origin_m: tuple[float, float]
    cell_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """`pose`: (3,); `score`: mean likelihood in [0, 1]."""

    pose: NDArray[np.float64]
    score: float


def build_pyramid(likelihood: NDArray[np.uint8], origin_m: tuple[float, float], cell_m: float, depth: int) -> Pyramid:
    levels = np.zeros((depth + 1, *likelihood.shape), np.uint8)
    levels[0] = likelihood
    _kernels.fill_pyramid(levels)
    return Pyramid(levels, origin_m, cell_m)


def search(
    points_m: NDArray[np.float64],
    pyramid: Pyramid,
    centre: NDArray[np.float64],
    shift_m: float,
    turn_rad: float,
    min_score: float,
    max_branches: int,
) -> Found | None:
    """The best pose within the window, or None where none reaches `min_score` within `max_branches`.

    `points_m`: (N, 2), robot frame. The angular step moves the farthest point by one cell (eq. 7).
    """
    if len(points_m) == 0:
        return None
    farthest_m = max(float(np.sqrt(np.max(np.sum(points_m**2, axis=1)))), 4 * pyramid.cell_m)
    step_rad = 2 * math.asin(min(1.0, pyramid.cell_m / (2 * farthest_m)))
    turns = math.ceil(turn_rad / step_rad)
    best = np.zeros(3)
    score = _kernels.branch_and_bound(
        points_m,
        pyramid.levels,
        pyramid.origin_m[0],
        pyramid.origin_m[1],
        pyramid.cell_m,
        centre,
        math.ceil(shift_m / pyramid.cell_m),
        turns,
        step_rad,
        min_score,
        max_branches,
        best,
    )
    return None if score < 0 else Found(best, score)
