"""Pictures of maps, for people: free white, occupied near black, unknown grey, the way the robot went in colour."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter, ImageFont

from station_gui.export.files import write_whole
from station_gui.mapping.snapshot import OCCUPIED_PROBABILITY, GridMap

FloatArray = NDArray[np.float64]

_LONG_SIDE_PX = 1600
_MAX_PX_PER_CELL = 12
_MARGIN_PX = 28
_HEADER_PX = 64
_FOOTER_PX = 72
_PAPER = (250, 250, 248)
_INK = (38, 42, 48)
_FAINT = (122, 128, 136)
_UNKNOWN = 214
_OCCUPIED = 24
_START = (22, 140, 74)
_END = (204, 42, 42)
_CLOSURE = (238, 140, 24)
_WAY_FIRST = np.array((44, 108, 214.0))
_WAY_LAST = np.array((150, 58, 190.0))
_OVERSAMPLING = 2


def palette() -> list[tuple[int, int, int]]:
    """The colours that a map needs at least, with what lies between the coloured ones and white."""
    greys = [(v, v, v) for v in (255, 244, 234, 224, _UNKNOWN, 190, 150, 110, 75, 50, _OCCUPIED)]
    way = [tuple((_WAY_FIRST + (_WAY_LAST - _WAY_FIRST) * k / 3).astype(int).tolist()) for k in range(4)]
    inks = [*way, _START, _END, _CLOSURE]
    pale = [tuple(round(255 + (v - 255) * share) for v in ink) for ink in inks for share in (1.0, 0.6, 0.3)]
    return [_PAPER, _INK, _FAINT, *greys, *((r, g, b) for r, g, b in pale)]


@dataclass(frozen=True, slots=True)
class _Frame:
    """From map metres to picture pixels: `left_m` and `top_m` are the corner of the map's part that is shown."""

    left_m: float
    top_m: float
    px_per_m: float
    width_px: int
    height_px: int

    def pixels(self, points_m: FloatArray) -> list[tuple[float, float]]:
        """(N, 2) metres to oversampled pixels of the map's picture."""
        x = (points_m[:, 0] - self.left_m) * self.px_per_m * _OVERSAMPLING
        y = (self.top_m - points_m[:, 1]) * self.px_per_m * _OVERSAMPLING
        return list(zip(x.tolist(), y.tolist(), strict=True))


def draw_map(
    grid: GridMap, trajectory: FloatArray, closures: NDArray[np.int32], path: Path, *, title: str, subtitle: str = ""
) -> None:
    """Write a PNG with a scale bar; raises `ExportError`.

    `trajectory`: (K, 4) stamp, x, y, theta; `closures`: (L, 2) indices into it.
    """
    frame, shown = _fit(grid)
    shade = _shade(shown)
    if frame.px_per_m * grid.cell_m < 1:
        shade = shade.filter(ImageFilter.MinFilter(3))  # walls of one cell must not vanish between the pixels
    size = (frame.width_px * _OVERSAMPLING, frame.height_px * _OVERSAMPLING)
    picture = shade.resize(size, _filter(frame, grid))
    _draw_way(ImageDraw.Draw(picture, "RGBA"), frame, trajectory, closures)
    picture = picture.resize((frame.width_px, frame.height_px), Image.Resampling.LANCZOS)
    page = Image.new(
        "RGB",
        (max(frame.width_px, 560) + 2 * _MARGIN_PX, frame.height_px + _HEADER_PX + _FOOTER_PX + _MARGIN_PX),
        _PAPER,
    )
    left = (page.width - frame.width_px) // 2
    page.paste(picture, (left, _HEADER_PX))
    draw = ImageDraw.Draw(page)
    draw.rectangle((left - 1, _HEADER_PX - 1, left + frame.width_px, _HEADER_PX + frame.height_px), outline=_FAINT)
    draw.text((_MARGIN_PX, _HEADER_PX / 2), title, _INK, _font(26), anchor="lm")
    draw.text((page.width - _MARGIN_PX, _HEADER_PX / 2), subtitle, _FAINT, _font(18), anchor="rm")
    bottom = _HEADER_PX + frame.height_px
    _draw_scale(draw, frame, _MARGIN_PX, bottom + 34)
    _draw_legend(draw, page.width - _MARGIN_PX, bottom + 34, with_closures=len(closures) > 0)
    data = io.BytesIO()
    page.save(data, "PNG")
    write_whole(path, data.getvalue())


def _fit(grid: GridMap) -> tuple[_Frame, FloatArray]:
    """The part of the map that is known, with a rim, and how it comes onto the page; rows from the top."""
    rows, columns = _known_part(grid)
    shown = grid.probability[rows.start : rows.stop, columns.start : columns.stop][::-1].astype(np.float64)
    cells = max(shown.shape)
    px_per_cell = min(_LONG_SIDE_PX / cells, _MAX_PX_PER_CELL)
    frame = _Frame(
        grid.origin_m[0] + columns.start * grid.cell_m,
        grid.origin_m[1] + rows.stop * grid.cell_m,
        px_per_cell / grid.cell_m,
        max(1, round(shown.shape[1] * px_per_cell)),
        max(1, round(shown.shape[0] * px_per_cell)),
    )
    return frame, shown


def _known_part(grid: GridMap) -> tuple[slice, slice]:
    """Without the few far cells that single beams through doors and windows reached."""
    occupied = grid.probability > OCCUPIED_PROBABILITY
    if not occupied.any():
        occupied = np.ones_like(occupied)
    rim = max(2, round(0.4 / grid.cell_m))
    return _range_of(occupied.sum(axis=1), rim), _range_of(occupied.sum(axis=0), rim)


def _range_of(weight: NDArray[np.int64], rim: int) -> slice:
    share = np.cumsum(weight) / weight.sum()
    first, last = int(np.searchsorted(share, 0.001)), int(np.searchsorted(share, 0.999))
    return slice(max(0, first - rim), min(len(weight), last + 1 + rim))


def _shade(probability: FloatArray) -> Image.Image:
    """Free cells go to white, occupied ones to near black, unknown ones stay grey."""
    free = np.interp(probability, (0.1, 0.5), (255.0, float(_UNKNOWN)))
    occupied = np.interp(probability, (0.5, 0.9), (float(_UNKNOWN), float(_OCCUPIED)))
    grey = np.where(probability > 0.5, occupied, free).astype(np.uint8)
    return Image.fromarray(np.repeat(grey[:, :, np.newaxis], 3, axis=2), "RGB")


def _filter(frame: _Frame, grid: GridMap) -> Image.Resampling:
    """Cells stay square when enlarged; when reduced, none is left out."""
    enlarged = frame.px_per_m * grid.cell_m * _OVERSAMPLING >= 1
    return Image.Resampling.NEAREST if enlarged else Image.Resampling.BOX


def _draw_way(draw: ImageDraw.ImageDraw, frame: _Frame, trajectory: FloatArray, closures: NDArray[np.int32]) -> None:
    if len(trajectory) == 0:
        return
    points = frame.pixels(trajectory[:, 1:3])
    for a, b in closures.tolist():
        draw.line((points[a], points[b]), (*_CLOSURE, 120), 2 * _OVERSAMPLING)
    width = max(2, round(1.5 * _OVERSAMPLING))
    for k in range(1, len(points)):
        colour = _WAY_FIRST + (_WAY_LAST - _WAY_FIRST) * k / len(points)
        draw.line((points[k - 1], points[k]), (*(int(v) for v in colour), 210), width)
    for (x, y), colour in ((points[0], _START), (points[-1], _END)):
        r = 7 * _OVERSAMPLING
        draw.ellipse((x - r, y - r, x + r, y + r), fill=colour, outline="white", width=2 * _OVERSAMPLING)


def _draw_scale(draw: ImageDraw.ImageDraw, frame: _Frame, left: float, y: float) -> None:
    """A bar of 1, 2 or 5 times a power of ten metres, up to a fifth of the picture."""
    wanted_m = max(frame.width_px, 400) / 5 / frame.px_per_m
    decade = 10.0 ** math.floor(math.log10(wanted_m))
    length_m = next(step * decade for step in (5, 2, 1) if step * decade <= wanted_m)
    right = left + length_m * frame.px_per_m
    draw.line((left, y, right, y), _INK, 4)
    for x in (left, right):
        draw.line((x, y - 8, x, y + 8), _INK, 3)
    label = f"{length_m:g} m" if length_m >= 1 else f"{100 * length_m:g} cm"
    draw.text((right + 14, y), label, _INK, _font(20), anchor="lm")


def _draw_legend(draw: ImageDraw.ImageDraw, right: float, y: float, *, with_closures: bool) -> None:
    font = _font(18)
    entries = [("end", _END, True), ("start", _START, True), ("path", tuple(_WAY_FIRST.astype(int).tolist()), False)]
    if with_closures:
        entries.append(("loop closures", _CLOSURE, False))
    for text, colour, is_dot in entries:
        right -= draw.textlength(text, font)
        draw.text((right, y), text, _FAINT, font, anchor="lm")
        if is_dot:
            draw.ellipse((right - 22, y - 6, right - 10, y + 6), fill=colour)
        else:
            draw.line((right - 34, y, right - 10, y), colour, 4)
        right -= 52


def _font(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size_px)
