"""Pose graphs of a robot that drives along the streets of a square town."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import PoseGraphConfig
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.se2_arrays import between, compose

FloatArray = NDArray[np.float64]
TownMaker = Callable[[int], PoseGraph]
_SIGMA = np.array([0.02, 0.02, math.radians(0.5)])
_INFORMATION = np.diag(1.0 / _SIGMA**2)


def _streets(count: int, rng: np.random.Generator) -> FloatArray:
    """(count, 3): steps of 1 m, a turn at every fourth, never out of town. After M3500 (Olson et al. 2006)."""
    half_m = math.sqrt(count) / 2.4
    way = [np.zeros(3)]
    for k in range(1, count):
        pose = way[-1].copy()
        if k % 4 == 0:
            pose[2] += rng.choice([-1, 0, 0, 1]) * math.pi / 2
        while np.abs(compose(pose, np.array([1.0, 0.0, 0.0]))[:2]).max() > half_m:
            pose[2] += math.pi / 2
        way.append(compose(pose, np.array([1.0, 0.0, 0.0])))
    return np.array(way)


@pytest.fixture
def town() -> TownMaker:
    """A graph of so many nodes with a closure wherever the robot comes by again, always the same."""

    def make(count: int) -> PoseGraph:
        rng = np.random.default_rng(0)
        truth = _streets(count, rng)
        graph = PoseGraph(PoseGraphConfig())
        graph.add_node(truth[0])
        for k in range(1, count):
            step = between(truth[k - 1], truth[k]) + rng.normal(0, _SIGMA)
            graph.add_node(compose(graph.poses[k - 1], step))
            graph.add_edge(k - 1, k, step, _INFORMATION, 1.0, robust=False)
        last_at: dict[tuple[int, int], int] = {}
        for k, (x, y) in enumerate(np.round(truth[:, :2]).astype(int).tolist()):
            before = last_at.get((x, y), k)
            if k - before > 10 and rng.random() < 0.56:
                closing = between(truth[before], truth[k]) + rng.normal(0, _SIGMA)
                graph.add_edge(before, k, closing, _INFORMATION, 0.5, robust=True)
            last_at[x, y] = k
        return graph

    return make
