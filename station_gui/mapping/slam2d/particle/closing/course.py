"""The particles' common way as a graph: nodes about a metre apart, what tracking measured between them, closures."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from station_gui.mapping.slam2d.closures.closure import Closure
from station_gui.mapping.slam2d.config import PoseGraphConfig
from station_gui.mapping.slam2d.graph.loop_closure import edge_information
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.particle.closing.config import BendConfig
from station_gui.mapping.slam2d.se2_arrays import between, between_all, rotate_information

FloatArray = NDArray[np.float64]
_CLOSURE_LENGTH_M = 0.5  # the way that the error of a closure is worth
_LEAST_EDGE_M = 0.1


class Course:
    """A node begins at a step of the filter; its pose is that of the step on the path of whoever asks."""

    def __init__(self, config: BendConfig) -> None:
        self._config = config
        self._first_steps: list[int] = []
        self._information: list[FloatArray] = []  # of the edge that leads to each node; the first has none
        self._lengths_m: list[float] = []
        self._way_m = 0.0
        self._turn_rad = 0.0
        self._misfit = 0.0  # of the steps since the last node
        self._steps = 0
        self._given = 0
        self.closures: list[Closure] = []  # in force: the path agrees with them

    @property
    def nodes(self) -> int:
        return len(self._first_steps)

    @property
    def given(self) -> int:
        """How many nodes there were at first: a map that was given, in one piece."""
        return self._given

    def begin_given(self) -> None:
        """All steps so far are one node, which is always joined; the next one begins another."""
        self._given = 1
        self._first_steps, self._information, self._lengths_m = [0], [np.eye(3)], [_LEAST_EDGE_M]
        self._way_m = math.inf

    @property
    def first_steps(self) -> NDArray[np.int64]:
        """(nodes,): the step at which each node begins."""
        return np.array(self._first_steps, np.int64)

    def add_step(
        self, step: int, motion: FloatArray, information: FloatArray, before_rad: float, misfit: float = 0.0
    ) -> bool:
        """One step more, (3,) `motion` from the last one; True when a node begins with it.

        `information`: (3, 3), what the match says about the step's pose, map frame; `before_rad`: heading of the
        last node there; `misfit`: share of the points that did not fit since the last step.
        """
        self._misfit += misfit
        self._steps += 1
        self._way_m += float(np.hypot(motion[0], motion[1]))
        self._turn_rad += abs(float(motion[2]))
        config = self._config
        if self.nodes and self._way_m < config.node_distance_m and self._turn_rad < config.node_turn_rad:
            return False
        self._first_steps.append(step)
        loose = 1.0 + self._config.misfit_ratio * self._misfit / self._steps
        self._information.append(self.edge_information(information, before_rad, loose))
        self._lengths_m.append(max(self._way_m, _LEAST_EDGE_M) if math.isfinite(self._way_m) else _LEAST_EDGE_M)
        self._way_m = self._turn_rad = self._misfit = 0.0
        self._steps = 0
        return True

    def edge_information(self, match_information: FloatArray, theta_rad: float, loose: float = 1.0) -> FloatArray:
        """(3, 3): what a match is worth in a frame turned by `theta_rad`, with the model's floor, `loose` as wide."""
        shift, turn = loose * self._config.shift_sigma_m, loose * self._config.turn_sigma_rad
        return edge_information(match_information, theta_rad, shift, turn)

    def node_of_steps(self, steps: int) -> NDArray[np.int64]:
        """(steps,): the node that each step belongs to."""
        return np.searchsorted(self.first_steps, np.arange(steps), side="right") - 1

    def information_to(self, node: int) -> FloatArray:
        """(3, 3): of the edge from the node before, in whose frame it is."""
        return self._information[node]

    def distances_m(self, node: int, limit_m: float = np.inf, extra: tuple[Closure, ...] = ()) -> FloatArray:
        """(nodes,): the shortest way from `node` along the path and its closures; infinite beyond `limit_m`."""
        chain = np.arange(self.nodes - 1)
        joined = [*self.closures, *extra]
        old, new = [c.old for c in joined], [c.new for c in joined]
        rows = np.concatenate((chain, np.array(old, np.int64)))
        columns = np.concatenate((chain + 1, np.array(new, np.int64)))
        lengths = np.concatenate((np.array(self._lengths_m[1:]), np.full(len(joined), _CLOSURE_LENGTH_M)))
        pairs, first = np.unique(np.column_stack((rows, columns)), axis=0, return_index=True)
        graph = csr_array((lengths[first], (pairs[:, 0], pairs[:, 1])), shape=(self.nodes, self.nodes))
        return np.asarray(dijkstra(graph, directed=False, indices=np.array([node]), limit=limit_m)[0])

    def joined(self, limit_m: float, extra: tuple[Closure, ...] = ()) -> NDArray[np.bool_]:
        """(nodes,): whether a node lies so near to the last one along the graph."""
        near = np.isfinite(self.distances_m(self.nodes - 1, limit_m, extra))
        near[: self._given] = True
        return np.asarray(near)

    def graph(self, poses: FloatArray, motions: FloatArray, extra: tuple[Closure, ...]) -> PoseGraph:
        """To be optimised, from `poses`, (nodes, 3); `motions`, (steps, 3): those of tracking."""
        tracked = integrated(motions)[self.first_steps]
        measured = between_all(tracked[:-1], tracked[1:])
        graph = PoseGraph(PoseGraphConfig())
        for pose in poses:
            graph.add_node(pose)
        for k, relative in enumerate(measured):
            graph.add_edge(k, k + 1, relative, self._information[k + 1], self._lengths_m[k + 1], robust=False)
        for closure in (*self.closures, *extra):
            graph.add_edge(
                closure.old, closure.new, closure.measured, closure.information, _CLOSURE_LENGTH_M, robust=True
            )
        return graph


def closure_chi2(closure: Closure, poses: FloatArray) -> float:
    """How little it agrees with the nodes at `poses`, (nodes, 3)."""
    error = between(closure.measured, between(poses[closure.old], poses[closure.new]))
    turned = rotate_information(closure.information, float(closure.measured[2]))
    return float(error @ turned @ error)


def integrated(motions: FloatArray) -> FloatArray:
    """(K, 3): the path from the origin that motions, (K, 3), make; the first one leads to the first pose."""
    theta = np.cumsum(motions[:, 2])
    before = np.append(0.0, theta[:-1])
    c, s = np.cos(before), np.sin(before)
    x = np.cumsum(c * motions[:, 0] - s * motions[:, 1])
    y = np.cumsum(s * motions[:, 0] + c * motions[:, 1])
    return np.column_stack((x, y, theta))
