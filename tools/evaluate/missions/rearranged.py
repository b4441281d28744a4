"""A scenario's things in other places, drawn at random, in a room in which the robot can still get about.

What stands against a wall goes to a wall again, anywhere round the room; what stands in the middle goes anywhere.
Things that stand under one another (a table and what is beneath it) stay together. A room is taken only if the robot,
with 10 cm to spare on all sides, gets from its start to 97 % of the places where it would fit, and has half of the
room that it has in the room given.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from shared.geometry.ackermann import CarGeometry
from shared.geometry.omni3 import OmniGeometry
from shared.geometry.rays import polygon_clearance_m
from shared.geometry.se2 import Pose2
from tools.evaluate.goals.reachable import reach_of
from tools.simulator.rooms import free_pose
from tools.simulator.scenario import Item, Scenario, Start

_MARGIN_M = 0.10
_JOINED = 0.97
_LEAST_SPACE = 0.5
_AGAINST_M = 0.12  # what is nearer to a wall than this stands against it
_STRAY_DEG = 8.0  # things are not put down straight
_OFF_WALL_M = 0.06
_GAP_M = 0.04  # mean gap between neighbours at a wall …
_SPARSE_M = 1.0  # … but where walls offer more than this to each of them, they stand half of that apart
_STEP_M = 0.05  # on from where nothing went in
_LONG_ALONG = 0.85
_ROOMS, _PLACES = 200, 200

Group = tuple[Item, ...]


def rearranged(like: Scenario, body: CarGeometry | OmniGeometry, rng: np.random.Generator) -> Scenario:
    """Without goals. Raises `ValueError` when no such room is found."""
    groups = _groups(like.items)
    needed = _LEAST_SPACE * reach_of(like, body, like.start.room_from_robot, _MARGIN_M).places()
    for _ in range(_ROOMS):
        items = _put_down(groups, like, rng)
        room = _with_start(items, like, rng) if items is not None else None
        if room is None:
            continue
        reach = reach_of(room, body, room.start.room_from_robot, _MARGIN_M)
        if reach.places() >= max(needed, _JOINED * reach.places_that_fit()):
            return room
    raise ValueError(f"{like.name}: its things leave no way for the robot in any of {_ROOMS} arrangements")


def _with_start(items: tuple[Item, ...], like: Scenario, rng: np.random.Generator) -> Scenario | None:
    """None where the place drawn is taken."""
    place = _anywhere(like, rng)
    try:
        start = Start((place.x_m, place.y_m))
        room = replace(like, name=f"{like.name}-at-random", start=start, items=items, goals=())
    except ValueError:
        return None
    pose = free_pose(room, rng)
    return replace(room, start=Start((pose.x_m, pose.y_m), math.degrees(pose.theta_rad)))


def _groups(items: Sequence[Item]) -> tuple[Group, ...]:
    """Each with what stands beneath it."""
    roofs = [item for item in items if item.kind in {"table", "chair"}]
    below = {roof.name: [item for item in items if item is not roof and _covers(roof, item)] for roof in roofs}
    covered = {item.name for inside in below.values() for item in inside}
    return tuple((item, *below.get(item.name, ())) for item in items if item.name not in covered)


def _covers(roof: Item, item: Item) -> bool:
    dx, dy = _pose(roof).inverse().apply(np.array([item.position_m]))[0]
    return bool(abs(dx) <= roof.size_m[0] / 2 and abs(dy) <= roof.size_m[1] / 2)


def _pose(item: Item) -> Pose2:
    return Pose2(*item.position_m, math.radians(item.yaw_deg))


def _put_down(groups: tuple[Group, ...], like: Scenario, rng: np.random.Generator) -> tuple[Item, ...] | None:
    """None where the things do not go in."""
    at_walls = [group for group in groups if _wall_gap_m(group[0], like) < _AGAINST_M]
    placed, left = _along_walls([at_walls[k] for k in rng.permutation(len(at_walls))], like, rng)
    for group in (*(group for group in groups if group not in at_walls), *left):
        for _ in range(_PLACES):
            moved = _moved(group, _anywhere(like, rng))
            if _fits(moved[0], placed, like):
                placed += moved
                break
        else:
            return None
    return tuple(placed)


def _along_walls(groups: Sequence[Group], like: Scenario, rng: np.random.Generator) -> tuple[list[Item], list[Group]]:
    """One after the other round the room, with gaps between them; and what found no place any more."""
    x, y = like.room.length_x_m, like.room.width_y_m
    sides = (Pose2(0.0, 0.0, 0.0), Pose2(x, 0.0, math.pi / 2), Pose2(x, y, math.pi), Pose2(0.0, y, -math.pi / 2))
    placed: list[Item] = []
    left = list(groups)
    spare_m = (2 * (x + y) - sum(max(group[0].size_m[:2]) for group in groups)) / max(len(groups), 1)
    gap_m = _GAP_M if spare_m < _SPARSE_M else spare_m / 2
    for side, wall_from_corner in enumerate(sides):
        along = 0.0
        while along < (x, y)[side % 2]:
            along += float(rng.exponential(gap_m))
            for group in left:
                place, far = _at_wall(group[0], along, rng)
                moved = _moved(group, wall_from_corner @ place)
                if far <= (x, y)[side % 2] and _fits(moved[0], placed, like):
                    placed += moved
                    left.remove(group)
                    along = far
                    break
            else:
                along += _STEP_M
    return placed, left


def _wall_gap_m(item: Item, like: Scenario) -> float:
    corners = _corners(item)
    return float(
        min(corners.min(), like.room.length_x_m - corners[:, 0].max(), like.room.width_y_m - corners[:, 1].max())
    )


def _at_wall(item: Item, along_m: float, rng: np.random.Generator) -> tuple[Pose2, float]:
    """Its place on a wall along x, from `along_m` on, and where it ends; the long side along the wall mostly."""
    long_along = item.size_m[0] >= item.size_m[1]
    turn = 0.0 if long_along == bool(rng.random() < _LONG_ALONG) else math.pi / 2
    stray = math.radians(float(rng.uniform(-_STRAY_DEG, _STRAY_DEG))) if rng.random() < 0.3 else 0.0
    width, depth = item.size_m[:2] if turn == 0.0 else item.size_m[1::-1]
    wide = math.cos(stray) * width + abs(math.sin(stray)) * depth
    deep = math.cos(stray) * depth + abs(math.sin(stray)) * width
    off_wall = float(rng.uniform(0.001, _OFF_WALL_M))
    return Pose2(along_m + wide / 2, off_wall + deep / 2, turn + stray), along_m + wide


def _anywhere(like: Scenario, rng: np.random.Generator) -> Pose2:
    x, y = like.room.length_x_m, like.room.width_y_m
    return Pose2(
        float(rng.uniform(0.2, 0.8)) * x, float(rng.uniform(0.2, 0.8)) * y, float(rng.uniform(-math.pi, math.pi))
    )


def _moved(group: Group, place: Pose2) -> Group:
    """The first of the group to that place, the others with it."""
    place_from_old = place @ _pose(group[0]).inverse()
    moved = []
    for item in group:
        pose = place_from_old @ _pose(item)
        moved.append(replace(item, position_m=(pose.x_m, pose.y_m), yaw_deg=math.degrees(pose.theta_rad)))
    return tuple(moved)


def _fits(item: Item, placed: Sequence[Item], like: Scenario) -> bool:
    corners = _corners(item)
    inside = corners.min() >= 0 and (corners <= (like.room.length_x_m, like.room.width_y_m)).all()
    return bool(inside) and all(_gap_m(corners, other) > 0.0 for other in placed)


def _gap_m(corners: np.ndarray[tuple[int, int], np.dtype[np.float64]], other: Item) -> float:
    outline = _corners(other)
    segments = np.column_stack((outline, np.roll(outline, -1, axis=0)))
    inside = Pose2(*other.position_m, math.radians(other.yaw_deg)).inverse().apply(corners.mean(axis=0)[None])
    if (np.abs(inside) <= np.array(other.size_m[:2]) / 2).all():
        return 0.0
    return float(polygon_clearance_m(np.ascontiguousarray(corners), np.ascontiguousarray(segments)))


def _corners(item: Item) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """(4, 2), room frame, counter-clockwise."""
    half = np.array(item.size_m[:2]) / 2
    return _pose(item).apply(np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]) * half)
