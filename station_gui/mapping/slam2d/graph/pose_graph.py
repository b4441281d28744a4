"""Nodes, the relative poses measured between them, and the poses that agree with them best."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import PoseGraphConfig
from station_gui.mapping.slam2d.graph import _kernels
from station_gui.mapping.slam2d.graph.optimiser import Edges, Optimiser
from station_gui.mapping.slam2d.graph.ways.ways import Ways
from station_gui.mapping.slam2d.se2_arrays import between, compose
from station_gui.mapping.slam2d.share import Task

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
        self.ways = Ways()
        self._trial = np.zeros((_FIRST_ROOM, 3))  # where an optimisation has come to
        self._trial_nodes = 0
        self._optimised_edges = 0
        self._optimiser = Optimiser(config)
        self._task: Task | None = None
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
        if self.nodes >= len(self._poses):
            self._poses = _doubled(self._poses)
        self._poses[self.nodes] = pose
        self.ways.add_node()
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
        e = self.edges
        self._ends[e] = i, j
        self._measured[e] = measured
        self._information[e] = information
        self._robust[e] = robust
        self.ways.add_edge(i, j, length_m)
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
        return self.ways.length_m

    def take_as_settled(self) -> None:
        """The edges so far have been optimised elsewhere: none is new to the next optimisation."""
        self._optimised_edges = self.edges

    @property
    def optimising(self) -> bool:
        return self._task is not None

    @property
    def moved_m(self) -> float:
        """The farthest that a node went in the last optimisation."""
        return self._optimiser.moved_m

    def begin_optimisation(self) -> None:
        """Start from where the nodes are; `step` does the work."""
        if self.nodes < 2 or self.edges == 0:
            return
        edges = Edges(self.edges, self._ends, self._measured, self._information, self._robust)
        self._trial_nodes = self.nodes
        if len(self._trial) < len(self._poses):
            self._trial = np.zeros_like(self._poses)
        trial = self._trial[: self.nodes]
        self._task = self._optimiser.run(edges, self._optimised_edges, self.poses, trial)
        self._optimised_edges = self.edges

    def step(self, units: int | None = None) -> bool:
        """A share of the work; True when it was the last and the nodes have moved to their new poses.

        `units`: about so many products of two 3 × 3 blocks, by default as many as the configuration says.
        """
        if self._task is None:
            return False
        if not self._optimiser.share.run(self._task, units or self._config.blocks_per_step):
            return False
        self._task = None
        if not self._optimiser.failed:
            self._adopt()
        return True

    def optimise(self) -> None:
        """All at once; what was begun is ended first."""
        self._finish_task()
        self.begin_optimisation()
        self._finish_task()

    def _finish_task(self) -> None:
        while self._task is not None:
            self.step()

    def _adopt(self) -> None:
        """Nodes that came meanwhile follow the last one that took part."""
        last = self._trial_nodes - 1
        while len(self._trial) < self.nodes:
            self._trial = _doubled(self._trial)
        for k in range(self._trial_nodes, self.nodes):
            self._trial[k] = compose(self._trial[last], between(self._poses[last], self._poses[k]))
        self._poses, self._trial = self._trial, self._poses

    def chi2(self) -> NDArray[np.float64]:
        """(edges,): squared error of every edge by its information."""
        return self.last_chi2(self.edges)

    def last_chi2(self, count: int) -> NDArray[np.float64]:
        """(count,): that of the edges that came last."""
        result, last = np.zeros(count), slice(self.edges - count, self.edges)
        _kernels.all_chi2(self.poses, self._ends[last], self._measured[last], self._information[last], result)
        return result

    def distances_m(self, node: int, limit_m: float = np.inf) -> NDArray[np.float64]:
        """(nodes,): length of the shortest way along edges from `node`; infinite beyond `limit_m`."""
        result = np.full(self.nodes, np.inf)
        near, way_m = self.ways.near(node, limit_m, self.nodes)
        result[near] = way_m
        return result


def _doubled(array: NDArray[_Number]) -> NDArray[_Number]:
    return np.concatenate((array, np.zeros_like(array)))
