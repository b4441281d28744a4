"""Counts how often the car has touched anything but the floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tools.simulator._kernels import any_pair
from tools.simulator.engine import mujoco
from tools.simulator.mjcf import ROBOT_GROUP

_RELEASED_S = 0.5  # a contact with the same thing after less than this is the same collision
_MAX_RECORDED = 1000
_ROBOT, _SOLID, _FLOOR = 1, 2, 4


@dataclass(frozen=True, slots=True)
class Collision:
    """The beginning of a contact; `count` of the world goes on when the list of these is full."""

    time_s: float
    robot_part: str
    thing: str


class CollisionCounter:
    def __init__(self, model: Any) -> None:
        self._names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, i) for i in range(model.ngeom)]
        self._kind = np.full(model.ngeom, _SOLID)
        self._kind[model.geom_group == ROBOT_GROUP] = _ROBOT
        self._kind[self._names.index("floor")] = _FLOOR
        self._last_touch_s: dict[int, float] = {}  # bounded by the number of things in the room
        self.count = 0
        self.recorded: list[Collision] = []

    def look(self, data: Any, time_s: float) -> None:
        """To be called after each step, with the time of its contacts."""
        if data.ncon == 0:
            return
        pairs = data.contact.geom
        if not any_pair(pairs, self._kind, _ROBOT + _SOLID):
            return
        for first, second in pairs.tolist():
            if self._kind[first] + self._kind[second] == _ROBOT + _SOLID:
                part, thing = (first, second) if self._kind[first] == _ROBOT else (second, first)
                self._touched(part, thing, time_s)

    def _touched(self, part: int, thing: int, time_s: float) -> None:
        last_s = self._last_touch_s.get(thing)
        self._last_touch_s[thing] = time_s
        if last_s is not None and time_s - last_s < _RELEASED_S:
            return
        self.count += 1
        if len(self.recorded) < _MAX_RECORDED:
            self.recorded.append(Collision(time_s, self._names[part], self._names[thing]))
