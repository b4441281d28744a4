"""The path of one particle into a saved map and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.slam2d.config import LocalMapConfig, PoseGraphConfig
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.particle.closing.course import Course
from station_gui.mapping.slam2d.se2_arrays import between, compose, compose_all

FloatArray = NDArray[np.float64]
Break = Literal["found", "lost", "apart"]

_EDGES = PoseGraphConfig()  # what edges are worth to graph SLAM, which may go on from the map
_APART_M = 2 * LocalMapConfig().graph_reach_m  # the length of an edge beyond which its local map does not look
_CLOSURE_LENGTH_M = 0.5
_LEAST_EDGE_M = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """What holds a path together.

    `given`: the map that its first steps are; `breaks`: steps that tracking does not lead to, because the robot was
    lost, or was found there by somebody else; `course`: the nodes and closures of the rest; `pieces`: (K,) of the
    steps.
    """

    given: SavedMap | None
    breaks: Mapping[int, Break]
    course: Course
    pieces: NDArray[np.int32]


def to_saved(steps: Sequence[Keyframe], poses: FloatArray, joints: Joints) -> SavedMap:
    """`poses`: (K, 3) of the steps, map frame. Scans that did not fit have no points and are left out."""
    if not steps:
        raise MappingError("there is no map to save yet")
    known = len(joints.given.keyframes) if joints.given is not None else 0
    if joints.given is not None and known == len(steps):
        return joints.given
    return _Graph(joints, poses, known).saved_map(steps)


class _Graph:
    """Nodes at the steps where the course has some, and where the path is broken."""

    def __init__(self, joints: Joints, poses: FloatArray, known: int) -> None:
        """`known`: how many steps the given map is."""
        self._joints = joints
        self._poses = poses
        self._known = known
        course = joints.course
        self._course_node_at = {step: n for n, step in enumerate(course.first_steps.tolist()) if step >= known}
        self._first_steps = sorted({known, *self._course_node_at, *(step for step in joints.breaks if step >= known)})
        self._nodes = np.vstack((self._given_nodes(), poses[self._first_steps]))
        self._first_node = len(self._nodes) - len(self._first_steps)
        self._ends: list[tuple[int, int]] = []
        self._measured: list[FloatArray] = []
        self._information: list[FloatArray] = []
        self._lengths_m: list[float] = []
        self._robust: list[bool] = []
        for k, step in enumerate(self._first_steps):
            self._join_to_older(self._first_node + k, step)
        self._add_closures()

    def saved_map(self, steps: Sequence[Keyframe]) -> SavedMap:
        of_step = np.searchsorted(self._first_steps, np.arange(len(steps)), side="right") - 1 + self._first_node
        keyframes = [
            replace(steps[k], node=int(of_step[k]), in_node=between(self._nodes[of_step[k]], self._poses[k]))
            for k in range(self._known, len(steps))
            if len(steps[k].points_m)
        ]
        own = SavedMap(
            nodes=self._nodes,
            ends=np.array(self._ends, np.int32).reshape(-1, 2),
            measured=np.array(self._measured).reshape(-1, 3),
            information=np.array(self._information).reshape(-1, 3, 3),
            robust=np.array(self._robust, np.bool_),
            length_m=np.array(self._lengths_m, np.float64),
            keyframes=tuple(keyframes),
            pieces=self._pieces(),
        )
        given = self._joints.given
        if given is None:
            return own
        return SavedMap(
            nodes=own.nodes,
            ends=np.concatenate((given.ends, own.ends)),
            measured=np.concatenate((given.measured, own.measured)),
            information=np.concatenate((given.information, own.information)),
            robust=np.concatenate((given.robust, own.robust)),
            length_m=np.concatenate((given.length_m, own.length_m)),
            keyframes=(*given.keyframes, *own.keyframes),
            pieces=own.pieces,
        )

    def _pieces(self) -> NDArray[np.int32]:
        """(N,)"""
        given, of_steps = self._joints.given, self._joints.pieces[self._first_steps]
        return of_steps if given is None else np.concatenate((given.pieces, of_steps))

    def _given_nodes(self) -> FloatArray:
        """(N, 3): where the first step has gone the whole given map went."""
        given = self._joints.given
        if given is None:
            return np.zeros((0, 3))
        first = given.keyframes[0]
        was = compose(given.nodes[first.node], first.in_node)
        now_from_given = compose(self._poses[0], between(was, np.zeros(3)))
        return compose_all(np.tile(now_from_given, (len(given.nodes), 1)), given.nodes)

    def _join_to_older(self, node: int, step: int) -> None:
        broken = self._joints.breaks.get(step)
        if node == 0:
            return
        if broken == "found":
            away_m = np.hypot(*(self._nodes[:node, :2] - self._nodes[node, :2]).T)
            near = int(np.argmin(away_m))
            self._add_edge(near, node, _weights(_EDGES.found_shift_sigma_m, _EDGES.found_turn_sigma_rad))
        elif broken == "apart":
            information = _weights(_EDGES.unknown_shift_sigma_m, _EDGES.unknown_turn_sigma_rad)
            self._add_edge(node - 1, node, information, _APART_M)
        elif broken == "lost":
            information = _weights(_EDGES.lost_shift_sigma_m, _EDGES.lost_turn_sigma_rad)
            self._add_edge(node - 1, node, information, _APART_M)
        else:
            self._add_edge(node - 1, node, self._tracked_information(step))

    def _tracked_information(self, step: int) -> FloatArray:
        """(3, 3), in the frame of the node before."""
        course_node = self._course_node_at.get(step)
        if course_node is None:
            return _weights(_EDGES.shift_sigma_m, _EDGES.turn_sigma_rad)
        return self._joints.course.information_to(course_node)

    def _add_closures(self) -> None:
        course = self._joints.course
        first = course.first_steps
        for closure in course.closures:
            if closure.old < course.given:
                continue
            old, new = (
                self._first_node + int(np.searchsorted(self._first_steps, first[node]))
                for node in (closure.old, closure.new)
            )
            self._ends.append((old, new))
            self._measured.append(closure.measured)
            self._information.append(closure.information)
            self._lengths_m.append(_CLOSURE_LENGTH_M)
            self._robust.append(True)

    def _add_edge(self, old: int, new: int, information: FloatArray, length_m: float | None = None) -> None:
        measured = between(self._nodes[old], self._nodes[new])
        self._ends.append((old, new))
        self._measured.append(measured)
        self._information.append(information)
        self._lengths_m.append(length_m or max(float(np.hypot(measured[0], measured[1])), _LEAST_EDGE_M))
        self._robust.append(False)


def _weights(shift_sigma_m: float, turn_sigma_rad: float) -> FloatArray:
    """(3, 3)"""
    return np.diag(1.0 / np.square([shift_sigma_m, shift_sigma_m, turn_sigma_rad]))


def steps_of(saved: SavedMap) -> tuple[list[Keyframe], FloatArray]:
    """Every keyframe as a step of its own, and their poses, (K, 3), map frame."""
    in_node = np.array([keyframe.in_node for keyframe in saved.keyframes])
    poses = compose_all(saved.nodes[saved.keyframe_nodes()], in_node)
    steps = [
        Keyframe(keyframe.stamp_s, k, np.zeros(3), keyframe.points_m, keyframe.normals, keyframe.scanner_m)
        for k, keyframe in enumerate(saved.keyframes)
    ]
    return steps, poses
