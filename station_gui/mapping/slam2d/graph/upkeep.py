"""What keeps a pose graph true and can wait: the search for loops, the judgement on them, the optimisation.

It runs in the caller's thread, a bounded share at a time, so that what comes out depends on the scans alone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from station_gui.mapping.slam2d.closures.closure import Closure
from station_gui.mapping.slam2d.closures.jury import Jury
from station_gui.mapping.slam2d.config import LoopConfig, PoseGraphConfig
from station_gui.mapping.slam2d.graph.loop_closure import (
    LoopCloser,
    edge_information,
    without_weak_direction,
)
from station_gui.mapping.slam2d.graph.pose_graph import PoseGraph
from station_gui.mapping.slam2d.keyframes import Keyframe

_MAX_WAITING = 200


class GraphUpkeep:
    """Adds closures to `graph` and optimises it. `by_node`: keyframes of each node, which the caller extends."""

    def __init__(
        self,
        config: PoseGraphConfig,
        loops: LoopConfig,
        closer: LoopCloser,
        graph: PoseGraph,
        by_node: list[list[Keyframe]],
    ) -> None:
        self._config = config
        self._loops = loops
        self._closer = closer
        self._graph = graph
        self._by_node = by_node
        self._waiting: deque[int] = deque(maxlen=_MAX_WAITING)  # nodes to look for loops from
        self._looking: Iterator[Closure | None] | None = None
        self._jury = Jury(loops)
        self._closed: list[tuple[int, int]] = []
        self._bent = False  # closures say that the graph wants optimising
        self._urgent = False
        self._optimised_nodes = 0

    @property
    def closed(self) -> list[tuple[int, int]]:
        """Nodes, older one first, that closures join."""
        return self._closed

    @property
    def busy(self) -> bool:
        """Something is under way or waits."""
        return self._looking is not None or bool(self._waiting) or self._graph.optimising

    def look_for_loops(self, node: int) -> None:
        """Some time soon, from a node whose scans are all there."""
        self._waiting.append(node)

    def step(self) -> bool:
        """A share of a search and one of an optimisation; True when the nodes have moved against each other."""
        if self._looking is not None or self._waiting:
            self._search()
        return self._optimise_a_little()

    def finish(self) -> bool:
        """All that waits, and one more optimisation; True when the nodes have moved."""
        while self._looking is not None or self._waiting:
            self._search()
        self._graph.optimise()
        return self._note_moves()

    def _search(self) -> None:
        share = self._closer.share
        share.begin(self._loops.units_per_step * (1 + len(self._waiting) // self._loops.hurry_nodes))
        while share.left > 0 and (self._looking is not None or self._waiting):
            if self._looking is None:
                self._looking = self._closer.look(self._graph, self._by_node, self._waiting.popleft())
            share.take(1)  # so that nodes with nothing to look for come to an end too
            try:
                closure = next(self._looking)
            except StopIteration:
                self._looking = None
                continue
            if closure is not None:
                self._accept(self._jury.judge(closure, self._graph.poses))

    def _accept(self, closures: list[Closure]) -> None:
        if not closures:
            return
        config = self._config
        for closure in closures:
            held = without_weak_direction(closure.information, self._loops.weak_share)
            information = edge_information(held, 0.0, config.shift_sigma_m, config.turn_sigma_rad)
            length_m = self._loops.closure_length_m
            self._graph.add_edge(closure.old, closure.new, closure.measured, information, length_m, robust=True)
            self._closed.append((closure.old, closure.new))
        if float(self._graph.last_chi2(len(closures)).max()) > config.optimise_chi2:
            self._bent = True
        self._urgent = self._urgent or len(closures) > 1

    def _optimise_a_little(self) -> bool:
        """Small corrections are gathered over a few nodes, a loop that was far open is closed at once."""
        graph = self._graph
        if graph.optimising:
            return graph.step() and self._note_moves()
        due = graph.nodes - self._optimised_nodes >= self._config.optimise_nodes
        if self._urgent or (self._bent and due):
            self._urgent = self._bent = False
            self._optimised_nodes = graph.nodes
            graph.begin_optimisation()
        return False

    def _note_moves(self) -> bool:
        if self._graph.moved_m <= self._config.moved_m:
            return False
        self._closer.forget_places()
        return True
