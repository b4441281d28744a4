"""Keeps the local map round the robot: one window in use, the next one in the making.

The window holds the keyframes near the robot whose way along the graph is short, so that a place seen again is
matched with as soon as a closure has joined it, and one that is not joined yet does not disturb. The next window
is filled a few scans at a time, which keeps the cost of a step constant.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.config import LocalMapConfig
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.matching.local_map import LocalMap
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan
from station_gui.mapping.slam2d.se2_arrays import compose
from station_gui.mapping.slam2d.share import Share, Task

_Piece = tuple[NDArray[np.float64], list[Keyframe]]  # a node in the window's frame, and its scans


class LocalMapBuilder:
    """Two windows that change places."""

    def __init__(self, config: LocalMapConfig) -> None:
        self._config = config
        self._front = self._new_window()
        self._back = self._new_window()
        self._share = Share()
        self._pieces: list[_Piece] = []
        self._centre = (0.0, 0.0)
        self._task: Task | None = None
        self._building = False
        self._next_from_node = np.zeros(3)

    @property
    def current(self) -> LocalMap:
        return self._front

    @property
    def building(self) -> bool:
        return self._building

    @property
    def current_from_node(self) -> NDArray[np.float64]:
        """(3,): the robot's node in the frame of the window that came into use last."""
        return self._next_from_node.copy()

    def insert(self, scan: LineScan, pose: NDArray[np.float64]) -> None:
        """Into the window in use; `pose`: (3,) in its frame."""
        self._front.insert(scan.points_m, scan.normals, pose)

    def begin(self, graph: PoseGraph, by_node: list[list[Keyframe]], node: int, pose: NDArray[np.float64]) -> None:
        """Start the next window round `pose`, the robot in the map frame, who is at `node`."""
        config = self._config
        near, _ = graph.ways.near(node, config.graph_reach_m, config.max_nodes)
        away_m = np.hypot(graph.poses[near, 0] - pose[0], graph.poses[near, 1] - pose[1])
        self._pieces, scans = [], 0
        for k in near[away_m <= config.view_m].tolist():
            keyframes = by_node[k][-config.max_scans :]
            self._pieces.append((graph.poses[k].copy(), keyframes))
            scans += len(keyframes)
            if scans >= config.max_scans:
                break
        self._centre = float(pose[0]), float(pose[1])
        self._next_from_node = graph.poses[node].copy()
        self._task = self._draw()
        self._building = True

    def next_node(self, node_from_new: NDArray[np.float64]) -> None:
        """The robot has come to a new node, (3,) in the frame of the one before."""
        self._next_from_node = compose(self._next_from_node, node_from_new)

    def add_pending(self, keyframe: Keyframe) -> None:
        """A keyframe of the robot's node that came while the next window is in the making."""
        if self._building:
            self._pieces.insert(0, (self._next_from_node.copy(), [keyframe]))

    def step(self, *, spare: bool = False) -> bool:
        """Work a little, half as much to spare the step, on the next window; True when it has just come into use.

        Its frame is the map's as it was when the making began: the graph may have bent since.
        """
        units = self._config.units_per_step // 2 if spare else self._config.units_per_step
        if self._task is None or not self._share.run(self._task, units):
            return False
        self._task = None
        self._front, self._back = self._back, self._front
        self._building = False
        return True

    def _draw(self) -> Task:
        """The nearest along the graph come last, for their hits weigh most; then what came meanwhile."""
        yield from self._back.clear_slowly(*self._centre, self._share)
        while self._pieces:
            window_from_node, keyframes = self._pieces.pop()
            for keyframe in reversed(keyframes):
                if self._share.left <= 0:
                    yield
                pose = compose(window_from_node, keyframe.in_node)
                self._share.take(self._back.insert(keyframe.points_m, keyframe.normals, pose))

    def _new_window(self) -> LocalMap:
        """Each is cleared when its making begins."""
        c = self._config
        return LocalMap(c.size_m, c.cell_m, c.reach_cells, c.max_surfels, c.max_count, cleared=False)
