"""The 3D map in the Polygon File Format, binary, little-endian: vertices with colours, faces, and edges for lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from station_gui.export.files import write_whole
from station_gui.export.model3d import Model3d

_VERTEX = np.dtype([("at", "<f4", 3), ("colour", "u1", 3)])
_FACE = np.dtype([("count", "u1"), ("vertices", "<i4", 3)])


def write_ply(model: Model3d, path: Path) -> None:
    """Raises `ExportError`."""
    pieces = [(t.vertices_m, t.colour) for t in model.triangles] + [(s.points_m, s.colour) for s in model.lines]
    firsts = np.cumsum([0, *(len(points) for points, _ in pieces)]).tolist()
    vertices = np.zeros(firsts[-1], _VERTEX)
    for (points, colour), first in zip(pieces, firsts, strict=False):
        vertices["at"][first : first + len(points)] = points
        vertices["colour"][first : first + len(points)] = colour
    faces = [t.faces.astype(np.int64) + first for t, first in zip(model.triangles, firsts, strict=False)]
    all_faces = np.zeros(sum(len(piece) for piece in faces), _FACE)
    all_faces["count"] = 3
    all_faces["vertices"] = np.concatenate(faces) if faces else 0
    ends = np.arange(firsts[len(model.triangles)], firsts[-1], dtype="<i4")
    edges = ends.reshape(-1, 2)  # of all lines, which come last
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment metres, map frame, z up\n"
        f"element vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        f"element face {len(all_faces)}\nproperty list uchar int vertex_indices\n"
        f"element edge {len(edges)}\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    )
    write_whole(path, header.encode() + vertices.tobytes() + all_faces.tobytes() + edges.tobytes())
