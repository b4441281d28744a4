"""Keeps the identity of objects from frame to frame, and their outlines for as long as they say nothing new.

Every frame's network is learned anew, so noise moves its nodes a little and joins or parts its clusters. The tracker
compares the new outlines with those that it knows, in the odometry's frame: what lies along a known outline is that
object, and where both cover one another, the known nodes and connections stay as they are, bit for bit. So a still
scene gives the same network again and again, and only what changed needs to be sent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robot_app.perception.config import TrackingConfig
from robot_app.perception.identity import _kernels as kernels
from robot_app.perception.identity.outline import Outline, Outlines, outlines_of, snapped
from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation

FloatArray = NDArray[np.float64]


@dataclass(slots=True, eq=False)
class _Object:
    outline: Outline
    times_seen: int = 1
    frames_unseen: int = 0
    frames_partial: int = 0


class ObjectTracker:
    """What was seen lately, in the order in which it was found; at most `max_objects`, forgotten after `forget_frames`
    without being seen."""

    def __init__(self, config: TrackingConfig) -> None:
        self._config = config
        self._known: list[_Object] = []
        self._joined = Outlines.of([], config)
        self._shown = Outlines.of([], config)
        self._whole: list[int] = []

    def update(self, objects: ObjectNetwork, odom_from_robot: Pose2) -> ObjectNetwork:
        """Take the network of a new frame, which was seen from `odom_from_robot`; returns what is there, robot frame.

        It has no more than `most_nodes`, and an object's nodes follow one another, in the same order as long as it is
        known.
        """
        step_m = self._config.step_m
        new, known = outlines_of(objects, odom_from_robot, self._config), self._joined_known()
        new_on_known, known_on_new = new.shares_near(known, step_m), known.shares_near(new, step_m)
        owners = self._match(np.ascontiguousarray(0.5 * (new_on_known + known_on_new.T)))
        for item in self._known:
            item.frames_unseen += 1
        for k, at in enumerate(owners):
            if at >= 0:
                self._see_again(self._known[at], new.items[k], float(new_on_known[k, at]), float(known_on_new[at, k]))
            else:
                self._known.append(_Object(new.items[k]))
        self._forget()
        return _together(self._visible(), odom_from_robot.inverse())

    def steadied(self, observation: Observation) -> Observation:
        """The observation with what is there; as it is when no image was looked at."""
        if not observation.has_objects:
            return observation
        return replace(observation, objects=self.update(observation.objects, observation.odom_from_robot))

    def warm_up(self) -> None:
        """Compile the kernels; what is known stays as it is."""
        line = ObjectNetwork(np.eye(2, 3, dtype=np.float32), np.array([[0, 1]], np.uint16))
        other = ObjectTracker(self._config)
        other.update(line, Pose2())
        other.update(line, Pose2())

    def _joined_known(self) -> Outlines:
        """What is known; joined anew only when it has changed."""
        outlines = [item.outline for item in self._known]
        if not self._joined.same(outlines):
            self._joined = Outlines.of(outlines, self._config)
        return self._joined

    def _match(self, alike: FloatArray) -> list[int]:
        """For each new outline the known object that it is, the most alike first; -1 for none."""
        owners = np.full(len(alike), -1, np.int32)
        if alike.size:
            kernels.match_most_alike(alike, self._config.match_share, owners)
        found: list[int] = owners.tolist()
        return found

    def _see_again(self, known: _Object, new: Outline, new_on_known: float, known_on_new: float) -> None:
        config = self._config
        known.times_seen += 1
        known.frames_unseen = 0
        known.frames_partial = 0 if known_on_new >= config.keep_share else known.frames_partial + 1
        better = new.distance_m < config.nearer_share * known.outline.distance_m
        if new_on_known >= config.keep_share and known.frames_partial <= config.patience_frames and not better:
            return
        known.outline = new if better else snapped(new, known.outline, config)
        known.frames_partial = 0

    def _forget(self) -> None:
        """What was not seen for long goes, and of too many objects those that were not seen for the longest."""
        config = self._config
        kept = [k for k, item in enumerate(self._known) if item.frames_unseen <= config.forget_frames]
        if len(kept) > config.max_objects:
            kept.sort(key=lambda k: (self._known[k].frames_unseen, k))
            kept = sorted(kept[: config.max_objects])
        self._known = [self._known[k] for k in kept]

    def _visible(self) -> list[Outline]:
        """What is seen, and for a few frames what was; what lies along something larger is a part of it."""
        config = self._config
        order = [
            k
            for k, item in enumerate(self._known)
            if item.frames_unseen == 0 or (item.frames_unseen <= config.patience_frames <= item.times_seen)
        ]
        order.sort(key=lambda k: -self._known[k].outline.length_m)
        outlines = [self._known[k].outline for k in order]
        if not self._shown.same(outlines):
            self._shown = Outlines.of(outlines, config)
            self._whole = np.flatnonzero(self._shown.mark_whole(config.keep_share, config.step_m)).tolist()
        return [self._known[k].outline for k in sorted(self._within_budget([order[k] for k in self._whole]))]

    def _within_budget(self, wanted: list[int]) -> list[int]:
        """Of the known objects `wanted` as many as have no more than `most_nodes` nodes: first what is seen now, and of
        that what looks largest."""
        room, kept = self._config.most_nodes, []
        known = self._known
        for k in sorted(wanted, key=lambda k: (known[k].frames_unseen > 0, -known[k].outline.apparent_size())):
            nodes = len(known[k].outline.nodes_m)
            if nodes <= room:
                kept.append(k)
                room -= nodes
        return kept


def _together(visible: list[Outline], robot_from_odom: Pose2) -> ObjectNetwork:
    if not visible:
        return ObjectNetwork()
    sizes = [len(outline.nodes_m) for outline in visible]
    first = np.repeat(np.cumsum(sizes) - sizes, [len(outline.connections) for outline in visible])
    edges = np.concatenate([outline.connections for outline in visible]) + first[:, None]
    nodes_m = robot_from_odom.apply_3d(np.concatenate([outline.nodes_m for outline in visible]))
    return ObjectNetwork(nodes_m.astype(np.float32), edges.astype(np.uint16))
