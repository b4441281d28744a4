"""FastGNG: growing neural gas that grows by mini-batches.

Paper 1 names it and gives no steps ("adds new nodes after mini-batch learning using weight parameters ... this also
results in unnecessary nodes being added to the network, which requires an additional node deletion process"), says
that simplified FastGNG has the same core, and that it has phases. So here: phases, lengths and loops as simplified
FastGNG has them (eqs 12, 15, 16 and 20); what that one leaves out is the learning of a mini-batch before each new node,
connections between the nearest two of every sample, which may be many at a node, and the deletion at a phase's end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_app.perception.config import LearningConfig
from robot_app.perception.learner import Network
from robot_app.perception.learners.fast import _kernels as kernels
from robot_app.perception.learners.graph import _kernels as graph
from robot_app.perception.point_cloud import EdgeCloud


@dataclass(frozen=True, slots=True)
class FastGngConfig:
    """What FastGNG has beside the parameters that it shares with simplified FastGNG."""

    batch: int = 4  # samples before each new node
    rate: float = 0.2  # as the winner of standard GNG
    neighbour_rate: float = 0.03  # as a share of that: 0.006 in standard GNG
    max_age: int = 20

    def __post_init__(self) -> None:
        if self.batch < 1:
            raise ValueError("batch must be at least 1")


class FastGng:
    """Learns by mini-batches; `looked` is how many samples the last network took."""

    def __init__(self, shared: LearningConfig, config: FastGngConfig, rng: np.random.Generator) -> None:
        self._shared = shared
        self._config = config
        self.looked = 0
        self._min_length_m = np.array(shared.min_length_m, np.float64)
        self._max_length_m = np.array(shared.max_length_m, np.float64)
        self._per_node = np.array(shared.samples_per_node, np.float64)
        self._state = rng.integers(1, 2**63, 1, np.uint64)
        self._node, self._shift = np.zeros((2, 3, shared.max_nodes), np.float32)
        self._square, self._share = np.zeros((2, shared.max_nodes), np.float32)
        self._wins, self._degree = np.zeros((2, shared.max_nodes), np.int32)
        self._beside, self._age = np.zeros((2, shared.max_nodes, graph.MOST_NEIGHBOURS), np.int32)

    def learn(self, cloud: EdgeCloud, network: Network) -> None:
        """Grow `network` anew over the samples of `cloud`; the nodes belong to no curve."""
        config = self._config
        network.nodes, self.looked = kernels.grow(
            cloud.sample_m,
            cloud.samples,
            min(self._shared.max_nodes, len(network.node_m)),
            self._min_length_m,
            self._max_length_m,
            self._per_node,
            self._shared.beta,
            config.batch,
            config.rate,
            config.neighbour_rate,
            config.max_age,
            self._state,
            self._node,
            self._square,
            self._shift,
            self._share,
            self._wins,
            self._beside,
            self._age,
            self._degree,
            network.node_m,
            network.linked,
        )
        network.belong_to_no_curve()
