"""The 3D map as plain triangles and lines with colours: what every format of 3D models takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.snapshot import GridMap, MapSnapshot, ObjectKind

Colour = tuple[int, int, int]

# The paper's: walls and large objects red, small ones blue; floor white.
_COLOURS: dict[ObjectKind, Colour] = {
    ObjectKind.LARGE: (200, 40, 40),
    ObjectKind.SMALL: (45, 85, 205),
    ObjectKind.FLAT: (214, 160, 160),
}
_FLOOR: Colour = (240, 240, 240)
_WAY: Colour = (40, 150, 70)
_FREE_PROBABILITY = 0.45
_WAY_Z_M = 0.01  # so that it does not flicker with the floor


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """`vertices_m` (V, 3) float32, map frame, z up; `faces` (F, 3) uint32, counter-clockwise from above or outside."""

    name: str
    vertices_m: NDArray[np.float32]
    faces: NDArray[np.uint32]
    colour: Colour


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """`points_m` (2 S, 3) float32, map frame: both ends of each segment one after the other."""

    name: str
    points_m: NDArray[np.float32]
    colour: Colour


@dataclass(frozen=True, slots=True, eq=False)
class Model3d:
    """Pieces that are empty are left out."""

    triangles: tuple[Triangles, ...]
    lines: tuple[Lines, ...]


def make_model(snapshot: MapSnapshot) -> Model3d:
    """Floor, surfaces and edges of the objects, and the way that the robot went."""
    objects = snapshot.objects
    triangles = [_floor(snapshot.grid)]
    lines = []
    for kind, colour in _COLOURS.items():
        name = f"objects {kind.name.lower()}"
        triangles.append(_panels(name, objects.panels.corners_m[objects.panels.kind == kind], colour))
        edges = objects.segments_m[objects.kind == kind].astype(np.float32).reshape(-1, 3)
        lines.append(Lines(f"edges {kind.name.lower()}", edges, colour))
    lines.append(_way(snapshot.trajectory))
    return Model3d(
        tuple(piece for piece in triangles if len(piece.faces)), tuple(piece for piece in lines if len(piece.points_m))
    )


def _panels(name: str, corners_m: NDArray[np.float32], colour: Colour) -> Triangles:
    """(P, 4, 3): two triangles for each."""
    first = 4 * np.arange(len(corners_m), dtype=np.uint32)[:, None, None]
    faces = first + np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    return Triangles(name, corners_m.astype(np.float32).reshape(-1, 3), faces.reshape(-1, 3), colour)


def _floor(grid: GridMap) -> Triangles:
    """The free cells, runs of them along x joined, and equal runs above one another too."""
    quads: list[tuple[int, int, int, int]] = []
    open_runs: dict[tuple[int, int], int] = {}
    free = grid.probability <= _FREE_PROBABILITY
    for row in range(len(free) + 1):
        runs = _runs(free[row]) if row < len(free) else []
        ended = [run for run in open_runs if run not in runs]
        quads += [(run[0], open_runs.pop(run), run[1], row) for run in ended]
        for run in runs:
            open_runs.setdefault(run, row)
    cells = np.array(quads, dtype=np.float64).reshape(-1, 4)
    left, low = grid.origin_m
    x0, y0, x1, y1 = (cells * grid.cell_m + (left, low, left, low)).T
    z = np.zeros_like(x0)
    corners = np.stack(
        [np.column_stack(p) for p in ((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))], axis=1
    )  # fmt: skip
    return _panels("floor", corners.astype(np.float32), _FLOOR)


def _runs(free: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Where a row of cells is free: (first, beyond the last)."""
    steps = np.flatnonzero(np.diff(np.concatenate(([0], free.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in steps.reshape(-1, 2)]


def _way(trajectory: NDArray[np.float64]) -> Lines:
    points = np.column_stack((trajectory[:, 1:3], np.full(len(trajectory), _WAY_Z_M))).astype(np.float32)
    pairs = np.stack((points[:-1], points[1:]), axis=1) if len(points) > 1 else np.zeros((0, 2, 3), np.float32)
    return Lines("way of the robot", pairs.reshape(-1, 3), _WAY)
