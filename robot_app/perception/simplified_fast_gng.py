"""Simplified FastGNG: grows a network over the edge points (paper 1, section 3.2, steps 2-7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_app.perception.config import LearningConfig, RefineConfig
from robot_app.perception.network import _kernels as kernels
from robot_app.perception.point_cloud import EdgeCloud


class Network:
    """Nodes and connections that are being worked on, optical frame.

    `node_m`: (max_nodes, 3) float32, of which the first `nodes` count. `linked`: (max_nodes, max_nodes) uint8.
    """

    def __init__(self, max_nodes: int) -> None:
        self.node_m = np.zeros((max_nodes, 3), np.float32)
        self.node_curve = np.zeros(max_nodes, np.int32)
        self.linked = np.zeros((max_nodes, max_nodes), np.uint8)
        self.nodes = 0
        self._pairs = np.zeros((8 * max_nodes, 2), np.int32)

    def connections(self) -> NDArray[np.int32]:
        """(M, 2), a view that the next call writes over."""
        return self._pairs[: kernels.list_connections(self.linked, self.nodes, self._pairs)]

    def drop_isolated(self) -> None:
        self.nodes = kernels.remove_isolated(self.node_m, self.node_curve, self.linked, self.nodes)


class SimplifiedFastGng:
    """The learner of steps 2-7."""

    def __init__(self, config: LearningConfig, evaluation: RefineConfig, max_samples: int) -> None:
        self._config = config
        self._evaluation = evaluation
        self._min_length_m = np.array(config.min_length_m, np.float64)
        self._max_length_m = np.array(config.max_length_m, np.float64)
        self._per_node = np.array(config.samples_per_node, np.float64)
        self._nearest_m, self._seen_m, self._chance = np.zeros((3, max_samples), np.float32)

    def learn(self, cloud: EdgeCloud, network: Network) -> None:
        """Grow `network` anew over the samples of `cloud`."""
        network.nodes = kernels.grow(
            cloud.sample_m,
            cloud.sample_weight,
            cloud.sample_curve,
            cloud.samples,
            self._min_length_m,
            self._max_length_m,
            self._per_node,
            self._config.beta,
            cloud.lens,
            cloud.stride,
            self._evaluation.connection_reach_m,
            self._evaluation.connection_step_m,
            cloud.edge_m,
            cloud.edge_at,
            self._nearest_m,
            self._seen_m,
            self._chance,
            network.node_m,
            network.node_curve,
            network.linked,
        )
