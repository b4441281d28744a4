"""The vertical edges of the true things, and the upper rims, that the camera can have seen from the driven way.

An edge of a box counts where it stands out by 2 cm to both sides: where a box stands flush beside another one or
against a wall there is none. A rim counts likewise where there is nothing above and before it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.evaluate.mapping.world import TrueWorld
from tools.simulator.solids import Solid, item_solids

FloatArray = NDArray[np.float64]

STEP_M = 0.02
SHORTEST_M = 0.10  # the shortest connection that a network has (paper 1, table 3)
_STANDS_OUT_M = 0.02
_BEFORE_M = 0.002  # a ray ends so far before the edge
_CORNERS = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class TrueEdge:
    """`seen_m`: (K, 3), room frame: every 2 cm of what the camera can have seen of it."""

    item: int
    seen_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class SeenThings:
    """`edges`: vertical ones that were in view for 10 cm at least; `tops_m`: of the items whose upper rim was."""

    edges: list[TrueEdge]
    tops_m: dict[int, float]

    @property
    def items(self) -> list[int]:
        return sorted({edge.item for edge in self.edges})


def seen_things(world: TrueWorld, cameras: FloatArray) -> SeenThings:
    """What can be asked of a map. `cameras` as of `camera_places`."""
    edges: list[TrueEdge] = []
    tops_m: dict[int, float] = {}
    for number, item in enumerate(world.scenario.items):
        if item.kind == "wall":
            continue
        solids = list(item_solids(item))
        for solid in solids:
            edges += _vertical_edges(world, cameras, number, solid)
        top_m = max(solid.center_m[2] + solid.half_m[2] for solid in solids)
        highest = [solid for solid in solids if solid.center_m[2] + solid.half_m[2] > top_m - 1e-6]
        rims_seen = sum(len(_seen(world, cameras, rim)) for solid in highest for rim in _rims(world, solid))
        if rims_seen * STEP_M >= SHORTEST_M:
            tops_m[number] = top_m
    return SeenThings(edges, tops_m)


def _vertical_edges(world: TrueWorld, cameras: FloatArray, item: int, solid: Solid) -> Iterator[TrueEdge]:
    bottom_m, top_m = solid.center_m[2] - solid.half_m[2], solid.center_m[2] + solid.half_m[2]
    if top_m - bottom_m < SHORTEST_M:
        return
    height_m = _samples(bottom_m, top_m)
    for (x, y), corner in zip(_CORNERS, solid.corners_m(), strict=True):
        edge_m = np.column_stack((np.tile(corner, (len(height_m), 1)), height_m))
        u, v = (_turned(solid, way) for way in ((x, 0.0), (0.0, y)))
        stands_out = _free(world, edge_m, (u + v, u - v, v - u))
        seen_m = _seen(world, cameras, (edge_m[stands_out], u + v))
        if len(seen_m) * STEP_M >= SHORTEST_M:
            yield TrueEdge(item, seen_m)


def _rims(world: TrueWorld, solid: Solid) -> Iterator[tuple[FloatArray, FloatArray]]:
    """The points of the four upper edges that stand out, and the way out from there."""
    corners = solid.corners_m()
    top_m = solid.center_m[2] + solid.half_m[2]
    up = np.array([0.0, 0.0, 1.0])
    for (a, b), way in zip(((0, 1), (1, 2), (2, 3), (3, 0)), ((0, -1), (1, 0), (0, 1), (-1, 0)), strict=True):
        length_m = float(np.hypot(*(corners[b] - corners[a])))
        along = (_samples(0.0, length_m) / length_m)[:, None]
        rim_m = np.column_stack((corners[a] + along * (corners[b] - corners[a]), np.full(len(along), top_m)))
        out = _turned(solid, way)
        yield rim_m[_free(world, rim_m, (out + up, out - up, up - out))], out + up


def _free(world: TrueWorld, points_m: FloatArray, ways: tuple[FloatArray, ...]) -> NDArray[np.bool_]:
    """Where nothing is at 2 cm in each of the ways."""
    free = np.ones(len(points_m), np.bool_)
    for way in ways:
        free &= world.signed_distance_m(points_m + _STANDS_OUT_M * way) > 0
    return free


def _seen(world: TrueWorld, cameras: FloatArray, edge: tuple[FloatArray, FloatArray]) -> FloatArray:
    points_m, out = edge
    seen: FloatArray = points_m[world.seen(points_m + _BEFORE_M * out, cameras)]
    return seen


def _turned(solid: Solid, way: tuple[float, float]) -> FloatArray:
    c, s = np.cos(solid.yaw_rad), np.sin(solid.yaw_rad)
    return np.array([c * way[0] - s * way[1], s * way[0] + c * way[1], 0.0])


def _samples(low: float, high: float) -> FloatArray:
    """The middles of pieces of about `STEP_M`."""
    count = max(1, round((high - low) / STEP_M))
    return np.asarray(low + (np.arange(count) + 0.5) / count * (high - low), dtype=np.float64)
