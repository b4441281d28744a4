from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from station_gui.mapping.slam2d.config import GraphSlamConfig
from station_gui.mapping.slam2d.graph.loop_closure import LoopCloser
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.matching.scan_matcher import ScanMatcher
from station_gui.mapping.slam2d.share import Share

TownMaker = Callable[[int], PoseGraph]


def test_near_nodes_come_in_the_order_of_their_distance(town: TownMaker) -> None:
    graph = town(800)
    lengths = csr_array((graph.ways.length_m, (graph.ends[:, 0], graph.ends[:, 1])), shape=(800, 800))
    expected = dijkstra(lengths, directed=False, indices=[123])[0]

    near, way_m = graph.ways.near(123, 20.0, 10_000)

    assert sorted(near.tolist()) == np.flatnonzero(expected <= 20.0).tolist()
    np.testing.assert_allclose(way_m, expected[near])
    assert (np.diff(way_m) >= 0).all()
    assert graph.ways.near(123, 20.0, 30)[0].tolist() == near[:30].tolist()


def test_ways_that_are_measured_in_shares_are_the_shortest_and_blind_to_newer_nodes(town: TownMaker) -> None:
    graph, share = town(800), Share()
    lengths = csr_array((graph.ways.length_m, (graph.ends[:, 0], graph.ends[:, 1])), shape=(800, 800))
    wanted = np.arange(0, 700, 13, dtype=np.int32)
    expected = dijkstra(lengths, directed=False, indices=[799])[0][wanted]
    found = np.empty(len(wanted))

    task = graph.ways.measure(share, 799, wanted, 60.0, found)
    share.run(task, 20)
    graph.ways.add_node()
    graph.ways.add_edge(799, 800, 0.01)
    graph.ways.add_edge(800, 0, 0.01)
    graph.ways.near(5, 10.0, 100)
    while not share.run(task, 20):
        pass

    np.testing.assert_allclose(found, np.where(expected <= 60.0, expected, np.inf))


def test_looking_for_candidates_takes_bounded_shares_however_large_the_graph(town: TownMaker) -> None:
    config = GraphSlamConfig()
    matcher = ScanMatcher(config.match, config.local_map.reach_cells, config.local_map.cell_m)
    closer = LoopCloser(config.loops, config.local_map, matcher)
    for nodes in (500, 8000):
        graph = town(nodes)
        works, ended = [], False
        task = closer.candidates(graph, nodes - 1)
        while not ended:
            before = closer.share.done
            ended = closer.share.run(task, 500)
            works.append(closer.share.done - before)
        assert max(works) < 1100
