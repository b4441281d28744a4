"""Draws a scenario from above."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from shared.geometry.se2 import Pose2
from tools.simulator.rooms import footprint
from tools.simulator.scenario import Scenario
from tools.simulator.solids import Solid, solids_of

MARGIN_M = 0.2
_OVERSAMPLING = 3
_WALL = (60, 60, 66)
_START = (40, 130, 70)
_GOAL = (200, 60, 50)
_TRACK = (60, 110, 200)


class _Paper:
    """A picture with room coordinates, y up."""

    def __init__(self, scenario: Scenario, pixels_per_m: int) -> None:
        room = scenario.room
        self._scale = pixels_per_m * _OVERSAMPLING
        self._height_m = room.width_y_m + 2 * MARGIN_M
        size = (round((room.length_x_m + 2 * MARGIN_M) * self._scale), round(self._height_m * self._scale))
        self.image = Image.new("RGB", size, (250, 249, 245))
        self.draw = ImageDraw.Draw(self.image)

    def at(self, points_m: NDArray[np.floating]) -> list[tuple[float, float]]:
        x = (points_m[:, 0] + MARGIN_M) * self._scale
        y = (self._height_m - MARGIN_M - points_m[:, 1]) * self._scale
        return list(zip(x.tolist(), y.tolist(), strict=True))

    def px(self, length_m: float) -> int:
        return max(1, round(length_m * self._scale))


def plan_view(scenario: Scenario, track_m: NDArray[np.floating] | None = None, pixels_per_m: int = 200) -> Image.Image:
    """The room, its items, the robot at its start and the goals; `track_m` (N, 2), room frame, is drawn if given."""
    paper = _Paper(scenario, pixels_per_m)
    _draw_metre_grid(paper, scenario)
    for solid in sorted(solids_of(scenario), key=lambda s: s.center_m[2] + s.half_m[2]):
        _draw_solid(paper, solid)
    if track_m is not None and len(track_m) > 1:
        paper.draw.line(paper.at(track_m), fill=_TRACK, width=paper.px(0.015), joint="curve")
    _draw_robot(paper, scenario, scenario.start.room_from_robot)
    for goal in scenario.goals:
        _draw_goal(paper, goal.position_m)
    width, height = paper.image.size
    return paper.image.resize((width // _OVERSAMPLING, height // _OVERSAMPLING), Image.Resampling.LANCZOS)


def save_plan_view(scenario: Scenario, path: Path, track_m: NDArray[np.floating] | None = None) -> None:
    plan_view(scenario, track_m).save(path)


def _draw_metre_grid(paper: _Paper, scenario: Scenario) -> None:
    room = scenario.room
    for i in range(1, math.ceil(room.length_x_m)):
        paper.draw.line(
            paper.at(np.array([(i, 0.0), (i, room.width_y_m)])), fill=(225, 223, 216), width=paper.px(0.006)
        )
    for i in range(1, math.ceil(room.width_y_m)):
        paper.draw.line(
            paper.at(np.array([(0.0, i), (room.length_x_m, i)])), fill=(225, 223, 216), width=paper.px(0.006)
        )


def _draw_solid(paper: _Paper, solid: Solid) -> None:
    if solid.name.startswith("wall_"):
        fill = _WALL
    else:
        top = solid.center_m[2] + solid.half_m[2]
        shade = min(1.0, top / 1.4)  # the higher, the darker
        fill = (round(222 - 90 * shade), round(198 - 80 * shade), round(160 - 50 * shade))
    paper.draw.polygon(paper.at(solid.corners_m()), fill=fill, outline=(90, 75, 55), width=paper.px(0.008))


def _draw_robot(paper: _Paper, scenario: Scenario, room_from_robot: Pose2) -> None:
    body = footprint(scenario.body)
    front, half = body[:, 0].max(), body[:, 1].max()
    nose = np.array([(front - 0.09, -half * 0.6), (front - 0.02, 0.0), (front - 0.09, half * 0.6)])
    paper.draw.polygon(paper.at(room_from_robot.apply(body)), fill=_START)
    paper.draw.polygon(paper.at(room_from_robot.apply(nose)), fill=(255, 255, 255))


def _draw_goal(paper: _Paper, position_m: tuple[float, float]) -> None:
    for radius_m, fill in ((0.09, _GOAL), (0.06, (250, 249, 245)), (0.03, _GOAL)):
        corners = np.array(position_m) + np.array([(-radius_m, radius_m), (radius_m, -radius_m)])
        (x0, y0), (x1, y1) = paper.at(corners)
        paper.draw.ellipse((x0, y0, x1, y1), fill=fill)
