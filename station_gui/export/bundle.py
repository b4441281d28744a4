"""The map in every format at once."""

from __future__ import annotations

from pathlib import Path

from station_gui.export.gltf import write_glb
from station_gui.export.map_picture import draw_map
from station_gui.export.model3d import make_model
from station_gui.export.nav2 import write_nav2
from station_gui.export.ply import write_ply
from station_gui.export.tum import write_tum
from station_gui.mapping.snapshot import MapSnapshot


def export_map(snapshot: MapSnapshot, folder: Path, title: str = "Map") -> list[Path]:
    """Write `map.yaml`, `map.pgm`, `map.png`, `map.ply`, `map.glb`, `trajectory.tum`; returns them.

    Each file is written whole or not at all. Raises `ExportError`.
    """
    model = make_model(snapshot)
    written = list(write_nav2(snapshot.grid, folder / "map.yaml"))
    picture, ply, glb, way = (folder / name for name in ("map.png", "map.ply", "map.glb", "trajectory.tum"))
    draw_map(snapshot.grid, snapshot.trajectory, snapshot.closures, picture, title=title)
    write_ply(model, ply)
    write_glb(model, glb)
    write_tum(way, snapshot.trajectory)
    return [*written, picture, ply, glb, way]
