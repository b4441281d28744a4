"""Simplified FastGNG: grows a network over the edge points (paper 1, section 3.2, steps 2-7)."""

from __future__ import annotations

import numpy as np

from robot_app.perception.config import LearningConfig, RefineConfig
from robot_app.perception.learner import Network
from robot_app.perception.learners.simplified import _kernels as kernels
from robot_app.perception.point_cloud import EdgeCloud


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
