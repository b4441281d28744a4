"""Surfaces of the 3D map: panels as meshes, in the paper's colours, shaded by where they point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.snapshot import ObjectKind, Panels
from station_gui.qt import theme
from station_gui.views.scene3d import Mesh, rgba

MOST_PANELS = 4000  # a processor that draws in software takes about 20 ms for so many
FLAT_ALPHA = 0.45
_PALE = 0.42  # how far surfaces go from their edges' colour to white, so that the edges stand out
_LIGHT = np.array([0.35, 0.55, 0.76])  # from the south-east and above; its length is one
_COLOURS = {
    ObjectKind.LARGE: theme.OBJECT_LARGE,
    ObjectKind.SMALL: theme.OBJECT_SMALL,
    ObjectKind.FLAT: theme.DISABLED,
}


def measured_mesh(panels: Panels) -> Mesh:
    """What the camera measured: solid."""
    return _mesh(_largest(panels, np.asarray(panels.kind) != ObjectKind.FLAT), alpha=1.0)


def flat_mesh(panels: Panels) -> Mesh:
    """What only the 2D map knows, with an assumed height: see-through."""
    return _mesh(_largest(panels, np.asarray(panels.kind) == ObjectKind.FLAT), alpha=FLAT_ALPHA)


def _largest(panels: Panels, chosen: NDArray[np.bool_]) -> Panels:
    """Of a map with more than `MOST_PANELS` the largest, for the smallest are not seen in a picture of all of it."""
    corners_m = np.asarray(panels.corners_m, np.float64)
    picked = np.flatnonzero(chosen & np.isfinite(corners_m).all(axis=(1, 2)))
    if len(picked) > MOST_PANELS:
        area = np.linalg.norm(_normals(corners_m[picked]), axis=1)
        picked = np.sort(picked[np.argsort(-area, kind="stable")[:MOST_PANELS]])
    return Panels(panels.corners_m[picked], panels.kind[picked], panels.cluster[picked])


def _mesh(panels: Panels, alpha: float) -> Mesh:
    corners_m = np.asarray(panels.corners_m, np.float64)
    count = len(corners_m)
    first = 4 * np.arange(count)[:, None]
    faces = (first[:, :, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    colours = np.ones((count, 4))
    for kind, colour in _COLOURS.items():
        base = np.array(rgba(colour)[:3])
        pale = base if kind is ObjectKind.FLAT else base + _PALE * (1.0 - base)
        colours[np.asarray(panels.kind) == kind, :3] = pale
    normals = _normals(corners_m)
    facing = np.abs(normals @ _LIGHT) / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    colours[:, :3] *= (0.72 + 0.28 * facing)[:, None]
    colours[:, 3] = alpha
    return Mesh(
        corners_m.reshape(-1, 3).astype(np.float32),
        faces.astype(np.uint32),
        np.repeat(colours, 2, axis=0).astype(np.float32),
    )


def _normals(corners_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P, 3): across each panel, as long as its area."""
    return np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 3] - corners_m[:, 0])
