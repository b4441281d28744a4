"""The map from above: what is drawn where."""

import dataclasses

import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QColor

from shared.geometry.se2 import Pose2
from shared.messages import MissionState
from station_gui.qt import theme
from station_gui.qt.widgets import picture_of
from station_gui.views.map2d_layers import LayerName


def colour_at(window, x_m, y_m):
    """The colour of the grabbed plot at a point of the map."""
    plot = window.map2d.plot()
    image = picture_of(plot)
    place = window.map2d.pixel_of(x_m, y_m)
    ratio = image.width() / plot.width()
    return QColor(image.pixel(QPoint(round(place.x() * ratio), round(place.y() * ratio))))


def is_near(colour, name):
    wanted = QColor(name)
    return all(
        abs(a - b) < 62
        for a, b in zip(colour.getRgb()[:3], wanted.getRgb()[:3], strict=True)  # type: ignore[arg-type]
    )


@pytest.fixture
def bare(scenes, room):
    """A free floor of 4 x 2 m with nothing on it but one occupied cell at x 2.9, y 0.3."""
    probability = np.full((20, 40), 0.05, np.float32)
    probability[3, 29] = 0.95
    grid = dataclasses.replace(room.grid, probability=probability, origin_m=(0.0, 0.0), cell_m=0.1)
    snapshot = dataclasses.replace(
        room, grid=grid, map_from_robot=Pose2(1.0, 1.5, 0.0), trajectory=np.zeros((0, 4)), closures=np.zeros((0, 2))
    )
    view = scenes.connected_view(MissionState.COMMAND, snapshot)
    return dataclasses.replace(view, observation=None, telemetry=scenes.telemetry(stamp_s=0.0))


def test_an_occupied_cell_is_dark_where_it_stands_and_nowhere_else(open_window, operator, bare):
    operator.current = bare
    window = open_window()
    assert is_near(colour_at(window, 2.95, 0.35), theme.MAP_OCCUPIED)
    for x_m, y_m in ((0.35, 2.0 - 0.35), (4.0 - 2.95, 0.35), (2.95, 2.0 - 0.35), (2.75, 0.35), (2.95, 0.55)):
        assert is_near(colour_at(window, x_m, y_m), theme.MAP_FREE)


def test_what_is_unknown_and_what_lies_outside_is_grey(open_window, operator, bare):
    probability = bare.snapshot.grid.probability.copy()
    probability[10:14, 30:34] = 0.5
    grid = dataclasses.replace(bare.snapshot.grid, probability=probability)
    operator.current = dataclasses.replace(bare, snapshot=dataclasses.replace(bare.snapshot, grid=grid))
    window = open_window()
    assert is_near(colour_at(window, 3.25, 1.15), theme.MAP_UNKNOWN)
    assert is_near(colour_at(window, -0.1, 1.15), theme.MAP_UNKNOWN)


def test_the_robot_stands_green_at_its_pose_and_turned_as_it_is(open_window, operator, bare):
    operator.current = bare
    window = open_window()
    assert is_near(colour_at(window, 1.06, 1.5), theme.ROBOT)
    turned = dataclasses.replace(bare.snapshot, map_from_robot=Pose2(1.0, 1.5, -np.pi / 2))
    operator.change(snapshot=turned)
    window.refresh()
    assert is_near(colour_at(window, 1.0, 1.44), theme.ROBOT)
    assert is_near(colour_at(window, 1.25, 1.5), theme.MAP_FREE)


def test_newer_telemetry_moves_the_robot_between_maps(open_window, operator, bare, scenes):
    snapshot = dataclasses.replace(bare.snapshot, stamp_s=1.0, map_from_odom=Pose2(0.5, 0.0, 0.0))
    moved = scenes.telemetry(stamp_s=2.0, odom_from_robot=Pose2(2.0, 1.0, 0.0))
    operator.current = dataclasses.replace(bare, snapshot=snapshot, telemetry=moved)
    window = open_window()
    assert is_near(colour_at(window, 2.56, 1.0), theme.ROBOT)


def test_the_goal_is_marked(open_window, operator, bare):
    operator.current = dataclasses.replace(bare, goal_m=(3.5, 1.0))
    window = open_window()
    assert is_near(colour_at(window, 3.5, 1.0), theme.GOAL)
    operator.change(goal_m=None)
    window.refresh()
    assert is_near(colour_at(window, 3.5, 1.0), theme.MAP_FREE)


def test_scan_points_lie_on_what_the_scanner_hit(open_window, operator, scenes, room):
    operator.current = scenes.connected_view(MissionState.OBSERVE, room)
    points_x, points_y = open_window().map2d.layers._scan.getData()
    distance_to_wall = np.minimum.reduce([points_x, 3.95 - points_x, points_y, 4.2 - points_y])
    assert len(points_x) > 150
    assert np.median(np.abs(distance_to_wall)) < 0.02


@pytest.mark.parametrize("name", list(LayerName))
def test_each_layer_can_be_taken_away(open_window, operator, scenes, room, name):
    operator.current = dataclasses.replace(
        scenes.connected_view(MissionState.COMMAND, room), goal_m=(1.0, 1.0), path_m=np.array([[1.0, 1.0], [2.0, 1.0]])
    )
    window = open_window()
    items = window.map2d.layers._items[name]
    assert all(item.isVisible() for item in items)
    window.map2d.layers.set_visible(name, False)
    window.refresh()
    assert not any(item.isVisible() for item in items)


def test_the_map_stays_in_view_as_it_grows_until_the_operator_moves_it(open_window, operator, bare):
    operator.current = bare
    window = open_window()
    grown = dataclasses.replace(bare.snapshot.grid, probability=np.full((60, 80), 0.05, np.float32))
    operator.change(snapshot=dataclasses.replace(bare.snapshot, grid=grown))
    window.refresh()
    (_, right_m), (_, top_m) = window.map2d.view_box.viewRange()
    assert right_m > 8.0
    assert top_m > 6.0
    window.map2d.view_box.sigRangeChangedManually.emit([True, True])
    before = window.map2d.view_box.viewRange()
    operator.change(snapshot=bare.snapshot)
    window.refresh()
    assert window.map2d.view_box.viewRange() == before


def test_follow_keeps_the_robot_in_the_middle(open_window, operator, bare, qtbot):
    operator.current = bare
    window = open_window()
    qtbot.mouseClick(window.map2d.follow_button, Qt.MouseButton.LeftButton)
    window.refresh()
    (left_m, right_m), (bottom_m, top_m) = window.map2d.view_box.viewRange()
    assert (left_m + right_m) / 2 == pytest.approx(1.0, abs=0.02)
    assert (bottom_m + top_m) / 2 == pytest.approx(1.5, abs=0.02)
    assert not window.map2d.fit_button.isChecked()


def test_the_cursor_is_told_in_metres(open_window, operator, bare):
    operator.current = bare
    window = open_window()
    scene_place = window.map2d.view_box.mapViewToScene(window.map2d.view_box.viewRect().center())
    window.map2d._on_move(scene_place)
    assert window.map2d._cursor.text().startswith("x ")
    assert window.map2d._cursor.text().endswith(" m")


def test_an_unchanged_view_is_not_drawn_again(open_window, operator, scenes, room, monkeypatch):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window()
    drawn = []
    monkeypatch.setattr(window.map2d.layers._image, "setImage", lambda *a, **k: drawn.append("grid"))
    monkeypatch.setattr(window.map2d.layers._scan, "setData", lambda *a, **k: drawn.append("scan"))
    monkeypatch.setattr(window.map2d.layers._trajectory, "setData", lambda *a, **k: drawn.append("trail"))
    window.refresh()
    assert drawn == []


def test_closures_that_name_no_keyframe_are_left_out(open_window, operator, scenes, room):
    closures = np.array([[0, 10], [5, 999], [-1, 2]], np.int32)
    operator.current = scenes.connected_view(MissionState.COMMAND, dataclasses.replace(room, closures=closures))
    ends_x, _ = open_window().map2d.layers._closures.getData()
    assert len(ends_x) == 2
