"""Solves a sparse symmetric system of 3 × 3 blocks, a bounded share at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.graph.solver import _kernels
from station_gui.mapping.slam2d.graph.solver.analysis import Analysis
from station_gui.mapping.slam2d.share import Share, Task


class BlockCholesky:
    """A = L Lᵀ by the order and structure of `analysis`.

    Between `clear` and `solve` the caller adds the system: `diagonal` (n, 9), `below` (blocks, 9), blocks row by
    row, of which those below the diagonal lie as `Analysis` says, and `right` (n, 3), which becomes the solution.
    """

    def __init__(self, share: Share, analysis: Analysis) -> None:
        self._share = share
        self._analysis = analysis
        self.diagonal: NDArray[np.float64] = np.zeros((0, 9))
        self.below: NDArray[np.float64] = np.zeros((0, 9))
        self.right: NDArray[np.float64] = np.zeros((0, 3))
        self.failed = False  # the system was not positive definite; there is no solution
        self._heads = self._nexts = self._cursors = self._slot_of_row = np.zeros(0, np.int32)

    def clear(self) -> Task:
        a = self._analysis
        self._reserve()
        yield from self._share.spread(
            lambda s, b: _kernels.clear(a.unknowns, a.blocks, self.diagonal, self.below, self.right, self._heads, s, b),
            np.zeros(8, np.int64),
            a.unknowns + a.blocks,
        )

    def solve(self) -> Task:
        a = self._analysis
        state = np.zeros(8, np.int64)
        yield from self._share.spread(
            lambda s, b: _kernels.factor(
                a.unknowns, a.column_start, a.rows, self.diagonal, self.below, self.right,
                self._heads, self._nexts, self._cursors, self._slot_of_row, s, b,
            ),
            state,
            a.unknowns,
        )  # fmt: skip
        self.failed = bool(state[_kernels.FAILED])
        if self.failed:
            return
        yield from self._share.spread(
            lambda s, b: _kernels.substitute_back(
                a.unknowns, a.column_start, a.rows, self.diagonal, self.below, self.right, s, b
            ),
            np.zeros(8, np.int64),
            a.unknowns,
        )

    def _reserve(self) -> None:
        a = self._analysis
        if a.unknowns > len(self.diagonal):
            room = len(a.position)
            self.diagonal, self.right = np.empty((room, 9)), np.empty((room, 3))
            self._heads, self._nexts = np.empty(room, np.int32), np.empty(room, np.int32)
            self._cursors, self._slot_of_row = np.empty(room, np.int32), np.empty(room, np.int32)
        if a.blocks > len(self.below):
            self.below = np.empty((len(a.rows), 9))
