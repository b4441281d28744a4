"""Shapes of the 3D map as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PySide6.QtGui import QColor

from station_gui.mapping.objects.open_tops import open_tops
from station_gui.mapping.snapshot import ObjectKind, ObjectMap
from station_gui.qt import theme
from station_gui.views.grid_picture import Extent

ROBOT_HEIGHT_M = 0.20  # paper 1, figure 2: 350 x 200 x 200 mm
_WHEEL_RADIUS_M = 0.04
_WHEEL_WIDTH_M = 0.035
_WHEEL_SIDES = 14
_MAX_LINES = 200
_RING_SIDES = 28
_RING_M = 0.12
_DASHED_M = 0.24  # of an edge that may go on
# How much light a face gets by where it points: top, ends, sides. Fixed to the robot, so that it reads as a body.
_SHADES = {"top": 1.12, "front": 0.92, "back": 0.70, "side": 0.80, "bottom": 0.5}


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles: `vertices_m` (V, 3) float32, `faces` (F, 3) uint32, `colours` (F, 4) float32 RGBA."""

    vertices_m: NDArray[np.float32]
    faces: NDArray[np.uint32]
    colours: NDArray[np.float32]


def segments_of(objects: ObjectMap, kind: ObjectKind) -> NDArray[np.float32]:
    """(2 S, 3): both ends of each segment of this kind, one after another, as a line list wants them.

    Upright ones that may go on above end in dashes.
    """
    segments = np.asarray(objects.segments_m, np.float64).reshape(-1, 2, 3)
    kinds = np.asarray(objects.kind).reshape(-1)
    finite = np.isfinite(segments[: len(kinds)]).all(axis=(1, 2))
    segments, chosen = segments[: len(kinds)][finite], kinds[: len(segments)][finite] == int(kind)
    is_open = open_tops(segments)
    shown = np.concatenate((segments[chosen & ~is_open], _dashed(segments[chosen & is_open])))
    return shown.astype(np.float32).reshape(-1, 3)


def _dashed(upright_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each of the segments, (N, 2, 3), as a solid lower part and three dashes up to its upper end."""
    low_m = np.take_along_axis(upright_m, upright_m[:, :, 2].argmin(axis=1)[:, None, None], axis=1)
    way_m = upright_m.sum(axis=1, keepdims=True) - 2 * low_m
    length_m = np.maximum(np.linalg.norm(way_m, axis=2), 1e-9)
    solid = np.maximum(1 - _DASHED_M / length_m, 0.5)
    parts = [(0.0 * solid, solid)]
    parts += [(solid + (1 - solid) * (2 * k + 1) / 6, solid + (1 - solid) * (2 * k + 2) / 6) for k in range(3)]
    return np.concatenate([low_m + np.stack(ends, axis=1) * way_m for ends in parts])


def robot_mesh(corners_m: NDArray[np.float64]) -> Mesh:
    """The robot as a green box on four wheels with a light arrow on its roof, robot frame."""
    low, high = corners_m.min(axis=0), corners_m.max(axis=0)
    body = _box(np.array([*low, 0.03]), np.array([*high, ROBOT_HEIGHT_M]), theme.ROBOT)
    rear_x, front_x = 0.0, low[0] + 0.87 * (high[0] - low[0])
    wheels = [
        _wheel(x, y, side) for x in (rear_x, front_x) for y, side in ((low[1] - 0.004, -1.0), (high[1] + 0.004, 1.0))
    ]
    return _joined([body, *wheels, _arrow(low, high)])


def floor_lines_m(extent: Extent, step_m: float) -> NDArray[np.float32]:
    """(2 N, 2): a grid over `extent` at whole multiples of `step_m`, both ends of each line one after the other.

    On a very wide map the lines stand further apart, so that there are never more than a few hundred.
    """
    step_m *= max(1.0, float(np.ceil(max(extent.width_m, extent.height_m) / step_m / _MAX_LINES)))
    right_m, top_m = extent.left_m + extent.width_m, extent.bottom_m + extent.height_m
    xs = np.arange(np.ceil(extent.left_m / step_m), np.floor(right_m / step_m) + 1) * step_m
    ys = np.arange(np.ceil(extent.bottom_m / step_m), np.floor(top_m / step_m) + 1) * step_m
    lines = [((x, extent.bottom_m), (x, top_m)) for x in xs]
    lines += [((extent.left_m, y), (right_m, y)) for y in ys]
    return np.array(lines, np.float32).reshape(-1, 2)


def goal_mark_m(x_m: float, y_m: float) -> NDArray[np.float32]:
    """(2 N, 3): a ring on the floor with a pole in its middle."""
    angles = np.linspace(0, 2 * np.pi, _RING_SIDES + 1)
    ring = np.column_stack((x_m + _RING_M * np.cos(angles), y_m + _RING_M * np.sin(angles), np.full(len(angles), 0.01)))
    pole = np.array([[x_m, y_m, 0.01], [x_m, y_m, 2 * ROBOT_HEIGHT_M]])
    return np.vstack((np.stack((ring[:-1], ring[1:]), axis=1).reshape(-1, 3), pole)).astype(np.float32)


def rgba(colour: str, alpha: float = 1.0) -> tuple[float, float, float, float]:
    made = QColor(colour)
    return made.redF(), made.greenF(), made.blueF(), alpha


def _box(low_m: NDArray[np.float64], high_m: NDArray[np.float64], colour: str) -> Mesh:
    corners = np.array([[(low_m, high_m)[b >> i & 1][i] for i in range(3)] for b in range(8)])
    quads = {
        "bottom": [(0, 2, 3, 1)],
        "top": [(4, 5, 7, 6)],
        "side": [(0, 1, 5, 4), (2, 6, 7, 3)],
        "back": [(0, 4, 6, 2)],
        "front": [(1, 3, 7, 5)],
    }
    faces, colours = [], []
    for place, rings in quads.items():
        for a, b, c, d in rings:
            faces += [(a, b, c), (a, c, d)]
            colours += [_shade(colour, _SHADES[place])] * 2
    return _mesh(corners, faces, colours)


def _wheel(x_m: float, y_m: float, side: float) -> Mesh:
    """A disc standing at (x, y), with its outer face away from the body."""
    angles = np.linspace(0, 2 * np.pi, _WHEEL_SIDES, endpoint=False)
    rim_x = x_m + _WHEEL_RADIUS_M * np.cos(angles)
    rim_z = _WHEEL_RADIUS_M + _WHEEL_RADIUS_M * np.sin(angles)
    outer = np.column_stack((rim_x, np.full(_WHEEL_SIDES, y_m + side * _WHEEL_WIDTH_M / 2), rim_z))
    inner = outer - (0.0, side * _WHEEL_WIDTH_M, 0.0)
    hub = np.array([[x_m, y_m + side * _WHEEL_WIDTH_M / 2, _WHEEL_RADIUS_M]])
    n = _WHEEL_SIDES
    faces, colours = [], []
    for i in range(n):
        j = (i + 1) % n
        faces += [(2 * n, i, j), (i, n + i, n + j), (i, n + j, j)]
        colours += [_shade("#30343a", 1.0), _shade("#17191c", 1.0), _shade("#17191c", 1.0)]
    return _mesh(np.vstack((outer, inner, hub)), faces, colours)


def _arrow(low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> Mesh:
    length, width, middle = high_m[0] - low_m[0], high_m[1] - low_m[1], (high_m[1] + low_m[1]) / 2
    top = ROBOT_HEIGHT_M + 0.002
    base, half = low_m[0] + 0.55 * length, 0.32 * width
    tip = (high_m[0] - 0.06 * length, middle, top)
    corners = np.array([tip, (base, middle + half, top), (base, middle - half, top)])
    return _mesh(corners, [(0, 1, 2)], [rgba("#f4fff7")])


def _shade(colour: str, factor: float) -> tuple[float, float, float, float]:
    red, green, blue, alpha = rgba(colour)
    return min(1.0, red * factor), min(1.0, green * factor), min(1.0, blue * factor), alpha


def _mesh(
    vertices: NDArray[np.float64],
    faces: list[tuple[int, int, int]],
    colours: list[tuple[float, float, float, float]],
) -> Mesh:
    return Mesh(vertices.astype(np.float32), np.array(faces, np.uint32), np.array(colours, np.float32))


def _joined(meshes: list[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(m.vertices_m) for m in meshes[:-1])])
    return Mesh(
        np.vstack([m.vertices_m for m in meshes]),
        np.vstack([m.faces + np.uint32(s) for m, s in zip(meshes, starts, strict=True)]),
        np.vstack([m.colours for m in meshes]),
    )
