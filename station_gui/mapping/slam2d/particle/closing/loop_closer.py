"""Closes the loops of the particles' common way."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.slam2d.closures.closure import Closure
from station_gui.mapping.slam2d.closures.jury import Jury
from station_gui.mapping.slam2d.config import LocalMapConfig, LoopConfig, MatchConfig
from station_gui.mapping.slam2d.matching.scan_matcher import ScanMatcher
from station_gui.mapping.slam2d.particle.ancestry import Ancestry
from station_gui.mapping.slam2d.particle.blocks.block_maps import BlockMaps
from station_gui.mapping.slam2d.particle.closing.config import BendConfig
from station_gui.mapping.slam2d.particle.closing.course import Course, closure_chi2
from station_gui.mapping.slam2d.particle.closing.loop_finder import LoopFinder, Way
from station_gui.mapping.slam2d.particle.closing.path_bender import Bent, PathBender, Trunk
from station_gui.mapping.slam2d.se2_arrays import between

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ClosingConfig:
    match: MatchConfig = field(default_factory=MatchConfig)
    loops: LoopConfig = field(default_factory=LoopConfig)
    places: LocalMapConfig = field(default_factory=LocalMapConfig)
    bend: BendConfig = field(default_factory=BendConfig)


class LoopCloser:
    """Looks for loops on the best particle's path and proposes moves; the filter makes them."""

    def __init__(self, config: ClosingConfig, maps: BlockMaps) -> None:
        self._config = config
        self._maps = maps
        self._course = Course(config.bend)
        matcher = ScanMatcher(config.match, config.places.reach_cells, maps.cell_m)
        self._finder = LoopFinder(config.loops, config.places, matcher, maps.cell_m)
        self._jury = Jury(config.loops)
        self._bender = PathBender(config.bend, maps)
        self._waiting: list[Closure] = []  # believed, but the path has to be bent to them
        self._urgent = False
        self._looking = False
        self._bent_nodes = 0  # when the path was bent last

    @property
    def course(self) -> Course:
        return self._course

    def closures(self) -> NDArray[np.int32]:
        """(L, 2): steps that a closure joined."""
        pairs = [(closure.old, closure.new) for closure in self._course.closures]
        nodes = np.array(pairs, np.int64).reshape(-1, 2)
        return self._course.first_steps[nodes].astype(np.int32) if len(nodes) else np.zeros((0, 2), np.int32)

    @property
    def busy(self) -> bool:
        return self._finder.busy or self._bender.busy or bool(self._waiting)

    def add_step(self, way: Way, information: FloatArray, misfit: float) -> None:
        """The newest step of the way; `information`: (3, 3) of its match, `misfit`: share that did not fit since."""
        course = self._course
        motion = between(way.path[-2], way.path[-1]) if len(way.path) > 1 else np.zeros(3)
        heading = float(way.path[course.first_steps[-1], 2]) if course.nodes else 0.0
        if course.add_step(len(way.path) - 1, motion, information, heading, misfit):
            if course.nodes > 1:
                self._finder.look_from(way, course.nodes - 2)
            self._maps.join(course.joined(self._config.bend.reach_m))

    def look_from_last(self, way: Way) -> None:
        """No further node comes: the last one is as complete as it will be."""
        if self._course.nodes > 1:
            self._finder.look_from(way, self._course.nodes - 1)

    def work(self, way: Way, ancestry: Ancestry, end: int, last: bool) -> Bent | None:
        """A bounded share of what there is to do; `end`: of the way in the ancestry; `last`: no scan comes any more."""
        self._looking = self._finder.busy and not (self._looking and self._bender.busy)  # in turns with bending
        if self._looking:
            closure = self._finder.work(way)
            if closure is not None:
                self._judge(closure, way.node_poses())
            return None
        if self._bender.busy:
            return self._bender.work(way)
        due = self._course.nodes - self._bent_nodes >= self._config.bend.bend_nodes
        if self._waiting and (self._urgent or due or (last and not self._finder.busy)):
            self._begin(way, ancestry, end)
        return None

    def failed(self, bent: Bent) -> None:
        """No particle is left that the move was made for."""
        self._maps.clear_spare()
        self._waiting.extend(bent.closures)

    def made(self, bent: Bent) -> None:
        """The particles have moved."""
        self._course.closures.extend(bent.closures)
        self._maps.join(self._course.joined(self._config.bend.reach_m))

    def _judge(self, closure: Closure, poses: FloatArray) -> None:
        believed = self._jury.judge(closure, poses)
        self._urgent = self._urgent or len(believed) > 1
        for one in believed:
            if one.witness:  # it has confirmed another; a path that is bent to it as well is bent too sharply
                continue
            agrees = closure_chi2(one, poses) <= self._config.bend.bend_chi2
            (self._course.closures if agrees else self._waiting).append(one)

    def _begin(self, way: Way, ancestry: Ancestry, end: int) -> None:
        steps = max(1, len(way.path) - self._config.bend.tail_steps)
        trunk = Trunk(steps, ancestry.motions(end), ancestry.name_of_ancestor(end, steps - 1))
        self._bender.begin(way, self._waiting, trunk)
        self._waiting, self._urgent, self._bent_nodes = [], False, self._course.nodes
