"""Search of a whole neighbourhood for the pose of best likelihood (Hess et al. 2016, algorithm 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.search import _kernels
from station_gui.mapping.slam2d.share import Share, Task, at_once

_ROWS_AT_ONCE = 32
_CELLS_PER_UNIT = 30


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
    pyramid = Pyramid(levels, origin_m, cell_m)
    at_once(lambda share: fill_pyramid(pyramid, share))
    return pyramid


def fill_pyramid(pyramid: Pyramid, share: Share) -> Task:
    """Level 0 is given; the others come from it."""
    height = pyramid.levels.shape[1]
    for h in range(1, len(pyramid.levels)):
        for first in range(0, height, _ROWS_AT_ONCE):
            if share.left <= 0:
                yield
            last = min(first + _ROWS_AT_ONCE, height)
            _kernels.fill_level(pyramid.levels, h, first, last)
            share.take((last - first) * pyramid.levels.shape[2] // _CELLS_PER_UNIT)


def search(
    points_m: NDArray[np.float64],
    pyramid: Pyramid,
    centre: NDArray[np.float64],
    shift_m: float,
    turn_rad: float,
    min_score: float,
    max_branches: int,
) -> Found | None:
    """All at once; see `Search`."""
    if len(points_m) == 0:
        return None
    task = Search(points_m, pyramid, centre, shift_m, turn_rad, min_score, max_branches)
    at_once(task.run)
    return task.found


class Search:
    """The best pose within a window, or None where none reaches `min_score` within `max_branches`.

    `points_m`: (N, 2), robot frame, N > 0. The angular step moves the farthest point by one cell (eq. 7).
    """

    def __init__(
        self,
        points_m: NDArray[np.float64],
        pyramid: Pyramid,
        centre: NDArray[np.float64],
        shift_m: float,
        turn_rad: float,
        min_score: float,
        max_branches: int,
    ) -> None:
        self.found: Found | None = None
        self._points_m = points_m
        self._pyramid = pyramid
        self._centre = centre
        self._max_branches = max_branches
        farthest_m = max(float(np.sqrt(np.max(np.sum(points_m**2, axis=1)))), 4 * pyramid.cell_m)
        self._step_rad = 2 * math.asin(min(1.0, pyramid.cell_m / (2 * farthest_m)))
        self._turns = math.ceil(turn_rad / self._step_rad)
        self._shifts = math.ceil(shift_m / pyramid.cell_m)
        self._state = np.zeros(8, np.int64)
        self._state[_kernels.BEST] = math.ceil(min_score * 255.0 * len(points_m)) - 1

    def run(self, share: Share) -> Task:
        """Look; `found` says what came of it."""
        state, angles = self._state, 2 * self._turns + 1
        depth = len(self._pyramid.levels) - 1
        along = 2 * self._shifts // (1 << depth) + 1
        columns = np.empty((angles, len(self._points_m)), np.int32)
        rows = np.empty_like(columns)
        heap = np.empty((angles * along * along, 2), np.int64)
        yield from share.spread(lambda s, b: self._score_roots(columns, rows, heap, s, b), state, angles)
        stack, best = np.empty((4 * depth + 4, 5), np.int64), np.zeros(3, np.int64)
        yield from share.spread(
            lambda _, b: _kernels.descend(
                self._pyramid.levels, self._shifts, self._max_branches, columns, rows, heap, stack, best, state, b
            ),
            state[_kernels.DONE :],
            1,
        )
        if state[_kernels.FOUND]:
            cell_m, (angle, dx, dy) = self._pyramid.cell_m, best.tolist()
            shift = np.array([dx * cell_m, dy * cell_m, (angle - self._turns) * self._step_rad])
            score = float(state[_kernels.BEST]) / (255.0 * len(self._points_m))
            self.found = Found(self._centre + shift, score)

    def _score_roots(
        self,
        columns: NDArray[np.int32],
        rows: NDArray[np.int32],
        heap: NDArray[np.int64],
        state: NDArray[np.int64],
        budget: int,
    ) -> int:
        pyramid = self._pyramid
        return _kernels.score_roots(
            self._points_m, pyramid.levels, pyramid.origin_m[0], pyramid.origin_m[1], pyramid.cell_m, self._centre,
            self._shifts, self._turns, self._step_rad, columns, rows, heap, state, budget,
        )  # fmt: skip
