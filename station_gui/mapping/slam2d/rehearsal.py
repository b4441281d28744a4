"""Runs every kernel of graph SLAM once, so that neither compiling nor loading one holds up a scan."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from station_gui.mapping.slam2d.config import GraphSlamConfig, LocalMapConfig
from station_gui.mapping.slam2d.graph.loop_closure import LoopCloser
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.graph.sight.sight import Horizon, View, seen_through_share
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, ScanMatcher, to_lines
from station_gui.mapping.slam2d.search.branch_and_bound import build_pyramid, search
from station_gui.mapping.slam2d.share import at_once

_NODES = 20
_STEP_M = 1.0


@cache
def rehearse() -> None:
    """Once in the life of the process."""
    config = GraphSlamConfig()
    window = LocalMapConfig(size_m=6.4)
    matcher = ScanMatcher(config.match, window.reach_cells, window.cell_m)
    room = to_lines(_round_room(), np.zeros(2), config.normals)
    local_map = LocalMap(window.size_m, window.cell_m, window.reach_cells, window.max_surfels, window.max_count)
    local_map.insert(room.points_m, room.normals, np.zeros(3))
    local_map.insert(room.points_m.astype(np.float32), room.normals.astype(np.float32), np.zeros(3))
    elsewhere = LineScan(room.points_m + 0.5, room.normals)
    matcher.match(elsewhere, local_map, np.zeros(3), np.ones(3))
    graph, by_node = _there_and_back(room)
    closer = LoopCloser(config.loops, window, matcher)
    closer.share.begin(1 << 60)
    for _ in closer.look(graph, by_node, _NODES - 1):
        break
    pyramid = build_pyramid(*matcher.likelihood(local_map, config.loops.cell_m), config.loops.levels)
    search(room.points_m, pyramid, np.zeros(3), 0.5, 0.1, config.loops.min_score, config.loops.max_branches)
    view = View(np.zeros(3), Horizon(by_node[0][0]))
    at_once(lambda share: seen_through_share(room.points_m, np.zeros(3), [view], 0.1, 0.0, share))
    graph.add_edge(0, _NODES - 1, np.zeros(3), np.eye(3), _STEP_M, robust=True)
    graph.last_chi2(1)
    graph.optimise()
    at_once(lambda share: local_map.clear_slowly(0.0, 0.0, share))


def _round_room() -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    angle = np.linspace(0.0, math.tau, 60, endpoint=False)
    return np.column_stack((2.5 * np.cos(angle), 2.0 * np.sin(angle)))


def _there_and_back(room: LineScan) -> tuple[PoseGraph, list[list[Keyframe]]]:
    """A graph that comes back to its beginning without a closure yet."""
    config = GraphSlamConfig()
    graph = PoseGraph(config.pose_graph)
    by_node = []
    for k in range(_NODES):
        x_m = _STEP_M * min(k, _NODES - 1 - k)
        graph.add_node(np.array([x_m, 0.0, 0.0]))
        points, normals = room.points_m.astype(np.float32), room.normals.astype(np.float32)
        by_node.append([Keyframe(0.0, k, np.zeros(3), points, normals, np.zeros(2))])
        if k:
            step = graph.poses[k] - graph.poses[k - 1]
            graph.add_edge(k - 1, k, step, np.eye(3), _STEP_M, robust=False)
    graph.ways.near(0, 1.0, _NODES)
    return graph, by_node
