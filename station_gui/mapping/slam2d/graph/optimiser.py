"""Gauss–Newton on a pose graph, a bounded share at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import PoseGraphConfig
from station_gui.mapping.slam2d.graph import _kernels
from station_gui.mapping.slam2d.graph.solver.analysis import Analysis
from station_gui.mapping.slam2d.graph.solver.block_cholesky import BlockCholesky
from station_gui.mapping.slam2d.share import Share, Task


@dataclass(slots=True, eq=False)
class Edges:
    """Relative poses, the first `count` rows of each array; the rest is room.

    `ends`: (E, 2) nodes; `measured`: (E, 3), the second in the frame of the first; `information`: (E, 3, 3);
    `robust`: (E,), True for loop closures.
    """

    count: int
    ends: NDArray[np.int32]
    measured: NDArray[np.float64]
    information: NDArray[np.float64]
    robust: NDArray[np.bool_]


class Optimiser:
    """Moves nodes to where they agree best with the edges; closures under dynamic covariance scaling.

    At first every closure that is new pulls with its full weight, however far off it is; then those whose error
    stays above what the graph can explain let go (graduated non-convexity, Yang et al. 2020).
    """

    def __init__(self, config: PoseGraphConfig) -> None:
        self._config = config
        self.share = Share()
        self._analysis = Analysis(self.share)
        self._system = BlockCholesky(self.share, self._analysis)
        self.moved_m = 0.0  # the farthest that a node went in the run that ended last
        self.failed = False  # it ended without a result

    def run(self, edges: Edges, new_from: int, poses: NDArray[np.float64], trial: NDArray[np.float64]) -> Task:
        """From `poses` (N, 3) to `trial` (N, 3); edges from `new_from` on are new."""
        nodes = len(poses)
        self.moved_m, self.failed = 0.0, False
        yield from self.share.spread(lambda s, b: _kernels.copy_poses(poses, trial, nodes, s, b), _state(), nodes)
        worst = np.array([self._config.switch_chi2])
        yield from self.share.spread(
            lambda s, b: _kernels.worst_chi2(
                poses, edges.ends, edges.measured, edges.information, edges.robust, edges.count, worst, s, b
            ),
            _state(new_from),
            edges.count,
        )
        yield from self._analysis.run(nodes - 1, edges.ends, edges.count)
        yield from self._iterate(edges, trial, float(worst[0]))
        farthest = np.zeros(1)
        yield from self.share.spread(
            lambda s, b: _kernels.farthest_move(poses, trial, nodes, farthest, s, b), _state(), nodes
        )
        self.moved_m = float(farthest[0])

    def _iterate(self, edges: Edges, trial: NDArray[np.float64], switch_chi2: float) -> Task:
        config = self._config
        change = np.zeros(1)
        for _ in range(config.iterations):
            yield from self._gauss_newton(edges, trial, switch_chi2, change)
            if self.failed or (switch_chi2 <= config.switch_chi2 and change[0] < 1e-4):
                return
            switch_chi2 = max(config.switch_chi2, config.switch_shrink * switch_chi2)

    def _gauss_newton(
        self, edges: Edges, trial: NDArray[np.float64], switch_chi2: float, change: NDArray[np.float64]
    ) -> Task:
        """Moves `trial`; `change` (1,) becomes the largest change of a coordinate."""
        a, system = self._analysis, self._system
        yield from system.clear()
        yield from self.share.spread(
            lambda s, b: _kernels.assemble(
                trial, edges.ends, edges.measured, edges.information, edges.robust, switch_chi2, edges.count,
                a.position, a.slots, system.diagonal, system.below, system.right, s, b,
            ),
            _state(),
            edges.count,
        )  # fmt: skip
        yield from system.solve()
        if system.failed:
            self.failed = True
            return
        change[0] = 0.0
        yield from self.share.spread(
            lambda s, b: _kernels.move_poses(trial, a.position, system.right, len(trial), change, s, b),
            _state(),
            len(trial) - 1,
        )


def _state(first: int = 0) -> NDArray[np.int64]:
    state = np.zeros(8, np.int64)
    state[0] = first
    return state
