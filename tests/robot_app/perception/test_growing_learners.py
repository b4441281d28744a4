"""Standard GNG and FastGNG: against plain twins that draw the same samples, and what defines them."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from robot_app.perception.config import LearningConfig
from robot_app.perception.fast_gng import FastGng, FastGngConfig
from robot_app.perception.growing_neural_gas import GngConfig, GrowingNeuralGas
from robot_app.perception.learner import Network
from robot_app.perception.learners.graph import _kernels as graph

MASK = 2**64 - 1


def cloud_of(points_m: np.ndarray) -> SimpleNamespace:
    return SimpleNamespace(sample_m=points_m.astype(np.float32), samples=len(points_m))


def square_outline(count: int = 800) -> np.ndarray:
    """(N, 3): a square of 1 m, 1.5 m ahead."""
    t = np.linspace(0.0, 4.0, count, endpoint=False)
    x = np.clip(np.abs((t + 2.0) % 4.0 - 2.0) - 0.5, 0.0, 1.0) - 0.5
    y = np.clip(np.abs((t + 1.0) % 4.0 - 2.0) - 0.5, 0.0, 1.0) - 0.5
    return np.stack((x, y, np.full(count, 1.5)), axis=1)


def generator(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def links_of(network: Network) -> set[frozenset[int]]:
    return {frozenset((int(a), int(b))) for a, b in network.connections()}


class Draws:
    """xorshift64* as Vigna prints it."""

    def __init__(self, state: int) -> None:
        self.state = state

    def below(self, count: int) -> int:
        x = self.state
        x ^= x >> 12
        x ^= (x << 25) & MASK
        x ^= x >> 27
        self.state = x
        return ((x * 2685821657736338717 & MASK) >> 32) * count >> 32


class TwinGraph:
    """Nodes by name, ages of connections in a dictionary."""

    def __init__(self, points: np.ndarray, draws: Draws) -> None:
        self.points, self.draws = points.astype(np.float32), draws
        first = draws.below(len(points))
        second = (first + 1 + draws.below(len(points) - 1)) % len(points)
        self.node = {0: self.points[first].copy(), 1: self.points[second].copy()}
        self.age = {frozenset((0, 1)): 0}
        self.names = 2

    def nearest_two(self, point: np.ndarray) -> list[int]:
        return sorted(self.node, key=lambda a: float(((self.node[a] - point) ** 2).sum()))[:2]

    def beside(self, a: int) -> list[int]:
        return [next(iter(link - {a})) for link in self.age if a in link]

    def make_older(self, a: int) -> None:
        for b in self.beside(a):
            self.age[frozenset((a, b))] += 1

    def new_name(self) -> int:
        self.names += 1
        return self.names - 1


def twin_gng(points: np.ndarray, config: GngConfig, draws: Draws) -> TwinGraph:
    net = TwinGraph(points, draws)
    error = {0: 0.0, 1: 0.0}
    iterations = 0
    while len(net.node) < config.nodes:
        iterations += 1
        point = net.points[draws.below(len(points))]
        s1, s2 = net.nearest_two(point)
        net.make_older(s1)
        error[s1] += float(((net.node[s1] - point) ** 2).sum())
        net.node[s1] += np.float32(config.winner_rate) * (point - net.node[s1])
        for b in net.beside(s1):
            net.node[b] += np.float32(config.neighbour_rate) * (point - net.node[b])
        net.age[frozenset((s1, s2))] = 0
        net.age = {link: age for link, age in net.age.items() if age <= config.max_age}
        for lonely in [a for a in net.node if not net.beside(a)]:
            del net.node[lonely], error[lonely]
        if iterations % config.iterations_per_node == 0:
            q = max(net.node, key=lambda a: error[a])
            f = max(net.beside(q), key=lambda a: error[a])
            r = net.new_name()
            net.node[r] = (net.node[q] + net.node[f]) / 2
            del net.age[frozenset((q, f))]
            net.age |= {frozenset((q, r)): 0, frozenset((f, r)): 0}
            error[q] *= config.alpha
            error[f] *= config.alpha
            error[r] = error[q]
        error = {a: value * config.decay for a, value in error.items()}
    return net


def same_network(network: Network, net: TwinGraph) -> bool:
    """Whether both have the same nodes, to rounding, and the same connections between them."""
    names = list(net.node)
    places = np.array([net.node[name] for name in names])
    gap_m = np.linalg.norm(network.node_m[: network.nodes, None] - places[None], axis=2)
    mate = gap_m.argmin(axis=1)
    if network.nodes != len(names) or sorted(mate.tolist()) != list(range(len(names))):
        return False
    links = {frozenset(names[mate[end]] for end in link) for link in links_of(network)}
    return bool(gap_m.min(axis=1).max() < 1e-4) and links == set(net.age)


def test_gng_learns_what_its_plain_twin_learns() -> None:
    config = GngConfig(nodes=40, max_age=12)
    network = Network(40)
    GrowingNeuralGas(config, generator(3)).learn(cloud_of(square_outline()), network)
    state = int(generator(3).integers(1, 2**63, 1, np.uint64)[0])
    assert same_network(network, twin_gng(square_outline(), config, Draws(state)))


def test_gng_has_a_node_more_each_25_samples_as_in_table_2() -> None:
    learner, network = GrowingNeuralGas(GngConfig(), generator(1)), Network(200)
    learner.learn(cloud_of(square_outline()), network)
    assert network.nodes == 150
    assert 3700 <= learner.iterations <= 4200
    assert 140 <= len(links_of(network)) <= 200  # 159 to 171 in table 2


def test_gng_stops_when_it_loses_as_many_nodes_as_it_makes() -> None:
    learner, network = GrowingNeuralGas(GngConfig(max_age=0, most_iterations=5000), generator(1)), Network(200)
    learner.learn(cloud_of(generator(0).random((500, 3)) + 1.0), network)
    assert learner.iterations == 5000
    assert network.nodes < 150


def learn_batch(net: TwinGraph, wins: dict[int, int], config: FastGngConfig, weight_of) -> int:
    """The sample of the highest weight, -1 for none."""
    best, best_weight = -1, 0.0
    pull = {a: np.zeros(3) for a in net.node}
    share = dict.fromkeys(net.node, 0.0)
    for _ in range(config.batch):
        i = net.draws.below(len(net.points))
        s1, s2 = net.nearest_two(net.points[i])
        wins[s1] += 1
        net.make_older(s1)
        net.age[frozenset((s1, s2))] = 0
        for a, rate in [(s1, 1.0), *((b, config.neighbour_rate) for b in net.beside(s1))]:
            pull[a] += rate * (net.points[i] - net.node[a])
            share[a] += rate
        weight = weight_of(math.dist(net.points[i], net.node[s1]))
        if weight > best_weight:
            best, best_weight = i, weight
    for a in net.node:
        if share[a] > 0:
            net.node[a] += (config.rate * min(share[a], 1.0) / share[a] * pull[a]).astype(np.float32)
    return best


def add_to(net: TwinGraph, v: np.ndarray) -> int:
    """Equations 19-22; the new node's name."""
    s1, s2 = net.nearest_two(v)
    r = net.new_name()
    d12 = math.dist(net.node[s1], net.node[s2])
    net.age[frozenset((s1, r))] = 0
    if math.dist(v, net.node[s1]) < d12 > math.dist(v, net.node[s2]):
        net.age[frozenset((s2, r))] = 0
        net.age.pop(frozenset((s1, s2)), None)
    else:
        net.age[frozenset((s1, s2))] = 0
    net.node[r] = v.copy()
    return r


def delete_from(net: TwinGraph, wins: dict[int, int], max_age: int, max_length_m: float) -> None:
    net.age = {
        link: age
        for link, age in net.age.items()
        if age <= max_age and math.dist(*(net.node[a] for a in link)) <= max_length_m
    }
    net.age = {link: age for link, age in net.age.items() if all(wins[a] > 0 for a in link)}
    net.node = {a: place for a, place in net.node.items() if net.beside(a)}


def twin_fast_gng(points: np.ndarray, shared: LearningConfig, config: FastGngConfig, draws: Draws) -> TwinGraph:
    net = TwinGraph(points, draws)
    for low, high, per_node in zip(shared.min_length_m, shared.max_length_m, shared.samples_per_node, strict=True):

        def weight_of(gap: float, low: float = low, high: float = high) -> float:
            return 0.0 if gap < low else 1.0 if gap <= high else math.tanh(shared.beta * high / gap)

        wins = dict.fromkeys(net.node, 0)
        for _ in range(math.ceil(len(points) / per_node)):
            best = learn_batch(net, wins, config, weight_of)
            if best >= 0 and len(net.node) < shared.max_nodes:
                wins[add_to(net, net.points[best])] = 1
        delete_from(net, wins, config.max_age, 1.5 * high)
    return net


def test_fast_gng_learns_what_its_plain_twin_learns() -> None:
    shared, config = LearningConfig(), FastGngConfig()
    network = Network(shared.max_nodes)
    FastGng(shared, config, generator(4)).learn(cloud_of(square_outline(400)), network)
    state = int(generator(4).integers(1, 2**63, 1, np.uint64)[0])
    assert same_network(network, twin_fast_gng(square_outline(400), shared, config, Draws(state)))


@pytest.mark.parametrize("make", [
    lambda: GrowingNeuralGas(GngConfig(nodes=60), generator(1)),
    lambda: FastGng(LearningConfig(), FastGngConfig(), generator(1)),
])  # fmt: skip
def test_the_network_lies_on_the_samples_and_covers_them(make) -> None:
    points, network = square_outline(1200), Network(200)
    make().learn(cloud_of(points), network)
    gap_m = np.linalg.norm(network.node_m[: network.nodes, None] - points[None], axis=2)
    assert gap_m.min(axis=1).max() < 0.06
    assert gap_m.min(axis=0).max() < 0.25
    assert np.all(network.linked[: network.nodes, : network.nodes].sum(axis=0) > 0)


@pytest.mark.parametrize("make", [
    lambda: GrowingNeuralGas(GngConfig(nodes=60), generator(7)),
    lambda: FastGng(LearningConfig(), FastGngConfig(), generator(7)),
])  # fmt: skip
def test_the_same_generator_gives_the_same_network(make) -> None:
    first, second = Network(200), Network(200)
    for network in (first, second):
        make().learn(cloud_of(square_outline()), network)
    assert np.array_equal(first.node_m, second.node_m)
    assert np.array_equal(first.linked, second.linked)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_a_handful_of_samples_is_no_trouble(count: int) -> None:
    points = square_outline(40)[:count]
    for learner in (
        GrowingNeuralGas(GngConfig(most_iterations=200), generator(1)),
        FastGng(LearningConfig(), FastGngConfig(), generator(1)),
    ):
        network = Network(200)
        learner.learn(cloud_of(np.concatenate((points, np.ones((1, 3))))[: max(count, 0)]), network)
        assert (network.nodes > 0) == (count >= 2)


def test_draws_are_even() -> None:
    state = np.array([12345], np.uint64)
    counts = np.bincount([graph.draw(state, 10) for _ in range(20_000)], minlength=10)
    assert counts.min() > 1800
    assert counts.max() < 2200


def test_a_node_with_too_many_neighbours_loses_its_oldest() -> None:
    most = graph.MOST_NEIGHBOURS
    beside, age = np.zeros((2, most + 2, most), np.int32)
    degree = np.zeros(most + 2, np.int32)
    for b in range(1, most + 1):
        graph.connect(beside, age, degree, 0, b)
        graph.grow_older(beside, age, degree, 0, 1)
    graph.connect(beside, age, degree, 0, most + 1)
    assert degree[0] == most
    assert set(beside[0].tolist()) == set(range(2, most + 2))
    assert degree[1] == 0


def test_impossible_parameters_are_refused() -> None:
    for make in (lambda: GngConfig(nodes=1), lambda: GngConfig(iterations_per_node=0), lambda: FastGngConfig(batch=0)):
        with pytest.raises(ValueError, match="at least"):
            make()
