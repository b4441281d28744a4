"""Places to put a robot down, and rooms that are drawn at random."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shared.geometry.omni3 import OmniGeometry
from shared.geometry.rays import polygon_clearance_m
from shared.geometry.se2 import Pose2
from tools.simulator.scenario import CarParameters, Item, OmniParameters, Room, Scenario, Start
from tools.simulator.solids import Solid, solids_of

_CLEAR_M = 0.03  # round the footprint
_TRIES = 10_000
_MIN_SIDE_M, _MAX_SIDE_M = 2.8, 6.5
_ITEMS = (3, 14)
_START_M = 1.0  # round the start there is nothing


def free_pose(scenario: Scenario, rng: np.random.Generator) -> Pose2:
    """Anywhere in the room where the robot stands clear of everything, any heading. Raises `ValueError`."""
    body, room = scenario.body, scenario.room
    outline = footprint(body)
    solids = [s for s in solids_of(scenario) if s.center_m[2] - s.half_m[2] < body.height_m]
    for _ in range(_TRIES):
        pose = Pose2(
            float(rng.uniform(0.0, room.length_x_m)),
            float(rng.uniform(0.0, room.width_y_m)),
            float(rng.uniform(-math.pi, math.pi)),
        )
        corners = pose.apply(outline)
        if _in_room(corners, room) and all(_clearance_m(corners, solid) > _CLEAR_M for solid in solids):
            return pose
    raise ValueError(f"{scenario.name}: no room for the robot")


def footprint(body: CarParameters | OmniParameters) -> NDArray[np.float64]:
    """(K, 2): its corners, robot frame, counter-clockwise."""
    if isinstance(body, OmniParameters):
        return np.array(OmniGeometry(body.wheel_distance_m, body.wheel_radius_m, body.radius_m).footprint_m())
    right, left = -body.width_m / 2, body.width_m / 2
    return np.array([(-body.rear_m, right), (body.front_m, right), (body.front_m, left), (-body.rear_m, left)])


def random_room(like: Scenario, rng: np.random.Generator) -> Scenario:
    """Another room with the robot of `like`: other sides, and boxes along its walls and in it."""
    x, y = (float(rng.uniform(_MIN_SIDE_M, _MAX_SIDE_M)) for _ in range(2))
    at = float(rng.uniform(_START_M, x - _START_M)), float(rng.uniform(_START_M, y - _START_M))
    drawn = [_random_box(k, x, y, rng) for k in range(int(rng.integers(*_ITEMS)))]
    items = tuple(item for item in drawn if math.dist(item.position_m, at) > _START_M)
    room = Room(x, y, like.room.wall_height_m, like.room.wall_reflectivity)
    heading_deg = float(rng.uniform(-180.0, 180.0))
    return replace(like, name="elsewhere", start=Start(at, heading_deg), room=room, items=items, goals=())


def _random_box(number: int, x_m: float, y_m: float, rng: np.random.Generator) -> Item:
    size = (float(rng.uniform(0.2, 1.0)), float(rng.uniform(0.2, 0.5)), float(rng.uniform(0.25, 1.2)))
    side = int(rng.integers(5))
    along_x, along_y = float(rng.uniform(0.1, 0.9)) * x_m, float(rng.uniform(0.1, 0.9)) * y_m
    places = (
        (along_x, size[1] / 2, 0.0), (along_x, y_m - size[1] / 2, 0.0), (size[1] / 2, along_y, 90.0),
        (x_m - size[1] / 2, along_y, 90.0), (along_x, along_y, float(rng.uniform(-90.0, 90.0))),
    )  # fmt: skip
    at_x, at_y, yaw_deg = places[side]
    return Item(f"box{number}", (at_x, at_y), size, yaw_deg=yaw_deg, reflectivity=float(rng.uniform(0.2, 0.8)))


def _in_room(corners_m: NDArray[np.float64], room: Room) -> bool:
    x, y = corners_m.T
    return bool(x.min() > 0 and y.min() > 0 and x.max() < room.length_x_m and y.max() < room.width_y_m)


def _clearance_m(corners_m: NDArray[np.float64], solid: Solid) -> float:
    """0 as well where the car stands inside of the solid."""
    outline = solid.corners_m()
    segments = np.column_stack((outline, np.roll(outline, -1, axis=0)))
    local = Pose2(solid.center_m[0], solid.center_m[1], solid.yaw_rad).inverse().apply(corners_m)
    if (np.abs(local) <= solid.half_m[:2]).all(axis=1).any():
        return 0.0
    return float(polygon_clearance_m(np.ascontiguousarray(corners_m), np.ascontiguousarray(segments)))
