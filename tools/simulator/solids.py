"""The boxes that a scenario's room and items are made of."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.simulator.scenario import Item, Room, Scenario

_WALL_M = 0.1  # thickness
_TOP_M = 0.03  # thickness of table tops, seats and backs
_SEAT_M = 0.45  # height of a seat


@dataclass(frozen=True, slots=True)
class Solid:
    """An upright box, room frame."""

    name: str
    center_m: tuple[float, float, float]
    half_m: tuple[float, float, float]
    yaw_rad: float
    reflectivity: float

    def reaches(self, height_m: float) -> bool:
        return abs(height_m - self.center_m[2]) < self.half_m[2]

    def corners_m(self) -> NDArray[np.float64]:
        """(4, 2): of its outline from above, counter-clockwise."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        local = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * np.array(self.half_m[:2])
        corners: NDArray[np.float64] = local @ np.array([[c, s], [-s, c]]) + np.array(self.center_m[:2])
        return corners


def wall_solids(room: Room) -> tuple[Solid, ...]:
    """The four walls, their inner faces on the room's border."""
    x, y, half_z, t = room.length_x_m, room.width_y_m, room.wall_height_m / 2, _WALL_M / 2
    places = {
        "wall_south": ((x / 2, -t, half_z), (x / 2 + 2 * t, t, half_z)),
        "wall_north": ((x / 2, y + t, half_z), (x / 2 + 2 * t, t, half_z)),
        "wall_west": ((-t, y / 2, half_z), (t, y / 2, half_z)),
        "wall_east": ((x + t, y / 2, half_z), (t, y / 2, half_z)),
    }
    return tuple(Solid(name, c, h, 0.0, room.wall_reflectivity) for name, (c, h) in places.items())


def item_solids(item: Item) -> Iterator[Solid]:
    half_x, half_y, height = item.size_m[0] / 2, item.size_m[1] / 2, item.size_m[2]
    if item.kind in {"box", "wall"}:
        yield _placed(item, "", (0.0, 0.0, height / 2), (half_x, half_y, height / 2))
        return
    top = height if item.kind == "table" else min(_SEAT_M, height)
    yield _placed(item, "_top", (0.0, 0.0, top - _TOP_M / 2), (half_x, half_y, _TOP_M / 2))
    half_leg, half_z = item.leg_m / 2, (top - _TOP_M) / 2
    for i, (sx, sy) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
        at = (sx * (half_x - half_leg), sy * (half_y - half_leg), half_z)
        yield _placed(item, f"_leg{i}", at, (half_leg, half_leg, half_z))
    if item.kind == "chair" and height > top:
        half_back = (height - top) / 2
        at = (-half_x + _TOP_M / 2, 0.0, top + half_back)
        yield _placed(item, "_back", at, (_TOP_M / 2, half_y, half_back))


def solids_of(scenario: Scenario) -> tuple[Solid, ...]:
    """Walls first, then the items in their order."""
    clutter = (solid for item in scenario.items for solid in item_solids(item))
    return (*wall_solids(scenario.room), *clutter)


def _placed(item: Item, suffix: str, local_m: tuple[float, float, float], half_m: tuple[float, float, float]) -> Solid:
    yaw = math.radians(item.yaw_deg)
    c, s = math.cos(yaw), math.sin(yaw)
    x = item.position_m[0] + c * local_m[0] - s * local_m[1]
    y = item.position_m[1] + s * local_m[0] + c * local_m[1]
    return Solid(item.name + suffix, (x, y, local_m[2]), half_m, yaw, item.reflectivity)
