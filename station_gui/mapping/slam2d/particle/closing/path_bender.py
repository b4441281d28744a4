"""Bends the particles' paths so that loops close: a move of the whole path within the filter.

Resample-move (Gilks and Berzuini 2001): a path that came back far from where it left is moved, as a whole, to the
most likely one given what tracking measured and the loops that were found. The map that follows is drawn into a spare
place, a bounded share of it with every scan, while the particles go on in their old ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.closures.closure import Closure
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.particle.blocks.block_maps import BlockMaps
from station_gui.mapping.slam2d.particle.closing.config import BendConfig
from station_gui.mapping.slam2d.particle.closing.course import closure_chi2
from station_gui.mapping.slam2d.particle.closing.loop_finder import Way
from station_gui.mapping.slam2d.se2_arrays import compose_all

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Trunk:
    """What the best particle shares with those that parted from it late: the first `steps`, `motions` (K, 3) and
    the name of the last one's node in the ancestry."""

    steps: int
    motions: FloatArray
    name: int


@dataclass(frozen=True, slots=True, eq=False)
class Bent:
    """A path that is moved, `corrections` (nodes, 3), map frame; its map is drawn up to the end of the trunk.

    `joined`: (nodes,), which are near to the robot along the graph with the new closures.
    """

    closures: list[Closure]
    corrections: FloatArray
    trunk: Trunk
    joined: NDArray[np.bool_]

    def of_steps(self, node_of_steps: NDArray[np.int64]) -> FloatArray:
        """(steps, 3): what each step moves by; nodes that came meanwhile go with the last one that took part."""
        return np.asarray(self.corrections[np.minimum(node_of_steps, len(self.corrections) - 1)])


@dataclass(slots=True, eq=False)
class _Drawing:
    """`plan`: steps in the order they are drawn at `poses`, (steps, 3); first `apart` that do not yet count."""

    bent: Bent
    plan: NDArray[np.int64]
    poses: FloatArray
    apart: int
    drawn: int = 0


class PathBender:
    """One move at a time: optimised by one linear system a scan, then drawn."""

    def __init__(self, config: BendConfig, maps: BlockMaps) -> None:
        self._config = config
        self._maps = maps
        self._graph: PoseGraph | None = None
        self._before = np.zeros((0, 3))
        self._closures: list[Closure] = []
        self._trunk: Trunk | None = None
        self._drawing: _Drawing | None = None

    @property
    def busy(self) -> bool:
        return self._graph is not None or self._drawing is not None

    def begin(self, way: Way, closures: list[Closure], trunk: Trunk) -> None:
        """`closures`: those that are new."""
        self._before = way.node_poses()
        self._closures = closures
        self._trunk = trunk
        self._graph = way.course.graph(self._before, trunk.motions, tuple(closures))
        self._graph.begin_optimisation()

    def work(self, way: Way) -> Bent | None:
        """A bounded share; the move once the particles may make it."""
        if self._graph is not None:
            if self._graph.step():
                self._drawing = self._settled(way, self._graph.poses.copy())
                self._graph = None
            return None
        drawing = self._drawing
        if drawing is None or not self._draw(way, drawing):
            return None
        self._drawing = None
        return drawing.bent

    def _settled(self, way: Way, poses: FloatArray) -> _Drawing | None:
        """None where the path cannot be bent to any of the new closures: they are dropped."""
        held = [closure for closure in self._closures if closure_chi2(closure, poses) <= self._config.held_chi2]
        if not held or self._trunk is None:
            return None
        joined = way.course.joined(self._config.reach_m, tuple(held))
        bent = Bent(held, _corrections(self._before, poses), self._trunk, joined)
        nodes = way.course.node_of_steps(self._trunk.steps)
        near = joined[nodes]
        plan = np.concatenate((np.flatnonzero(~near), np.flatnonzero(near)))
        bent_path = compose_all(bent.of_steps(nodes), way.path[: self._trunk.steps])
        return _Drawing(bent, plan, bent_path, int(np.count_nonzero(~near)))

    def _draw(self, way: Way, drawing: _Drawing) -> bool:
        """Some scans more; those near to the robot come last, and begin places afresh that far ones hold."""
        last = min(drawing.drawn + self._config.draws_per_scan, len(drawing.plan))
        for number in range(drawing.drawn, last):
            step = int(drawing.plan[number])
            if not way.in_map[step]:
                continue
            joined = drawing.bent.joined if number >= drawing.apart else None
            self._maps.draw_spare(way.scans[step].lines(), drawing.poses[step], way.scans[step].node, joined)
        drawing.drawn = last
        return last == len(drawing.plan)


def _corrections(before: FloatArray, after: FloatArray) -> FloatArray:
    """after @ inv(before) row by row."""
    turn = after[:, 2] - before[:, 2]
    c, s = np.cos(turn), np.sin(turn)
    x = after[:, 0] - (c * before[:, 0] - s * before[:, 1])
    y = after[:, 1] - (s * before[:, 0] + c * before[:, 1])
    return np.column_stack((x, y, turn))
