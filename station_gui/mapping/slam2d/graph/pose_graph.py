"""Nodes, the relative poses measured between them, and the poses that agree with them best."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu

from station_gui.mapping.slam2d.config import PoseGraphConfig
from station_gui.mapping.slam2d.graph import _kernels
from station_gui.mapping.slam2d.se2_arrays import between, compose

_FIRST_ROOM = 256
_Number = TypeVar("_Number", bound=np.generic)


class PoseGraph:
    """Gauss–Newton on a sparse system; loop closures under dynamic covariance scaling. Node 0 stays where it is."""

    def __init__(self, config: PoseGraphConfig) -> None:
        self._config = config
        self._poses: NDArray[np.float64] = np.zeros((_FIRST_ROOM, 3))
        self._ends: NDArray[np.int32] = np.zeros((_FIRST_ROOM, 2), np.int32)
        self._measured: NDArray[np.float64] = np.zeros((_FIRST_ROOM, 3))
        self._information: NDArray[np.float64] = np.zeros((_FIRST_ROOM, 3, 3))
        self._robust: NDArray[np.bool_] = np.zeros(_FIRST_ROOM, np.bool_)
        self._length_m: NDArray[np.float64] = np.zeros(_FIRST_ROOM)
        self._trial: NDArray[np.float64] | None = None
        self._switch_chi2 = config.switch_chi2
        self._optimised_edges = 0
        self._steps_left = 0
        self.nodes = 0
        self.edges = 0

    @property
    def poses(self) -> NDArray[np.float64]:
        """(nodes, 3): x, y, theta in the map frame; a view."""
        return self._poses[: self.nodes]

    @property
    def ends(self) -> NDArray[np.int32]:
        """(edges, 2): nodes that an edge joins; a view."""
        return self._ends[: self.edges]

    @property
    def robust(self) -> NDArray[np.bool_]:
        """(edges,): True for loop closures; a view."""
        return self._robust[: self.edges]

    def add_node(self, pose: NDArray[np.float64]) -> int:
        if self.nodes == len(self._poses):
            self._poses = _doubled(self._poses)
        self._poses[self.nodes] = pose
        self.nodes += 1
        return self.nodes - 1

    def add_edge(
        self,
        i: int,
        j: int,
        measured: NDArray[np.float64],
        information: NDArray[np.float64],
        length_m: float,
        *,
        robust: bool,
    ) -> None:
        """`measured`: (3,), node j in the frame of node i; `information`: (3, 3), frame of node i.

        `length_m` is the way that the drift of this edge is worth.
        """
        if self.edges == len(self._ends):
            self._ends, self._measured = _doubled(self._ends), _doubled(self._measured)
            self._information, self._robust = _doubled(self._information), _doubled(self._robust)
            self._length_m = _doubled(self._length_m)
        e = self.edges
        self._ends[e] = i, j
        self._measured[e] = measured
        self._information[e] = information
        self._robust[e] = robust
        self._length_m[e] = length_m
        self.edges += 1

    @property
    def measured(self) -> NDArray[np.float64]:
        """(edges, 3): the second node as seen from the first; a view."""
        return self._measured[: self.edges]

    @property
    def information(self) -> NDArray[np.float64]:
        """(edges, 3, 3), frame of the first node; a view."""
        return self._information[: self.edges]

    @property
    def length_m(self) -> NDArray[np.float64]:
        """(edges,): the way that the drift of each is worth; a view."""
        return self._length_m[: self.edges]

    def take_as_settled(self) -> None:
        """The edges so far have been optimised elsewhere: none is new to the next optimisation."""
        self._optimised_edges = self.edges

    @property
    def optimising(self) -> bool:
        return self._trial is not None

    def begin_optimisation(self) -> None:
        """Start from where the nodes are; `step` does the work, one linear system at a time.

        At first every closure that is new pulls with its full weight, however far off it is; then those whose
        error stays above what the graph can explain let go (graduated non-convexity, Yang et al. 2020).
        """
        new = self.robust & (np.arange(self.edges) >= self._optimised_edges)
        self._switch_chi2 = max(self._config.switch_chi2, float(self.chi2()[new].max(initial=0.0)))
        self._trial = self.poses.copy()
        self._optimised_edges = self.edges
        self._steps_left = self._config.iterations

    def step(self) -> bool:
        """One Gauss–Newton step; True when it was the last and the nodes have moved to their new poses."""
        trial = self._trial
        if trial is None:
            return False
        change = self._gauss_newton(trial)
        self._steps_left -= 1
        settled = self._switch_chi2 <= self._config.switch_chi2 and change < 1e-4
        self._switch_chi2 = max(self._config.switch_chi2, 0.2 * self._switch_chi2)
        if not settled and self._steps_left > 0:
            return False
        self._adopt(trial)
        self._trial = None
        return True

    def optimise(self) -> None:
        """All steps at once."""
        if self.nodes > 1 and self.edges > 0:
            self.begin_optimisation()
            while not self.step():
                pass

    def _gauss_newton(self, trial: NDArray[np.float64]) -> float:
        """Moves `trial`; returns the largest change of a coordinate."""
        edges, size = self._optimised_edges, 3 * (len(trial) - 1)
        rows, columns = np.zeros(36 * edges, np.int32), np.zeros(36 * edges, np.int32)
        values, gradient = np.zeros(36 * edges), np.zeros(size)
        _kernels.assemble(
            trial, self._ends[:edges], self._measured[:edges], self._information[:edges], self._robust[:edges],
            self._switch_chi2, rows, columns, values, gradient,
        )  # fmt: skip
        system = csc_array((values, (rows, columns)), shape=(size, size))
        change = splu(system, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(-gradient)
        trial[1:] += change.reshape(-1, 3)
        return float(np.abs(change).max())

    def _adopt(self, trial: NDArray[np.float64]) -> None:
        """Nodes that came meanwhile follow the last one that took part."""
        last = len(trial) - 1
        before = self._poses[last].copy()
        for k in range(len(trial), self.nodes):
            self._poses[k] = compose(trial[last], between(before, self._poses[k]))
        self._poses[: len(trial)] = trial

    def chi2(self) -> NDArray[np.float64]:
        """(edges,): squared error of every edge by its information."""
        result = np.zeros(self.edges)
        _kernels.all_chi2(self.poses, self.ends, self._measured[: self.edges], self._information[: self.edges], result)
        return result

    def distances_m(self, node: int, limit_m: float = np.inf) -> NDArray[np.float64]:
        """(nodes,): length of the shortest way along edges from `node`; infinite beyond `limit_m`."""
        graph = csr_array(
            (self._length_m[: self.edges], (self.ends[:, 0], self.ends[:, 1])), shape=(self.nodes, self.nodes)
        )
        return np.asarray(dijkstra(graph, directed=False, indices=np.array([node]), limit=limit_m)[0])


def _doubled(array: NDArray[_Number]) -> NDArray[_Number]:
    return np.concatenate((array, np.zeros_like(array)))
