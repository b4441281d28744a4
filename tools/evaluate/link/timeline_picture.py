"""A picture of when observations came: each one a stroke, their rate above it, and what happened meanwhile."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Span = tuple[str, float, float]  # what, from, to

_SIZE = (1600, 420)
_LEFT, _RIGHT, _TOP, _BOTTOM = 70, 30, 70, 60
_STROKES = 60
_PAPER, _INK, _FAINT, _RATE, _STROKE = (250, 250, 248), (38, 42, 48), (190, 194, 200), (44, 108, 214), (38, 42, 48)
_INCIDENT, _INCIDENT_INK = (250, 222, 214), (190, 52, 30)
_WINDOW_S = 1.0
_TICK_S = 10


def draw_timeline(came_s: NDArray[np.float64], spans: list[Span], path: Path, *, title: str) -> None:
    """Write a PNG. `came_s` begins at about 0."""
    page = Image.new("RGB", _SIZE, _PAPER)
    draw = ImageDraw.Draw(page)
    end_s = float(came_s[-1]) if len(came_s) else 1.0
    rates = _rates(came_s, end_s)
    most = max(1.0, float(np.ceil(rates.max(initial=1.0) / 2) * 2))
    floor = _SIZE[1] - _BOTTOM - _STROKES

    def x_of(time_s: float) -> float:
        return _LEFT + time_s / end_s * (_SIZE[0] - _LEFT - _RIGHT)

    def y_of(rate: float) -> float:
        return floor - rate / most * (floor - _TOP)

    for name, from_s, to_s in spans:
        draw.rectangle((x_of(from_s), _TOP, max(x_of(to_s), x_of(from_s) + 3), _SIZE[1] - _BOTTOM), fill=_INCIDENT)
        draw.text((x_of(from_s), _TOP - 4), name, _INCIDENT_INK, _font(16), anchor="ls")
    for rate in range(0, int(most) + 1, 2):
        draw.line((_LEFT, y_of(rate), _SIZE[0] - _RIGHT, y_of(rate)), _FAINT)
        draw.text((_LEFT - 8, y_of(rate)), str(rate), _INK, _font(15), anchor="rm")
    line = [(x_of(k * _WINDOW_S / 4), y_of(float(rate))) for k, rate in enumerate(rates)]
    draw.line(line, _RATE, 3)
    for time_s in came_s:
        draw.line((x_of(float(time_s)), floor + 12, x_of(float(time_s)), _SIZE[1] - _BOTTOM), _STROKE)
    for time_s in range(0, int(end_s) + 1, _TICK_S):
        draw.text((x_of(time_s), _SIZE[1] - _BOTTOM + 8), f"{time_s} s", _INK, _font(15), anchor="mt")
    draw.text((_LEFT, 26), title, _INK, _font(24), anchor="lm")
    draw.text((_SIZE[0] - _RIGHT, 26), "observations a second; below, each one", _FAINT, _font(16), anchor="rm")
    page.save(path)


def _rates(came_s: NDArray[np.float64], end_s: float) -> NDArray[np.float64]:
    """Within a second round each quarter of a second."""
    middles_s = np.arange(0.0, end_s, _WINDOW_S / 4)
    high = np.searchsorted(came_s, middles_s + _WINDOW_S / 2)
    return (high - np.searchsorted(came_s, middles_s - _WINDOW_S / 2)) / _WINDOW_S


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
