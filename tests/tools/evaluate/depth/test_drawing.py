"""The ideal drawing of hand-made scenes, and what is drawn of it."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from shared.geometry.camera import CameraMount, Intrinsics
from shared.geometry.se2 import Pose2
from tools.evaluate import __main__ as evaluate
from tools.evaluate.depth.drawing import Counts
from tools.evaluate.depth.ideal import Drawing, View, cast, ideal_drawing
from tools.evaluate.depth.lab_frames import VIEWS
from tools.simulator.depth_camera import DepthRenderer, camera_intrinsics, camera_mount
from tools.simulator.scenario import find_scenario
from tools.simulator.solids import Solid, solids_of
from tools.simulator.world import World

LENS = Intrinsics.from_field_of_view(640, 480, math.radians(70), math.radians(50))
VIEW = View.of(Pose2(1.0, 1.0, 0.0), CameraMount(0.28, 0.17, 0.0), LENS)  # the camera looks along x, 17 cm high


def box(
    x_m: float, y_m: float = 1.0, size_m: tuple[float, float, float] = (0.4, 0.4, 0.4), yaw_deg: float = 0.0
) -> Solid:
    half_m = (size_m[0] / 2, size_m[1] / 2, size_m[2] / 2)
    return Solid("box", (x_m, y_m, half_m[2]), half_m, math.radians(yaw_deg), 0.5)


@pytest.mark.parametrize(
    ("solids", "nodes", "connections"),
    [
        ([], 0, 0),
        ([box(3.5)], 4, 4),  # a front higher than the camera
        ([box(3.5, yaw_deg=45)], 6, 7),  # two of them, with the edge between
        ([box(3.5, size_m=(0.4, 0.4, 0.1))], 6, 7),  # a front and a top
        ([box(3.5), box(4.5)], 4, 4),  # the second is hidden
        ([box(3.5, y_m=0.8), box(3.5, y_m=1.2)], 6, 6),  # flush: nothing between them but the ends of four lines
        ([box(3.4, y_m=0.85), box(3.5, y_m=1.25)], 8, 7),  # one 10 cm before the other, with one upright between
        ([box(1.5)], 0, 0),  # nearer than the camera measures
        ([box(0.0)], 0, 0),  # behind it
        ([box(11.5)], 0, 0),  # too far
    ],
)
def test_boxes_have_as_many_lines_as_a_person_would_draw(solids: list[Solid], nodes: int, connections: int) -> None:
    drawing = ideal_drawing(VIEW, solids)
    assert (drawing.nodes, drawing.connections) == (nodes, connections)


def test_a_front_is_drawn_round_its_four_sides() -> None:
    drawing = ideal_drawing(VIEW, [box(3.5)])
    assert drawing.points_m[:, 0] == pytest.approx(3.3)
    assert len(drawing.points_m) == 4 * 41
    np.testing.assert_allclose(drawing.points_m[:, 1:].min(axis=0), (0.8, 0.0), atol=1e-9)
    np.testing.assert_allclose(drawing.points_m[:, 1:].max(axis=0), (1.2, 0.4), atol=1e-9)


def test_what_stands_before_an_edge_cuts_it() -> None:
    post = box(2.5, size_m=(0.1, 0.1, 1.0))
    tops = [line for line in ideal_drawing(VIEW, [box(3.5), post]).lines_m if (line[:, 2] == 0.4).all()]
    assert len(tops) == 2
    assert sum(len(line) for line in tops) * 0.01 == pytest.approx(0.4 - 0.1 * 2.02 / 1.17, abs=0.03)


def test_a_pixel_and_its_ray_are_the_same_point() -> None:
    view = View.of(Pose2(0.3, -0.7, 2.0), CameraMount(0.28, 0.17, 0.1), LENS)
    pixels = np.array([[10.0, 20.0], [320.0, 240.0], [630.0, 470.0]])
    seen, depth_m = view.see(view.origin_m + 2.5 * view.rays(pixels))
    np.testing.assert_allclose(seen, pixels)
    np.testing.assert_allclose(depth_m, 2.5)


def test_rays_end_where_the_renderer_sees_the_lab() -> None:
    scenario = find_scenario("lab")
    pose = Pose2(2.9, 1.05, math.radians(45))
    world = World(scenario, seed=1)
    world.place(pose)
    renderer = DepthRenderer(world.model, scenario.camera)
    inverse_per_m = np.empty((480, 640), np.float32)
    renderer.render(world.camera_state(), inverse_per_m)
    renderer.close()
    lens = camera_intrinsics(scenario.camera)
    view = View.of(pose, camera_mount(scenario), lens)
    columns, rows = np.meshgrid(np.arange(0, 640, 8), np.arange(0, 480, 8))
    rays = view.rays(np.column_stack((columns.ravel(), rows.ravel())) + 0.5)
    depth_m, plane = cast(view.origin_m, rays, solids_of(scenario))
    off_m = np.abs(inverse_per_m[::8, ::8].ravel() - 1 / depth_m) * np.minimum(depth_m, 9.0) ** 2
    assert np.mean(off_m < 0.02) > 0.98
    hit_m = view.origin_m + depth_m[:, None] * rays
    known = np.isfinite(depth_m)
    np.testing.assert_allclose((plane[known, :3] * hit_m[known]).sum(axis=1), plane[known, 3], atol=1e-6)


def test_half_a_line_and_a_false_one_count_as_such() -> None:
    line_m = np.column_stack((np.linspace(0, 1, 101), np.zeros((101, 2))))
    nodes_m = np.array([[0, 0.02, 0], [0.5, 0.02, 0], [0, 0, 2], [0.5, 0, 2]])
    counts = Counts.of(Drawing((line_m,), 2), nodes_m, np.array([[0, 1], [2, 3]]))
    assert counts == Counts(101, counts.ideal_drawn, 102, 51)
    assert 51 <= counts.ideal_drawn <= 54
    assert Counts.of(Drawing((), 0), np.zeros((0, 3)), np.zeros((0, 2), np.int64)).shares() == (None, None)


def test_the_command_prints_each_view_and_all_together(monkeypatch, capsys) -> None:
    monkeypatch.setitem(VIEWS, "lab", VIEWS["lab"][7:8])
    monkeypatch.setattr("sys.argv", ["evaluate", "drawing", "--frames", "1", "--json"])
    assert evaluate.main() == 0
    printed = json.loads(capsys.readouterr().out)
    (row,) = printed["views"]
    assert (row["ideal_nodes"], row["ideal_connections"]) == (8, 8)
    assert row["ideal_drawn"] > 0.7
    assert row["drawn_true"] > 0.9
    assert {**printed["overall"], "view": "lab view 0"} == row
