"""`evaluate surfaces`: what the fuzzy controllers answer to all that they can be asked, as `robot.toml` has them.

Each of the five rule tables over its two quantities, from a tenth of the scale below the first peak to as much above
the last. The marks on the scales are the peaks of the sets.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from robot_app.config import ControlConfig, OmniRobotConfig, load_any_config
from robot_app.control.fuzzy import RuleTable, Variable
from shared.command_line import EXIT_OK, Refused

_CELLS = 81
_PANEL, _PLOT, _LEFT, _TOP, _COLUMNS = (430, 400), 243, 120, 46, 3
_LOW, _MIDDLE, _HIGH = np.array([36, 90, 160]), np.array([246, 244, 238]), np.array([190, 60, 40])
_Font = ImageFont.ImageFont | ImageFont.FreeTypeFont
_INK, _FAINT = (40, 40, 46), (120, 118, 112)


@dataclass(frozen=True, slots=True)
class Surface:
    """`low` and `high`: what the ends of its colours stand for; `unit` follows the numbers."""

    title: str
    table: RuleTable
    low: float
    high: float
    levels: tuple[float, ...] = ()  # of an output that is a level: the speed at each

    def values(self) -> NDArray[np.float64]:
        """(rows, columns), the first quantity upwards."""
        rows, columns = (_scale(v) for v in (self.table.rows, self.table.columns))
        answers = np.array([[self.table(r, c) for c in columns.tolist()] for r in rows.tolist()])
        if not self.levels:
            return answers
        return np.asarray(np.interp(answers, np.arange(len(self.levels)), self.levels), np.float64)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", metavar="FILE", type=Path, help="robot.toml instead of the one that comes along")
    parser.add_argument("--picture", metavar="FILE", type=Path, help="draw them into this PNG file")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    config = load_any_config(args.robot)
    if isinstance(config, OmniRobotConfig):
        raise Refused(f"{args.robot}: is that of an omnidirectional robot; what is drawn are a car's rules")
    surfaces = surfaces_of(config.control)
    if args.picture is not None:
        draw(surfaces).save(args.picture)
    spans = {s.title: [round(float(s.values().min()), 4), round(float(s.values().max()), 4)] for s in surfaces}
    if args.json:
        print(json.dumps(spans))
    else:
        for title, (low, high) in spans.items():
            print(f"{title:44} {low:7.3f} to {high:6.3f}")
    return EXIT_OK


def surfaces_of(control: ControlConfig) -> tuple[Surface, ...]:
    wall, path = control.wall, control.path
    wall_speeds = (0.0, wall.slow_mps, wall.medium_mps, wall.fast_mps)
    path_speeds = (0.0, path.slow_mps, path.medium_mps, path.fast_mps)
    return (
        Surface("wall: steering, of the sharpest", wall.rules.steering, -1.0, 1.0),
        Surface("wall: turn away, of the sharpest", wall.rules.turn_away, 0.0, 1.0),
        Surface("wall: speed, m/s", wall.rules.speed, 0.0, wall.fast_mps, wall_speeds),
        Surface("path: correction, of full steering", path.rules.steering, -1.0, 1.0),
        Surface("path: speed, m/s", path.rules.speed, 0.0, path.fast_mps, path_speeds),
    )


def draw(surfaces: tuple[Surface, ...]) -> Image.Image:
    rows = -(-len(surfaces) // _COLUMNS)
    sheet = Image.new("RGB", (_COLUMNS * _PANEL[0], rows * _PANEL[1]), (255, 255, 255))
    for k, surface in enumerate(surfaces):
        sheet.paste(_panel(surface), ((k % _COLUMNS) * _PANEL[0], (k // _COLUMNS) * _PANEL[1]))
    return sheet


def _scale(variable: Variable) -> NDArray[np.float64]:
    low, high = variable.sets[0].centre, variable.sets[-1].centre
    margin = 0.1 * (high - low)
    return np.linspace(low - margin, high + margin, _CELLS)


def _panel(surface: Surface) -> Image.Image:
    panel = Image.new("RGB", _PANEL, (255, 255, 255))
    pen, font = ImageDraw.Draw(panel), ImageFont.load_default(13)
    share = (surface.values() - surface.low) / (surface.high - surface.low)
    plot = Image.fromarray(_colours(share[::-1])).resize((_PLOT, _PLOT), Image.Resampling.NEAREST)
    panel.paste(plot, (_LEFT, _TOP))
    pen.rectangle((_LEFT, _TOP, _LEFT + _PLOT, _TOP + _PLOT), outline=_INK)
    pen.text((_LEFT, 8), surface.title, fill=_INK, font=ImageFont.load_default(15))
    pen.text((_LEFT, 27), f"up: {surface.table.rows.name}", fill=_FAINT, font=font)
    pen.text((_LEFT, _TOP + _PLOT + 56), f"right: {surface.table.columns.name}", fill=_FAINT, font=font)
    _mark_rows(pen, surface.table.rows, font)
    _mark_columns(pen, surface.table.columns, font)
    _key(panel, pen, surface, font)
    return panel


def _colours(share: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Blue below the middle, red above it."""
    below, above = np.clip(1 - 2 * share, 0, 1)[..., None], np.clip(2 * share - 1, 0, 1)[..., None]
    mixed = _MIDDLE * (1 - below - above) + _LOW * below + _HIGH * above
    return np.asarray(np.clip(mixed, 0, 255), np.uint8)


def _at(variable: Variable, value: float) -> float:
    """From 0 to 1 along the scale."""
    scale = _scale(variable)
    return float((value - scale[0]) / (scale[-1] - scale[0]))


def _mark_rows(pen: ImageDraw.ImageDraw, variable: Variable, font: _Font) -> None:
    for item in variable.sets:
        y = _TOP + _PLOT - _at(variable, item.centre) * _PLOT
        pen.line((_LEFT - 5, y, _LEFT, y), fill=_INK)
        pen.text((_LEFT - 9, y), f"{item.name} {item.centre:g}", fill=_INK, font=font, anchor="rm")


def _mark_columns(pen: ImageDraw.ImageDraw, variable: Variable, font: _Font) -> None:
    for k, item in enumerate(variable.sets):
        x = _LEFT + _at(variable, item.centre) * _PLOT
        pen.line((x, _TOP + _PLOT, x, _TOP + _PLOT + 5), fill=_INK)
        at_y = _TOP + _PLOT + 7 + 15 * (k % 3)
        pen.text((x, at_y), f"{item.name} {item.centre:g}", fill=_INK, font=font, anchor="ma")


def _key(
    panel: Image.Image,
    pen: ImageDraw.ImageDraw,
    surface: Surface,
    font: _Font,
) -> None:
    shades = np.repeat(np.linspace(1, 0, _PLOT)[:, None], 12, axis=1)
    left = _LEFT + _PLOT + 12
    panel.paste(Image.fromarray(_colours(shades)), (left, _TOP))
    for share in (0.0, 0.5, 1.0):
        value = surface.low + share * (surface.high - surface.low)
        pen.text((left + 17, _TOP + (1 - share) * _PLOT), f"{value:.2g}", fill=_INK, font=font, anchor="lm")
