"""Keeps the identity of objects from frame to frame, and their outlines for as long as they say nothing new.

Every frame's network is learned anew, so noise moves its nodes a little and joins or parts its clusters. The tracker
compares the new outlines with those that it knows, in the odometry's frame: what lies along a known outline is that
object, and where both cover one another, the known nodes and connections stay as they are, bit for bit. So a still
scene gives the same network again and again, and only what changed needs to be sent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.perception.config import TrackingConfig
from robot_app.perception.identity.outline import Outline, outlines_of, shares_near, snapped
from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork

_MAX_NUMBER = 65535  # fits into 16 bits; numbers begin again after that

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class TrackedObjects:
    """`numbers`: (N,) which object each node of `network` is of; the same object has the same number in every frame.

    `changed`: the numbers of the objects whose outline is not that of the frame before, new ones among them.
    """

    network: ObjectNetwork
    numbers: NDArray[np.int32]
    changed: tuple[int, ...]


@dataclass(slots=True, eq=False)
class _Object:
    number: int
    outline: Outline
    times_seen: int = 1
    frames_unseen: int = 0
    frames_partial: int = 0
    shown: bool = False
    changed: bool = True


class ObjectTracker:
    """What was seen lately; at most `max_objects`, forgotten after `forget_frames` without being seen."""

    def __init__(self, config: TrackingConfig) -> None:
        self._config = config
        self._known: list[_Object] = []
        self._last_number = 0

    def update(self, objects: ObjectNetwork, odom_from_robot: Pose2) -> TrackedObjects:
        """Take the network of a new frame, which was seen from `odom_from_robot`."""
        new = outlines_of(objects, odom_from_robot)
        known = [item.outline for item in self._known]
        new_on_known = shares_near(new, known, self._config)
        known_on_new = shares_near(known, new, self._config)
        owners = self._match(0.5 * (new_on_known + known_on_new.T))
        for item in self._known:
            item.changed = False
            item.frames_unseen += 1
        for k, at in enumerate(owners):
            if at >= 0:
                self._see_again(self._known[at], new[k], float(new_on_known[k, at]), float(known_on_new[at, k]))
        for k, at in enumerate(owners):
            if at < 0:
                self._known.append(_Object(self._next_number(), new[k]))
        self._forget()
        return self._show(odom_from_robot.inverse())

    def warm_up(self) -> None:
        """Compile the kernels; what is known stays as it is."""
        line = ObjectNetwork(np.eye(2, 3, dtype=np.float32), np.array([[0, 1]], np.uint16))
        other = ObjectTracker(self._config)
        other.update(line, Pose2())
        other.update(line, Pose2())

    def _match(self, alike: FloatArray) -> list[int]:
        """For each new outline the known object that it is, the most alike first; -1 for none."""
        owners = [-1] * len(alike)
        while alike.size:
            k, at = divmod(int(np.argmax(alike)), alike.shape[1])
            if alike[k, at] < self._config.match_share:
                break
            owners[k] = at
            alike[k, :] = 0.0
            alike[:, at] = 0.0
        return owners

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
        known.changed = True

    def _next_number(self) -> int:
        taken = {item.number for item in self._known}
        while True:
            self._last_number = self._last_number % _MAX_NUMBER + 1
            if self._last_number not in taken:
                return self._last_number

    def _forget(self) -> None:
        kept = [item for item in self._known if item.frames_unseen <= self._config.forget_frames]
        kept.sort(key=lambda item: (item.frames_unseen, item.number))
        self._known = sorted(kept[: self._config.max_objects], key=lambda item: item.number)

    def _show(self, robot_from_odom: Pose2) -> TrackedObjects:
        """What is seen, and for a few frames what was; what lies along something larger is a part of it."""
        patience = self._config.patience_frames
        candidates = [
            item
            for item in self._known
            if item.frames_unseen == 0 or (item.frames_unseen <= patience <= item.times_seen)
        ]
        candidates.sort(key=lambda item: (-item.outline.length_m(), item.number))
        outlines = [item.outline for item in candidates]
        covered = shares_near(outlines, outlines, self._config)
        shown: list[int] = []
        for k in range(len(candidates)):
            if not any(covered[k, other] >= self._config.keep_share for other in shown):
                shown.append(k)
        visible = sorted((candidates[k] for k in shown), key=lambda item: item.number)
        changed = tuple(item.number for item in visible if item.changed or not item.shown)
        for item in self._known:
            item.shown = item in visible
        return _together(visible, robot_from_odom, changed)


def _together(visible: list[_Object], robot_from_odom: Pose2, changed: tuple[int, ...]) -> TrackedObjects:
    if not visible:
        return TrackedObjects(ObjectNetwork(), np.zeros(0, np.int32), changed)
    sizes = [len(item.outline.nodes_m) for item in visible]
    first = np.cumsum([0, *sizes])
    nodes_m = np.concatenate([item.outline.nodes_m for item in visible])
    edges = np.concatenate([item.outline.connections + at for item, at in zip(visible, first[:-1], strict=True)])
    numbers = np.repeat(np.array([item.number for item in visible], np.int32), sizes)
    moved_m = robot_from_odom.apply_3d(nodes_m).astype(np.float32)
    return TrackedObjects(ObjectNetwork(moved_m, edges.astype(np.uint16)), numbers, changed)
