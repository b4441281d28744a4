"""The 3D map as binary glTF 2.0 (.glb): one node for each piece, under one that turns z up into glTF's y up."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station_gui.export.files import write_whole
from station_gui.export.model3d import Colour, Model3d

_FLOAT, _UINT = 5126, 5125
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_LINES, _TRIANGLES = 1, 4
_Y_UP = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]  # a quarter turn about x


class _Writer:
    """Collects what the file is made of."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.document: dict[str, list[Any]] = {
            "nodes": [], "meshes": [], "materials": [], "accessors": [], "bufferViews": []
        }  # fmt: skip

    def add(self, name: str, primitive: dict[str, Any], colour: Colour) -> None:
        """A node with a mesh of one primitive."""
        material = {
            "name": name,
            "doubleSided": True,
            "pbrMetallicRoughness": {
                "baseColorFactor": [*(_linear(c) for c in colour), 1.0],
                "metallicFactor": 0.0,
                "roughnessFactor": 0.9,
            },
        }
        self._append("materials", material)
        primitive["material"] = len(self.document["materials"]) - 1
        self._append("meshes", {"name": name, "primitives": [primitive]})
        self._append("nodes", {"name": name, "mesh": len(self.document["meshes"]) - 1})

    def points(self, points_m: NDArray[np.float32]) -> int:
        """An accessor of positions; returns its number."""
        data = np.ascontiguousarray(points_m, "<f4")
        view = self._view(data.tobytes(), _ARRAY_BUFFER)
        bounds = {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
        return self._accessor({"componentType": _FLOAT, "count": len(data), "type": "VEC3", **bounds}, view)

    def indices(self, faces: NDArray[np.uint32]) -> int:
        """An accessor of indices; returns its number."""
        view = self._view(np.ascontiguousarray(faces, "<u4").tobytes(), _ELEMENT_BUFFER)
        return self._accessor({"componentType": _UINT, "count": faces.size, "type": "SCALAR"}, view)

    def _view(self, data: bytes, target: int) -> int:
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), "target": target}
        self.data += data
        return self._append("bufferViews", view)

    def _accessor(self, accessor: dict[str, Any], view: int) -> int:
        return self._append("accessors", {"bufferView": view, **accessor})

    def _append(self, kind: str, item: dict[str, Any]) -> int:
        self.document[kind].append(item)
        return len(self.document[kind]) - 1


def write_glb(model: Model3d, path: Path) -> None:
    """Raises `ExportError`."""
    writer = _Writer()
    for piece in model.triangles:
        primitive = {"attributes": {"POSITION": writer.points(piece.vertices_m)}, "mode": _TRIANGLES}
        primitive["indices"] = writer.indices(piece.faces)
        writer.add(piece.name, primitive, piece.colour)
    for lines in model.lines:
        positions = writer.points(lines.points_m)
        writer.add(lines.name, {"attributes": {"POSITION": positions}, "mode": _LINES}, lines.colour)
    write_whole(path, _packed(writer))


def _packed(writer: _Writer) -> bytes:
    pieces = len(writer.document["nodes"])
    root: dict[str, Any] = {"name": "map", "rotation": _Y_UP}
    if pieces:
        root["children"] = list(range(pieces))
    document: dict[str, Any] = {key: items for key, items in writer.document.items() if items}
    document["nodes"] = [*writer.document["nodes"], root]
    document |= {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [pieces]}]}
    if writer.data:
        document["buffers"] = [{"byteLength": len(writer.data)}]
    text = json.dumps(document, separators=(",", ":")).encode()
    chunks = _chunk(b"JSON", text, b" ")
    if writer.data:
        chunks += _chunk(b"BIN\0", bytes(writer.data), b"\0")
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _chunk(kind: bytes, data: bytes, filler: bytes) -> bytes:
    padded = data + filler * (-len(data) % 4)
    return struct.pack("<I4s", len(padded), kind) + padded


def _linear(value: int) -> float:
    """From sRGB, as glTF wants it."""
    share = value / 255
    return round(share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4, 6)
