"""Standard growing neural gas (Fritzke, A growing neural gas network learns topologies, NIPS 7, 1995)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_app.perception.learner import Network
from robot_app.perception.learners.graph import _kernels as graph
from robot_app.perception.learners.standard import _kernels as kernels
from robot_app.perception.point_cloud import EdgeCloud


@dataclass(frozen=True, slots=True)
class GngConfig:
    """Fritzke's figures but for two: table 2 of paper 1 has 150 nodes after 3,700 iterations at the least, 25 for each
    after the first two; and up to 4,120, for nodes are lost on the way, which takes connections that do not last."""

    nodes: int = 150
    iterations_per_node: int = 25  # λ
    most_iterations: int = 10_000  # bounds the time
    winner_rate: float = 0.2  # ε_b
    neighbour_rate: float = 0.006  # ε_n
    max_age: int = 20  # a_max
    alpha: float = 0.5
    decay: float = 0.995  # d

    def __post_init__(self) -> None:
        if self.nodes < 2 or self.iterations_per_node < 1 or self.most_iterations < 1:
            raise ValueError("nodes must be at least 2, iterations_per_node and most_iterations at least 1")


class GrowingNeuralGas:
    """Learns one sample after the other; `iterations` is how many the last network took."""

    def __init__(self, config: GngConfig, rng: np.random.Generator) -> None:
        self._config = config
        self.iterations = 0
        self._state = rng.integers(1, 2**63, 1, np.uint64)
        self._node = np.zeros((3, config.nodes), np.float32)
        self._square, self._error = np.zeros((2, config.nodes), np.float32)
        self._beside, self._age = np.zeros((2, config.nodes, graph.MOST_NEIGHBOURS), np.int32)
        self._degree = np.zeros(config.nodes, np.int32)

    def learn(self, cloud: EdgeCloud, network: Network) -> None:
        """Grow `network` anew over the samples of `cloud`; the nodes belong to no curve."""
        config = self._config
        network.nodes, self.iterations = kernels.grow(
            cloud.sample_m,
            cloud.samples,
            min(config.nodes, len(network.node_m)),
            config.most_iterations,
            config.iterations_per_node,
            config.winner_rate,
            config.neighbour_rate,
            config.max_age,
            config.alpha,
            config.decay,
            self._state,
            self._node,
            self._square,
            self._error,
            self._beside,
            self._age,
            self._degree,
            network.node_m,
            network.linked,
        )
        network.belong_to_no_curve()
