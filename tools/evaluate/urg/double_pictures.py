"""What a wall that is there twice is made of: its points, along and across it, coloured by scan and by range."""

from __future__ import annotations

import colorsys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from tools.evaluate.urg.cloud import Cloud
from tools.evaluate.urg.wall_line import FloatArray, WallLine

_PANEL_PX = (700, 420)
_LEFT_PX, _RIGHT_PX, _TOP_PX, _BOTTOM_PX = 64, 24, 56, 40
_BEYOND_M = 0.5  # of the wall on each side of what is double
_BESIDE_M = 0.4
_FACING_COS = 0.866
_INK, _FAINT = (38, 42, 48), (214, 214, 214)
_HUES = 0.7  # from red, the last and farthest, to blue
_TICK_M = 0.1


def draw_double(cloud: Cloud, line: WallLine, span_m: tuple[float, float], path: Path, *, title: str) -> None:
    """`span_m`: from where to where along the line something is double."""
    across_m, along_m = line.across_m(cloud.points_m), cloud.points_m @ line.along - span_m[0]
    length_m = span_m[1] - span_m[0]
    shown = (along_m > -_BEYOND_M) & (along_m < length_m + _BEYOND_M) & (np.abs(across_m) < _BESIDE_M)
    shown &= cloud.normals @ line.normal > _FACING_COS
    range_m = np.hypot(*(cloud.points_m - cloud.origins_m).T)[shown]
    scan = cloud.scan[shown]
    panels = [
        _panel(along_m[shown], across_m[shown], scan, length_m, f"by scan, {scan.min()} (blue) to {scan.max()} (red)"),
        _panel(
            along_m[shown], across_m[shown], range_m, length_m,
            f"by range, {range_m.min():.1f} m (blue) to {range_m.max():.1f} m (red)",
        ),
    ]  # fmt: skip
    page = Image.new("RGB", (2 * _PANEL_PX[0], _PANEL_PX[1]), "white")
    for k, panel in enumerate(panels):
        page.paste(panel, (k * _PANEL_PX[0], 0))
    ImageDraw.Draw(page).text((_LEFT_PX, 8), title, fill=_INK, font=ImageFont.load_default(16))
    page.save(path, optimize=True)


def _panel(
    along_m: FloatArray, across_m: FloatArray, value: NDArray[np.floating] | NDArray[np.int64], length_m: float,
    words: str,
) -> Image.Image:  # fmt: skip
    """Metres along (right) and across (up); what is double lies between the two upright lines."""
    image = Image.new("RGB", _PANEL_PX, "white")
    draw = ImageDraw.Draw(image)
    width_m = length_m + 2 * _BEYOND_M
    x_px = _LEFT_PX + (along_m + _BEYOND_M) / width_m * (_PANEL_PX[0] - _LEFT_PX - _RIGHT_PX)
    y_px = _height_px(across_m)
    font = ImageFont.load_default(13)
    for tick_m in np.arange(-_BESIDE_M, _BESIDE_M + _TICK_M / 2, _TICK_M).tolist():
        at_px = float(_height_px(np.array([tick_m]))[0])
        draw.line((_LEFT_PX, at_px, _PANEL_PX[0] - _RIGHT_PX, at_px), fill=_FAINT)
        draw.text((8, at_px - 8), f"{tick_m:5.1f} m", fill=_INK, font=font)
    for end_m in (0.0, length_m):
        at_px = _LEFT_PX + (end_m + _BEYOND_M) / width_m * (_PANEL_PX[0] - _LEFT_PX - _RIGHT_PX)
        draw.line((at_px, _TOP_PX, at_px, _PANEL_PX[1] - _BOTTOM_PX), fill=_INK)
        draw.text((at_px - 14, _PANEL_PX[1] - _BOTTOM_PX + 6), f"{end_m:.1f} m", fill=_INK, font=font)
    draw.text((_LEFT_PX, 32), words, fill=_INK, font=font)
    share = (value - value.min()) / max(float(np.ptp(value)), 1e-9)
    for x, y, s in zip(x_px.tolist(), y_px.tolist(), share.tolist(), strict=True):
        draw.ellipse((x - 1.5, y - 1.5, x + 1.5, y + 1.5), fill=_colour(s))
    return image


def _height_px(across_m: FloatArray) -> FloatArray:
    return np.asarray(
        _TOP_PX + (_BESIDE_M - across_m) / (2 * _BESIDE_M) * (_PANEL_PX[1] - _TOP_PX - _BOTTOM_PX), np.float64
    )


def _colour(share: float) -> tuple[int, int, int]:
    r, g, b = colorsys.hsv_to_rgb(_HUES * (1 - share), 0.95, 0.88)
    return round(255 * r), round(255 * g), round(255 * b)
