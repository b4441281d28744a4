"""Simplified FastGNG: grows a network over the edge points (paper 1, section 3.2, steps 2-7)."""

from __future__ import annotations

import numpy as np

from robot_app.perception.config import LearningConfig, RefineConfig
from robot_app.perception.learner import Network
from robot_app.perception.learners.simplified import _kernels as kernels
from robot_app.perception.point_cloud import EdgeCloud

_APART_M = 64.0  # curves are learned so far from each other: more than the greatest range times the greatest detail


class SimplifiedFastGng:
    """The learner of steps 2-7.

    With `evidence` it looks whether edge points lie under a connection before it makes it, as the extraction wants it,
    a node keeps away those of its own curve only, and small curves are drawn finer (`curve_detail`); without, it does
    what the paper's text says and no more.
    """

    def __init__(
        self, config: LearningConfig, evaluation: RefineConfig, max_samples: int, evidence: bool = True
    ) -> None:
        self._evidence = evidence
        self._config = config
        self._evaluation = evaluation
        self._min_length_m = np.array(config.min_length_m, np.float64)
        self._max_length_m = np.array(config.max_length_m, np.float64)
        self._per_node = np.array(config.samples_per_node, np.float64)
        blocks = -(-max_samples // kernels.LANES)
        shape = (blocks, kernels.LANES)
        self._point, self._place = np.zeros((2, blocks, 3, kernels.LANES), np.float32)
        self._node_place = np.zeros((config.max_nodes, 3), np.float32)
        self._weight, self._near, self._chance = np.zeros((3, *shape), np.float32)
        self._curve = np.zeros(shape, np.int32)
        self._starts = np.zeros(kernels.BUCKETS + 1, np.int32)
        self._bound, self._top = np.zeros((2, blocks + 1), np.float32)
        self._seen = np.zeros(blocks, np.int32)
        self._square = np.zeros(kernels.LANES, np.float32)
        self._gap, self._other = np.zeros(kernels.CANDIDATES, np.float32), np.zeros(kernels.CANDIDATES, np.int32)
        self._pair = np.zeros((4 * config.max_nodes, 2), np.int32)
        self._length_m = np.zeros(4 * config.max_nodes, np.float32)
        self._degrees = np.zeros(config.max_nodes, np.int32)

    def learn(self, cloud: EdgeCloud, network: Network) -> None:
        """Grow `network` anew over the samples of `cloud`."""
        samples = self._point, self._place, self._weight, self._curve, self._bound
        apart_m = _APART_M if self._evidence else 0.0
        blocks = kernels.sort_samples(
            cloud.sample_m,
            cloud.sample_weight,
            cloud.sample_curve,
            cloud.samples,
            cloud.curve_detail,
            apart_m,
            self._starts,
            *samples,
        )
        network.nodes = kernels.grow(
            cloud.samples,
            blocks,
            cloud.curve_detail,
            apart_m,
            *samples,
            self._min_length_m,
            self._max_length_m,
            self._per_node,
            self._config.beta,
            self._evidence,
            cloud.lens,
            cloud.stride,
            self._evaluation.connection_reach_m,
            self._evaluation.connection_step_m,
            cloud.edge_m,
            cloud.edge_at,
            self._near,
            self._square,
            self._chance,
            self._top,
            self._seen,
            self._gap,
            self._other,
            self._pair,
            self._length_m,
            self._degrees,
            self._node_place,
            network.node_m,
            network.node_curve,
            network.node_weight,
            network.linked,
        )
