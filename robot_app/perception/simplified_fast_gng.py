"""Simplified FastGNG: grows a network over the edge points (paper 1, section 3.2, steps 2-7)."""

from __future__ import annotations

import numpy as np

from robot_app.perception.config import LearningConfig, RefineConfig
from robot_app.perception.learner import Network
from robot_app.perception.learners.simplified import _kernels as kernels
from robot_app.perception.point_cloud import EdgeCloud

_APART_M = 128.0  # curves are learned so far from each other: no curve is as wide (`EdgeConfig` sees to that)


class SimplifiedFastGng:
    """The learner of steps 2-7.

    With `evidence`, as the extraction has it, each curve is learned by itself: a node keeps away those of its own
    curve only, small curves are drawn finer (`curve_detail`), a connection is made only where edge points lie under it,
    which the paper asks after learning (3.2.5), and nodes beside a corner move into it. Without, for table 2, all
    samples are learned together with the lengths of table 3 and the steps that the paper prints; two things differ from
    these in either case: the sample of the highest P_node times weight is taken where the paper draws one at random,
    and s1 and s2 are the nearest nodes, where eqs 13 and 18 say i in A.
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
        self._place = np.zeros((blocks, 3, kernels.LANES), np.float32)
        self._box = np.zeros((6, blocks), np.float32)
        self._weight, self._near, self._chance = np.zeros((3, *shape), np.float32)
        self._heaviest, self._far, self._top = np.zeros((3, blocks), np.float32)
        self._reached, self._hit, self._stale = np.zeros((3, blocks), np.uint8)
        self._square = np.zeros(config.max_nodes, np.float32)
        self._gap, self._other = np.zeros(kernels.CANDIDATES, np.float32), np.zeros(kernels.CANDIDATES, np.int32)
        self._pair = np.zeros((4 * config.max_nodes, 2), np.int32)
        self._length_m = np.zeros(4 * config.max_nodes, np.float32)
        self._degrees, self._node_sample = np.zeros((2, config.max_nodes), np.int32)
        self._node_place = np.zeros((config.max_nodes, 3), np.float32)
        self._node_axis = np.zeros((3, config.max_nodes), np.float32)

    def learn(self, cloud: EdgeCloud, network: Network) -> None:
        """Grow `network` anew over the samples of `cloud`."""
        network.nodes = kernels.grow(
            cloud.sample_m,
            cloud.sample_weight,
            cloud.sample_curve,
            cloud.samples,
            cloud.curve_detail,
            _APART_M if self._evidence else 0.0,
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
            self._place,
            self._box,
            self._weight,
            self._heaviest,
            self._near,
            self._far,
            self._chance,
            self._top,
            self._reached,
            self._hit,
            self._stale,
            self._square,
            self._gap,
            self._other,
            self._pair,
            self._length_m,
            self._degrees,
            self._node_sample,
            self._node_place,
            self._node_axis,
            network.node_m,
            network.node_curve,
            network.node_weight,
            network.linked,
        )
