"""Pictures of trials: all maps laid over one another (paper 1, figure 17), and a map beside the truth (15 and 18)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from station_gui.mapping.snapshot import ObjectKind
from tools.evaluate.mapping.trial import Trial
from tools.simulator.scenario import Scenario
from tools.simulator.solids import Solid, solids_of

FloatArray = NDArray[np.float64]
Colour = tuple[int, int, int]

_LONG_SIDE_PX = 900
_MARGIN_PX = 30
_HEADER_PX = 44
_OVERSAMPLING = 2
_PAPER, _INK, _TRUTH = (250, 250, 248), (38, 42, 48), (205, 205, 200)
_LARGE, _SMALL, _ROBOT = (205, 45, 40), (40, 75, 205), (30, 150, 80)
_FREE, _OCCUPIED = (255, 255, 255), (120, 124, 130)
_BOX, _WALL = (206, 178, 138), (170, 170, 176)
_FREE_BELOW = 0.4
_AZIMUTH_RAD, _ELEVATION_RAD = math.radians(28.0), math.radians(38.0)


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """From room metres to pixels: from above, or slanting down on the room from the south."""

    slanting: bool
    px_per_m: float
    left: float
    top: float
    size: tuple[int, int]

    @staticmethod
    def of(scenario: Scenario, *, slanting: bool) -> _View:
        room = scenario.room
        x, y = (-0.1, room.length_x_m + 0.1), (-0.1, room.width_y_m + 0.1)
        corners = np.array([(a, b, c) for a in x for b in y for c in (0.0, room.wall_height_m)])
        flat = _project(corners, slanting=slanting)
        low, high = flat.min(axis=0), flat.max(axis=0)
        scale = _LONG_SIDE_PX / float((high - low).max())
        width, height = ((high - low) * scale).round().astype(int).tolist()
        return _View(slanting, scale * _OVERSAMPLING, float(low[0]), float(high[1]), (width, height))

    def pixels(self, points_m: NDArray[np.floating]) -> list[tuple[float, float]]:
        """(N, 3) room frame to oversampled pixels."""
        flat = _project(np.asarray(points_m, dtype=np.float64), slanting=self.slanting)
        x, y = (flat[:, 0] - self.left) * self.px_per_m, (self.top - flat[:, 1]) * self.px_per_m
        return list(zip(x.tolist(), y.tolist(), strict=True))

    def canvas(self) -> Image.Image:
        return Image.new("RGB", (self.size[0] * _OVERSAMPLING, self.size[1] * _OVERSAMPLING), _PAPER)

    def finished(self, canvas: Image.Image) -> Image.Image:
        return canvas.resize(self.size, Image.Resampling.LANCZOS)


def _project(points_m: FloatArray, *, slanting: bool) -> FloatArray:
    """(N, 3) to (N, 2), right and up."""
    if not slanting:
        return points_m[:, :2]
    c, s = math.cos(_AZIMUTH_RAD), math.sin(_AZIMUTH_RAD)
    across, away = c * points_m[:, 0] - s * points_m[:, 1], s * points_m[:, 0] + c * points_m[:, 1]
    up = away * math.sin(_ELEVATION_RAD) + points_m[:, 2] * math.cos(_ELEVATION_RAD)
    return np.column_stack((across, up))


def draw_overlay(trials: list[Trial], path: Path, title: str) -> None:
    """The occupied cells of all trials, a colour for each, and the edges of all, both from above over the truth."""
    view = _View.of(trials[0].truth.scenario, slanting=False)
    cells, edges = view.canvas(), view.canvas()
    for canvas in (cells, edges):
        _draw_outlines(ImageDraw.Draw(canvas), view, trials[0].truth.scenario)
    colours = _spectrum(len(trials))
    for trial, colour in zip(trials, colours, strict=True):
        _draw_cells(ImageDraw.Draw(cells, "RGBA"), view, trial.occupied_m, trial.snapshot.grid.cell_m, (*colour, 110))
        _draw_edges(ImageDraw.Draw(edges, "RGBA"), view, trial, 110)
    _save([("2D maps", cells), ("3D maps", edges)], view, path, title)


def draw_beside_truth(trial: Trial, path: Path, title: str) -> None:
    """The 3D map over its floor, and the true boxes, seen from the same place."""
    view = _View.of(trial.truth.scenario, slanting=True)
    mapped, true = view.canvas(), view.canvas()
    draw = ImageDraw.Draw(mapped)
    _draw_floor(draw, view, trial)
    _draw_edges(ImageDraw.Draw(mapped, "RGBA"), view, trial, 255)
    _draw_robot(draw, view, trial)
    inner = {item.name for item in trial.truth.scenario.items if item.kind == "wall"}
    for solid in _from_behind(solids_of(trial.truth.scenario)):
        _draw_solid(ImageDraw.Draw(true, "RGBA"), view, solid, 70 if solid.name in inner else 255)
    _save([("map", mapped), ("truth", true)], view, path, title)


def _draw_outlines(draw: ImageDraw.ImageDraw, view: _View, scenario: Scenario) -> None:
    for solid in solids_of(scenario):
        if solid.reaches(scenario.car.scanner_z_m):
            draw.polygon(view.pixels(_lifted(solid.corners_m(), 0.0)), fill=(238, 236, 230), outline=_TRUTH)


def _draw_cells(
    draw: ImageDraw.ImageDraw, view: _View, cells_m: FloatArray, cell_m: float, fill: tuple[int, int, int, int]
) -> None:
    half = cell_m / 2 * view.px_per_m
    for x, y in view.pixels(_lifted(cells_m, 0.0)):
        draw.rectangle((x - half, y - half, x + half, y + half), fill=fill)


def _draw_edges(draw: ImageDraw.ImageDraw, view: _View, trial: Trial, alpha: int) -> None:
    kinds = trial.objects.kind
    for kind, colour in ((ObjectKind.LARGE, _LARGE), (ObjectKind.SMALL, _SMALL)):
        ends = view.pixels(trial.objects.segments_m[kinds == kind].reshape(-1, 3))
        for a, b in zip(ends[::2], ends[1::2], strict=True):
            draw.line((a, b), (*colour, alpha), 2 * _OVERSAMPLING)


def _draw_floor(draw: ImageDraw.ImageDraw, view: _View, trial: Trial) -> None:
    grid = trial.snapshot.grid
    draw.rectangle((0, 0, *draw.im.size), fill=_PAPER)
    rows, columns = np.nonzero(grid.probability < _FREE_BELOW)
    free_m = np.column_stack((grid.origin_m[0] + (columns + 0.5) * grid.cell_m,
                              grid.origin_m[1] + (rows + 0.5) * grid.cell_m))  # fmt: skip
    for cells_m, fill in ((free_m, _FREE), (grid.occupied_m(), _OCCUPIED)):
        half = grid.cell_m / 2
        square = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
        corners_m = trial.room_from_map.apply((cells_m[:, None] + square).reshape(-1, 2))
        flat = view.pixels(_lifted(corners_m, 0.0))
        for k in range(0, len(flat), 4):
            draw.polygon(flat[k : k + 4], fill=fill)


def _draw_robot(draw: ImageDraw.ImageDraw, view: _View, trial: Trial) -> None:
    car = trial.truth.scenario.car
    half = car.width_m / 2
    body = np.array([(-car.rear_m, -half), (car.front_m, -half), (car.front_m, half), (-car.rear_m, half)])
    room_from_robot = trial.room_from_map @ trial.snapshot.map_from_robot
    for height_m in np.linspace(0.0, car.height_m, 12):
        draw.polygon(view.pixels(_lifted(room_from_robot.apply(body), float(height_m))), fill=_ROBOT)


def _draw_solid(draw: ImageDraw.ImageDraw, view: _View, solid: Solid, alpha: int) -> None:
    """The faces towards the viewer, who looks from the south."""
    wall = solid.name.startswith("wall_")
    colour, corners = (_WALL if wall else _BOX), solid.corners_m()
    low_m, high_m = solid.center_m[2] - solid.half_m[2], solid.center_m[2] + solid.half_m[2]
    low, high = view.pixels(_lifted(corners, low_m)), view.pixels(_lifted(corners, high_m))
    for k in range(4):
        n = (k + 1) % 4
        out = np.array([corners[n][1] - corners[k][1], corners[k][0] - corners[n][0]])
        facing = out @ np.array([math.sin(_AZIMUTH_RAD), math.cos(_AZIMUTH_RAD)])
        if facing < 0:
            shade = 0.72 + 0.16 * abs(float(facing)) / float(np.hypot(*out))
            draw.polygon([low[k], low[n], high[n], high[k]], fill=(*_shaded(colour, shade), alpha), outline=_INK)
    draw.polygon(high, fill=(*colour, alpha), outline=_INK)


def _from_behind(solids: tuple[Solid, ...]) -> Iterator[Solid]:
    """Without the two outer walls that would hide the room; low before high, far before near."""
    depth = np.array([math.sin(_AZIMUTH_RAD), math.cos(_AZIMUTH_RAD)])
    shown = [solid for solid in solids if solid.name not in {"wall_south", "wall_west"}]
    walls = [solid for solid in shown if solid.name in {"wall_north", "wall_east"}]
    rest = [solid for solid in shown if solid not in walls]
    yield from walls
    yield from sorted(rest, key=lambda s: (-float((s.corners_m() @ depth).min()), s.center_m[2]))


def _save(panels: list[tuple[str, Image.Image]], view: _View, path: Path, title: str) -> None:
    width, height = view.size
    page = Image.new(
        "RGB", (len(panels) * width + (len(panels) + 1) * _MARGIN_PX, height + 2 * _HEADER_PX + _MARGIN_PX), _PAPER
    )
    draw = ImageDraw.Draw(page)
    draw.text((_MARGIN_PX, _HEADER_PX / 2), title, _INK, ImageFont.load_default(22), anchor="lm")
    for k, (name, canvas) in enumerate(panels):
        left = _MARGIN_PX + k * (width + _MARGIN_PX)
        draw.text((left, 1.5 * _HEADER_PX), name, _INK, ImageFont.load_default(18), anchor="lm")
        page.paste(view.finished(canvas), (left, 2 * _HEADER_PX))
    page.save(path)


def _lifted(points_m: FloatArray, height_m: float) -> FloatArray:
    return np.column_stack((points_m, np.full(len(points_m), height_m)))


def _shaded(colour: Colour, share: float) -> Colour:
    red, green, blue = (round(share * part) for part in colour)
    return red, green, blue


def _spectrum(count: int) -> list[Colour]:
    """Different colours of about the same brightness."""
    angles = np.arange(count) / max(count, 1) * math.tau
    shares = [
        [0.5 + 0.5 * math.cos(angle - turn) for turn in (0.0, math.tau / 3, 2 * math.tau / 3)] for angle in angles
    ]
    return [(round(30 + 180 * r), round(30 + 150 * g), round(30 + 200 * b)) for r, g, b in shares]
