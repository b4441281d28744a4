"""The occupancy grid as a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PySide6.QtGui import QColor

from station_gui.mapping.snapshot import OCCUPIED_PROBABILITY, GridMap
from station_gui.qt import theme

MAX_SIDE_PX = 2048  # every OpenGL since 2.1 takes a texture of this size
_KNOWN = 0.02  # a cell this near to 0.5 has told nothing yet


@dataclass(frozen=True, slots=True)
class Extent:
    """A rectangle of the map."""

    left_m: float
    bottom_m: float
    width_m: float
    height_m: float


@dataclass(frozen=True, slots=True, eq=False)
class GridPicture:
    """`levels` (rows, columns) uint8, row 0 the lowest y: 0 free to 255 occupied; None where there is no cell."""

    levels: NDArray[np.uint8] | None
    extent: Extent  # of all of the picture
    known: Extent | None  # of the cells that were ever seen


def make_picture(grid: GridMap) -> GridPicture:
    """A picture of the grid, at most `MAX_SIDE_PX` on each side: there an occupied cell hides its neighbours."""
    probability = np.nan_to_num(np.asarray(grid.probability, np.float32), nan=0.5, posinf=1.0, neginf=0.0)
    usable = probability.ndim == 2 and probability.size > 0 and np.isfinite(grid.cell_m) and grid.cell_m > 0
    if not usable or not np.isfinite(grid.origin_m).all():
        return GridPicture(None, Extent(0.0, 0.0, 0.0, 0.0), None)
    step = -(-max(probability.shape) // MAX_SIDE_PX)
    if step > 1:
        probability = _block_maximum(probability, step)
    cell_m = grid.cell_m * step
    rows, columns = probability.shape
    extent = Extent(grid.origin_m[0], grid.origin_m[1], columns * cell_m, rows * cell_m)
    levels = (np.clip(probability, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    return GridPicture(levels, extent, _known_extent(probability, extent, cell_m))


def cropped(picture: GridPicture, margin_m: float) -> GridPicture:
    """The part of the picture that was seen, with a margin around it; all of it where nothing was seen yet."""
    levels, extent, known = picture.levels, picture.extent, picture.known
    if levels is None or known is None:
        return picture
    cell_m = extent.width_m / levels.shape[1]
    margin = round(margin_m / cell_m)
    left = max(0, round((known.left_m - extent.left_m) / cell_m) - margin)
    bottom = max(0, round((known.bottom_m - extent.bottom_m) / cell_m) - margin)
    right = round((known.left_m + known.width_m - extent.left_m) / cell_m) + margin
    top = round((known.bottom_m + known.height_m - extent.bottom_m) / cell_m) + margin
    part = levels[bottom:top, left:right]
    rows, columns = part.shape
    corner_m = extent.left_m + left * cell_m, extent.bottom_m + bottom * cell_m
    return GridPicture(part, Extent(*corner_m, columns * cell_m, rows * cell_m), known)


def _block_maximum(probability: NDArray[np.float32], step: int) -> NDArray[np.float32]:
    rows, columns = probability.shape
    padded = np.pad(probability, ((0, -rows % step), (0, -columns % step)), constant_values=0.0)
    blocks: NDArray[np.float32] = padded.reshape(padded.shape[0] // step, step, padded.shape[1] // step, step)
    return np.asarray(blocks.max(axis=(1, 3)), np.float32)


def _known_extent(probability: NDArray[np.float32], extent: Extent, cell_m: float) -> Extent | None:
    known = np.abs(probability - 0.5) > _KNOWN
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if len(rows) == 0:
        return None
    return Extent(
        extent.left_m + float(columns[0]) * cell_m,
        extent.bottom_m + float(rows[0]) * cell_m,
        float(columns[-1] - columns[0] + 1) * cell_m,
        float(rows[-1] - rows[0] + 1) * cell_m,
    )


def colour_table() -> NDArray[np.uint8]:
    """(256, 4) RGBA for `GridPicture.levels`: white free, grey unknown, dark from the paper's threshold on."""
    free, unknown, occupied = (_rgb(c) for c in (theme.MAP_FREE, theme.MAP_UNKNOWN, theme.MAP_OCCUPIED))
    # Scanned-once cells already look free or occupied; between stays a soft step.
    knots = np.array([0.0, 0.25, 0.45, 0.55, OCCUPIED_PROBABILITY, 1.0]) * 255
    colours = np.array([free, free, unknown, unknown, occupied, occupied])
    levels = np.arange(256)
    table = np.full((256, 4), 255.0)
    for channel in range(3):
        table[:, channel] = np.interp(levels, knots, colours[:, channel])
    return np.round(table).astype(np.uint8)


def _rgb(name: str) -> tuple[int, int, int]:
    colour = QColor(name)
    return colour.red(), colour.green(), colour.blue()
