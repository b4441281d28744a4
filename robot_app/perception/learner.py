"""What the learners have in common: the network that they grow, and how they are called."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robot_app.perception.network import _kernels as kernels
from robot_app.perception.point_cloud import EdgeCloud


class Network:
    """Nodes and connections that are being worked on, optical frame.

    `node_m`: (max_nodes, 3) float32, of which the first `nodes` count. `linked`: (max_nodes, max_nodes) uint8.
    """

    def __init__(self, max_nodes: int) -> None:
        self.node_m = np.zeros((max_nodes, 3), np.float32)
        self.node_curve = np.zeros(max_nodes, np.int32)
        self.node_weight = np.zeros(max_nodes, np.float32)
        self.linked = np.zeros((max_nodes, max_nodes), np.uint8)
        self.nodes = 0
        self._pairs = np.zeros((8 * max_nodes, 2), np.int32)

    def connections(self) -> NDArray[np.int32]:
        """(M, 2), a view that the next call writes over."""
        return self._pairs[: kernels.list_connections(self.linked, self.nodes, self._pairs)]

    def belong_to_no_curve(self) -> None:
        """For learners that do not ask which edge curve a sample lies on."""
        self.node_curve[: self.nodes] = 0
        self.node_weight[: self.nodes] = 1.0

    def drop_isolated(self) -> None:
        self.nodes = kernels.remove_isolated(self.node_m, self.node_curve, self.node_weight, self.linked, self.nodes)


class Learner(Protocol):
    """Grows a network over sample points; its memory is allocated when it is made."""

    def learn(self, cloud: EdgeCloud, network: Network) -> None:
        """Grow `network` anew over the samples of `cloud`."""
        ...
