"""Simplified FastGNG (steps 2-7), against a plain twin and on edges made by hand."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

from robot_app.perception.config import LearningConfig, RefineConfig
from robot_app.perception.learner import Network
from robot_app.perception.learners.fast._kernels import node_probability
from robot_app.perception.learners.simplified import _kernels as kernels
from robot_app.perception.simplified_fast_gng import SimplifiedFastGng

LENS = np.array([457.0, 457.0, 320.0, 240.0])
STRIDE = 4
MOST = 1500


def cloud_of(points_m: np.ndarray, weight: np.ndarray | None = None, curve: np.ndarray | None = None):
    """What a learner looks at of an EdgeCloud: every point is a sample and an edge point."""
    count = len(points_m)
    sample_m = np.zeros((MOST, 3), np.float32)
    sample_weight, sample_curve = np.zeros(MOST, np.float32), np.zeros(MOST, np.int32)
    sample_m[:count] = points_m
    sample_weight[:count] = 1.0 if weight is None else weight
    sample_curve[:count] = 0 if curve is None else curve
    edge_at, detail = np.full((120, 160), -1, np.int32), np.ones(MOST, np.float32)
    columns = ((sample_m[:count, 0] / sample_m[:count, 2] * LENS[0] + LENS[2]) / STRIDE).astype(int)
    rows = ((sample_m[:count, 1] / sample_m[:count, 2] * LENS[1] + LENS[3]) / STRIDE).astype(int)
    edge_at[rows, columns] = np.arange(count)
    return SimpleNamespace(
        sample_m=sample_m, sample_weight=sample_weight, sample_curve=sample_curve, samples=count,
        lens=LENS, stride=STRIDE, edge_m=sample_m, edge_at=edge_at, curve_detail=detail,
    )  # fmt: skip


def polyline(*corners_m: tuple[float, float, float], spacing_m: float = 0.01) -> np.ndarray:
    pieces = [np.linspace(a, b, 1 + round(math.dist(a, b) / spacing_m))[:-1] for a, b in itertools.pairwise(corners_m)]
    return np.concatenate([*pieces, [corners_m[-1]]])


def learned(cloud, evidence: bool, config: LearningConfig | None = None) -> Network:
    config = config or LearningConfig()
    network = Network(config.max_nodes)
    SimplifiedFastGng(config, RefineConfig(), MOST, evidence).learn(cloud, network)
    return network


def links_of(network: Network) -> set[tuple[int, int]]:
    return {(int(a), int(b)) for a, b in network.connections()}


class Twin:
    """Steps 2-7 as they read, one point after the other, with dictionaries and sets."""

    def __init__(self, points: np.ndarray, weight: np.ndarray, config: LearningConfig) -> None:
        self.points, self.weight, self.config = points.astype(np.float32).astype(float), weight, config
        self.nodes: list[int] = []  # the sample of each
        self.links: set[frozenset[int]] = set()

    def gap(self, a: int, b: int) -> float:
        return math.dist(self.points[a], self.points[b])

    def chance(self, i: int, low: float, high: float) -> float:
        """Equation 12."""
        gap = min((self.gap(i, node) for node in self.nodes), default=1e9)
        if gap < low:
            return 0.0
        return self.weight[i] * (1.0 if gap <= high else math.tanh(self.config.beta * high / gap))

    def add(self, v: int) -> None:
        """Equations 18-22."""
        near = sorted(self.nodes, key=lambda node: self.gap(node, v))[:2]
        self.nodes.append(v)
        if near:
            self.links.add(frozenset((near[0], v)))
        if len(near) < 2:
            return
        s1, s2 = near
        if self.gap(s1, v) < self.gap(s1, s2) > self.gap(s2, v):
            self.links.add(frozenset((s2, v)))
            self.links.discard(frozenset((s1, s2)))
        else:
            self.links.add(frozenset((s1, s2)))

    def limit(self) -> None:
        """Steps 6 and 7."""
        while True:
            degree = {node: sum(node in link for link in self.links) for node in self.nodes}
            crowded = [link for link in self.links if max(degree[end] for end in link) > 2]
            if not crowded:
                break
            self.links.remove(max(crowded, key=lambda link: self.gap(*link)))
        self.nodes = [node for node in self.nodes if degree[node] > 0]

    def grow(self) -> None:
        config = self.config
        lengths = zip(config.min_length_m, config.max_length_m, config.samples_per_node, strict=True)
        for phase, (low, high, per_node) in enumerate(lengths):
            for _ in range(math.ceil(len(self.points) / per_node) + (2 if phase == 0 else 0)):
                chances = [self.chance(i, low, high) for i in range(len(self.points))]
                v = int(np.argmax(chances))
                if chances[v] <= 0.0 or len(self.nodes) == config.max_nodes:
                    break
                self.add(v)
            self.limit()


def test_it_grows_the_network_of_its_plain_twin() -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform((-0.6, -0.4, 1.2), (0.6, 0.4, 1.8), (170, 3))
    weight = rng.uniform(0.5, 2.0, len(points)).astype(np.float32)
    config = LearningConfig()
    twin = Twin(points, weight, config)
    twin.grow()
    network = learned(cloud_of(points, weight), evidence=False)
    assert network.nodes == len(twin.nodes) > 20
    assert np.allclose(network.node_m[: network.nodes], twin.points[twin.nodes])
    index = {sample: k for k, sample in enumerate(twin.nodes)}
    assert links_of(network) == {tuple(sorted(index[end] for end in link)) for link in twin.links}


@pytest.mark.parametrize("evidence", [False, True])
def test_no_node_has_more_than_two_connections_and_none_stands_alone(evidence: bool) -> None:
    rng = np.random.default_rng(2)
    points = rng.uniform((-0.6, -0.4, 1.2), (0.6, 0.4, 1.3), (1200, 3))
    network = learned(cloud_of(points), evidence)
    degree = network.linked[: network.nodes, : network.nodes].sum(axis=0)
    assert 1 <= degree.min() <= degree.max() == 2


def test_nodes_are_samples_and_no_nearer_to_each_other_than_the_last_phase_says() -> None:
    points = polyline((-0.5, 0.3, 1.5), (0.5, 0.3, 1.5), (0.5, -0.3, 1.5))
    network = learned(cloud_of(points), evidence=False)
    gap_m = np.linalg.norm(network.node_m[: network.nodes, None] - points[None].astype(np.float32), axis=2).min(axis=1)
    assert gap_m.max() < 1e-6
    between_m = np.linalg.norm(network.node_m[: network.nodes, None] - network.node_m[None, : network.nodes], axis=2)
    assert between_m[np.triu_indices(network.nodes, 1)].min() >= 0.1 - 1e-6


def test_along_a_bent_edge_the_network_is_a_chain_in_order() -> None:
    points = polyline((-0.5, 0.3, 1.5), (0.5, 0.3, 1.5), (0.5, -0.3, 1.5))
    network = learned(cloud_of(points), evidence=True)
    place = [int(np.linalg.norm(points - node, axis=1).argmin()) for node in network.node_m[: network.nodes]]
    order = np.argsort(place)
    assert links_of(network) == {tuple(sorted((int(a), int(b)))) for a, b in itertools.pairwise(order)}


def test_with_evidence_nothing_is_connected_through_free_air() -> None:
    left, right = polyline((-0.3, 0.3, 1.5), (-0.3, -0.3, 1.5)), polyline((0.0, 0.3, 1.5), (0.0, -0.3, 1.5))
    points = np.concatenate((left, right))
    for evidence, apart in ((True, True), (False, False)):
        network = learned(cloud_of(points), evidence)
        ends = network.node_m[network.connections()][:, :, 0]
        assert bool(np.all(ends[:, 0] == ends[:, 1])) is apart


def test_the_heavier_sample_is_taken_and_nodes_go_into_corners() -> None:
    points = polyline((-0.5, 0.3, 1.5), (0.5, 0.3, 1.5), (0.5, -0.3, 1.5))
    weight = np.ones(len(points), np.float32)
    corner = int(np.linalg.norm(points - (0.5, 0.3, 1.5), axis=1).argmin())
    weight[corner] = 5.0
    network = learned(cloud_of(points, weight), evidence=True)
    assert np.linalg.norm(network.node_m[: network.nodes] - points[corner], axis=1).min() < 1e-6


@pytest.mark.parametrize("count", [0, 1, 2, 3, kernels.LANES, kernels.LANES + 1, MOST])
def test_any_number_of_samples_is_taken(count: int) -> None:
    points = np.random.default_rng(count).uniform((-0.6, -0.4, 1.2), (0.6, 0.4, 1.3), (count, 3))
    network = learned(cloud_of(points), evidence=False)
    assert network.nodes <= count
    assert (network.nodes > 0) == (count >= 2)


def test_where_all_samples_are_one_point_there_is_no_connection() -> None:
    assert learned(cloud_of(np.full((50, 3), (0.1, 0.1, 1.0))), evidence=True).nodes == 0


def test_nodes_are_bounded() -> None:
    points = np.random.default_rng(0).uniform((-0.9, -0.6, 1.3), (0.9, 0.6, 2.3), (MOST, 3))
    network = learned(cloud_of(points), evidence=False, config=LearningConfig(max_nodes=60))
    assert 30 < network.nodes <= 60


@pytest.mark.parametrize("distance_m", [0.05, 0.0999, 0.1, 0.15, 0.175, 0.2, 0.5, 3.0, 1e9])
def test_the_chance_of_a_sample_is_equation_12_times_its_weight(distance_m: float) -> None:
    near, weight = np.full((1, 32), distance_m**2, np.float32), np.full((1, 32), 3.0, np.float32)
    chance = np.zeros((1, 32), np.float32)
    kernels.node_chances(near, weight, 0, 0.1, 0.175, 1.55, chance)
    expected = 0.0 if distance_m < 0.1 else 1.0 if distance_m <= 0.175 else math.tanh(1.55 * 0.175 / distance_m)
    assert node_probability(distance_m, 0.1, 0.175, 1.55) == pytest.approx(expected, rel=1e-12)
    assert chance == pytest.approx(3.0 * expected, rel=1e-6, abs=1e-12)


def test_the_longest_connection_of_a_crowded_node_goes_first() -> None:
    node_m = np.array([(0, 0, 1), (0.1, 0, 1), (-0.2, 0, 1), (0, 0.3, 1)], np.float32)
    linked = np.zeros((4, 4), np.uint8)
    linked[0, 1:] = linked[1:, 0] = 1
    room = np.zeros((16, 2), np.int32), np.zeros(16, np.float32), linked.sum(axis=0, dtype=np.int32)
    kernels.limit_degree(node_m, linked, 4, 2, *room)
    assert linked[0].tolist() == [0, 1, 1, 0]


def test_hundreds_of_curves_are_learned_apart_and_in_their_own_shapes() -> None:
    rng = np.random.default_rng(1)
    count, detail = 700, 4.0
    sample_m = rng.uniform((-8.0, -5.0, 0.5), (8.0, 5.0, 9.0), (2 * count, 3)).astype(np.float32)
    curve = np.repeat(np.arange(count, dtype=np.int32), 2)
    blocks = -(-2 * count // kernels.LANES)
    place, box = np.zeros((blocks, 3, kernels.LANES), np.float32), np.zeros((6, blocks), np.float32)
    weight, heaviest = np.zeros((blocks, kernels.LANES), np.float32), np.zeros(blocks, np.float32)
    kernels.lay_out_samples(
        sample_m, np.ones(2 * count, np.float32), curve, 2 * count, np.full(count, detail, np.float32), 128.0,
        place, box, weight, heaviest,
    )  # fmt: skip
    laid_m = place.transpose(0, 2, 1).reshape(-1, 3)[: 2 * count].reshape(count, 2, 3).astype(float)
    ways_m = np.diff(sample_m.reshape(count, 2, 3).astype(float), axis=1)[:, 0]
    np.testing.assert_allclose((laid_m[:, 1] - laid_m[:, 0]) / detail, ways_m, atol=1e-4)
    middles_m = laid_m.mean(axis=1)
    gap_m = np.abs(middles_m[:, None] - middles_m[None]).max(axis=2) + 1e3 * np.eye(count)
    assert gap_m.min() > 50.0
