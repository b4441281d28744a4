"""The occupancy grid as Nav2's map server reads it: `map.yaml` and the picture `map.pgm` that it names.

By the rules of nav2_map_server in the mode "trinary": a pixel of value v stands for an occupancy of
(255 - v) / 255; above `occupied_thresh` the cell is occupied, below `free_thresh` free, else unknown. The picture's
first row is the highest y, `origin` is the lower left corner of the lower left pixel.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from station_gui.export.files import write_whole
from station_gui.mapping.snapshot import OCCUPIED_PROBABILITY, GridMap

_FREE_PROBABILITY = 0.45  # what the planning takes for free
_OCCUPIED_PX, _UNKNOWN_PX, _FREE_PX = 0, 205, 254  # those of map_saver
_OCCUPIED_THRESH, _FREE_THRESH = 0.65, 0.196  # 205 lies between: (255 - 205) / 255 = 0.19608


def write_nav2(grid: GridMap, yaml_path: Path) -> tuple[Path, Path]:
    """Write the yaml and beside it the pgm; returns both. Raises `ExportError`."""
    pgm_path = yaml_path.with_suffix(".pgm")
    pixels = _pixels(grid)[::-1]
    rows, columns = pixels.shape
    write_whole(pgm_path, f"P5\n{columns} {rows}\n255\n".encode() + pixels.tobytes())
    text = (
        f"image: {pgm_path.name}\n"
        "mode: trinary\n"
        f"resolution: {grid.cell_m:.9g}\n"
        f"origin: [{grid.origin_m[0]:.9g}, {grid.origin_m[1]:.9g}, 0.0]\n"
        "negate: 0\n"
        f"occupied_thresh: {_OCCUPIED_THRESH}\n"
        f"free_thresh: {_FREE_THRESH}\n"
    )
    write_whole(yaml_path, text.encode())
    return yaml_path, pgm_path


def _pixels(grid: GridMap) -> NDArray[np.uint8]:
    """(rows, columns), row 0 the lowest y."""
    pixels = np.full(grid.probability.shape, _UNKNOWN_PX, np.uint8)
    pixels[grid.probability <= _FREE_PROBABILITY] = _FREE_PX
    pixels[grid.probability > OCCUPIED_PROBABILITY] = _OCCUPIED_PX
    return pixels
