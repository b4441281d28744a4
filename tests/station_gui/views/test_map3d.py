"""The 3D map: its colours, its camera, and a display that cannot."""

import dataclasses

import numpy as np
import pytest

from shared.messages import MissionState
from station_gui.mapping.snapshot import ObjectKind
from station_gui.qt import theme
from station_gui.qt.offscreen_gl import OpenGlError
from station_gui.qt.widgets import picture_of
from station_gui.views import gl_canvas, scene3d
from station_gui.views.camera import CameraAngles, fit_box
from station_gui.views.grid_picture import Extent
from station_gui.views.map3d import NO_OPENGL


def pixels(image):
    """(height, width, 3) RGB of a QImage."""
    raw = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.width(), 4)
    return raw[:, :, 2::-1].astype(int)


def share_of(rgb, test):
    red, green, blue = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    return float(np.mean(test(red, green, blue)))


@pytest.fixture
def scene(open_window, operator, scenes, room, gl_works):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    return open_window()


def test_the_scene_has_the_papers_colours(scene):
    rgb = pixels(scene.map3d.picture(800, 600))
    assert share_of(rgb, lambda r, g, b: (r > 180) & (g < 90) & (b < 90)) > 0.005  # walls and large objects
    assert share_of(rgb, lambda r, g, b: (b > 180) & (r < 90) & (g < 140)) > 0.0005  # small objects
    assert share_of(rgb, lambda r, g, b: (g > 120) & (r < 80) & (b < 120)) > 0.0005  # the robot
    assert share_of(rgb, lambda r, g, b: (r > 250) & (g > 250) & (b > 250)) > 0.15  # free floor
    assert share_of(rgb, lambda r, g, b: (abs(r - 0x9A) < 6) & (abs(b - 0xA8) < 6)) > 0.03  # unknown floor


def test_the_scene_is_in_the_picture_of_the_window(scene):
    scene.map3d.polish()
    place = scene.map3d.canvas.mapTo(scene, scene.map3d.canvas.rect().topLeft())
    canvas = scene.map3d.canvas
    rgb = pixels(picture_of(scene))[place.y() : place.y() + canvas.height(), place.x() : place.x() + canvas.width()]
    assert share_of(rgb, lambda r, g, b: (r > 180) & (g < 90) & (b < 90)) > 0.005
    assert share_of(rgb, lambda r, g, b: (g > 120) & (r < 80) & (b < 120)) > 0.0005


def test_an_unchanged_scene_is_not_rendered_again(scene, qapp, monkeypatch):
    qapp.processEvents()
    scene.map3d.canvas.repaint()  # a busy display may not have asked for it yet
    rendered = []
    monkeypatch.setattr(scene.map3d.canvas, "paint", lambda **_: rendered.append(1))
    scene.map3d.canvas.repaint()
    assert rendered == []
    scene.map3d.canvas.orbit(10, 0)
    qapp.processEvents()
    assert rendered == [1]


def test_without_opengl_the_window_says_so_and_goes_on(open_window, operator, scenes, room, monkeypatch):
    def refuse():
        raise OpenGlError("none here")

    monkeypatch.setattr(gl_canvas, "OffscreenGl", refuse)
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window()
    assert window.map3d.canvas is None
    assert window.map3d._stack.currentWidget().text() == NO_OPENGL
    assert not window.map3d.reset_button.isEnabled()
    assert window.map3d.picture(320, 240).width() == 320


def test_opengl_that_fails_later_gives_way_to_the_sentence(scene, qapp, monkeypatch, caplog):
    def fail(**_):
        raise RuntimeError("the driver is gone")

    monkeypatch.setattr(scene.map3d.canvas, "paint", fail)
    scene.map3d.canvas.orbit(5, 0)
    qapp.processEvents()
    qapp.processEvents()
    scene.refresh()
    assert scene.map3d.canvas is None
    assert scene.map3d._stack.currentWidget().text() == NO_OPENGL
    assert "the driver is gone" in caplog.text


def test_follow_looks_at_the_robot_and_reset_at_the_map(scene, operator):
    scene.map3d.follow_button.setChecked(True)
    scene.refresh()
    centre = scene.map3d.canvas.opts["center"]
    assert (centre.x(), centre.y()) == pytest.approx((0.72, 1.05), abs=1e-4)
    scene.map3d.reset_button.click()
    assert scene.map3d.canvas.opts["center"].x() > 1.5
    assert not scene.map3d.follow_button.isChecked()


def test_the_map_that_goes_away_leaves_no_scene(scene, operator, scenes):
    operator.current = scenes.connected_view(MissionState.COMMAND, None)
    scene.refresh()
    assert not any(item.visible() for item in scene.map3d.canvas.items)


def test_segments_are_split_by_kind_and_odd_ones_left_out(room):
    segments = room.objects.segments_m.copy()
    segments[0, 0, 0] = np.nan
    objects = dataclasses.replace(room.objects, segments_m=segments)
    large = scene3d.segments_of(objects, ObjectKind.LARGE)
    small = scene3d.segments_of(objects, ObjectKind.SMALL)
    assert len(large) + len(small) == 2 * (len(segments) - 1)
    assert np.isfinite(large).all()


def test_sides_that_may_go_on_end_in_dashes(room):
    side, rim = [[0.0, 0.0, 0.8], [0.0, 0.0, 0.0]], [[0.0, 0.0, 0.8], [1.0, 0.0, 0.8]]
    large = np.full(2, ObjectKind.LARGE, np.uint8)
    alone = dataclasses.replace(room.objects, segments_m=np.array([side], np.float32), kind=large[:1])
    dashes = scene3d.segments_of(alone, ObjectKind.LARGE).reshape(-1, 2, 3)
    assert len(dashes) == 4
    assert dashes[:, :, 2].max() == pytest.approx(0.8)
    assert np.abs(np.diff(dashes[:, :, 2], axis=1)).sum() == pytest.approx(0.8 - 0.24 / 2)
    topped = dataclasses.replace(room.objects, segments_m=np.array([side, rim], np.float32), kind=large)
    assert len(scene3d.segments_of(topped, ObjectKind.LARGE)) == 4


def test_the_robot_is_as_large_as_in_the_paper():
    corners = np.array([[-0.045, -0.1], [0.305, -0.1], [0.305, 0.1], [-0.045, 0.1]])
    mesh = scene3d.robot_mesh(corners)
    size = np.ptp(mesh.vertices_m, axis=0)
    assert size[0] == pytest.approx(0.35, abs=0.01)
    assert size[1] == pytest.approx(0.20, abs=0.05)  # the wheels stand out
    assert size[2] == pytest.approx(0.20, abs=0.01)
    assert mesh.faces.max() < len(mesh.vertices_m)
    assert len(mesh.colours) == len(mesh.faces)


def test_the_floor_grid_has_a_bound():
    assert len(scene3d.floor_lines_m(Extent(0.0, 0.0, 5000.0, 3000.0), 0.5)) < 1000
    lines = scene3d.floor_lines_m(Extent(-0.2, 0.1, 1.0, 1.0), 0.5)
    assert sorted(set(lines[:, 0].tolist())) == pytest.approx([-0.2, 0.0, 0.5, 0.8])


@pytest.mark.parametrize("aspect", [0.6, 1.0, 2.2])
@pytest.mark.parametrize("azimuth_deg", [-68.0, 10.0, 135.0])
def test_the_camera_sees_all_of_the_box_and_little_else(aspect, azimuth_deg):
    low, high = np.array([-1.0, 2.0, 0.0]), np.array([4.0, 9.0, 1.0])
    angles = CameraAngles(np.radians(azimuth_deg), np.radians(52.0), np.radians(60.0))
    fit = fit_box(low, high, angles, aspect)
    ca, sa, ce, se = np.cos(angles.azimuth_rad), np.sin(angles.azimuth_rad), np.cos(0.9076), np.sin(0.9076)
    axes = np.array([[-sa, ca, 0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])
    corners = np.array([[x, y, z] for x in (-1, 4) for y in (2, 9) for z in (0, 1)], float)
    seen = (corners - fit.centre_m) @ axes.T
    on_picture = np.abs(seen[:, :2] / (fit.distance_m - seen[:, 2:])) / (np.tan(np.radians(30)) / np.array([1, aspect]))
    assert 0.85 < on_picture.max() < 1.0


def test_the_legend_names_the_colours_that_are_drawn(scene):
    assert theme.OBJECT_LARGE == "#e02929"
    assert scene.map3d._counts.text() == "400 lines, 108 small"


def test_the_goal_stands_on_the_floor_of_the_scene(scene, operator):
    operator.change(goal_m=(2.5, 1.5), path_m=np.array([[0.7, 1.0], [2.5, 1.5]]))
    scene.refresh()
    mark = scene3d.goal_mark_m(2.5, 1.5)
    assert np.allclose(mark[:, :2].min(axis=0) + mark[:, :2].max(axis=0), (5.0, 3.0), atol=0.01)
    assert scene.map3d.canvas._goal.visible()
    operator.change(goal_m=None, path_m=None)
    scene.refresh()
    assert not scene.map3d.canvas._goal.visible()
    assert not scene.map3d.canvas._path.visible()
