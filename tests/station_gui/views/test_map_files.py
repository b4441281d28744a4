"""Opening and saving maps in the window, and what it shows while the robot has no place in the map."""

import dataclasses

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFileDialog

from shared.messages import MissionState
from station_gui.mapping.snapshot import Tracking
from station_gui.views import words
from station_gui.views.commands import allowed
from station_gui.views.main_window import status_text
from station_gui.views.pose import robot_on_map, scan_on_map_m


@pytest.fixture
def window(open_window, operator, scenes, room):
    operator.current = scenes.connected_view(snapshot=room)
    return open_window()


def accept(dialog, path):
    dialog.selectFile(str(path))
    dialog.accept()


def test_save_map_asks_for_a_file_and_hands_it_on(window, operator, tmp_path):
    window.map_files.save_action.trigger()
    dialog = window.map_files.dialog
    assert dialog.acceptMode() is QFileDialog.AcceptMode.AcceptSave
    accept(dialog, tmp_path / "lab")
    assert operator.calls == [("save_map", tmp_path / "lab.labmap")]
    assert window.map_files.dialog is None


def test_export_asks_for_a_folder_and_hands_it_on(window, operator, tmp_path):
    window.map_files.export_action.trigger()
    dialog = window.map_files.dialog
    assert dialog.fileMode() is QFileDialog.FileMode.Directory
    dialog.setDirectory(str(tmp_path.parent))
    accept(dialog, tmp_path)
    assert operator.calls == [("export_map", tmp_path)]


@pytest.mark.parametrize(("action", "localise"), [("continue_action", False), ("localise_action", True)])
def test_open_map_says_what_it_is_opened_for(window, operator, tmp_path, action, localise):
    path = tmp_path / "lab.labmap"
    path.write_bytes(b"x")
    getattr(window.map_files, action).trigger()
    assert ("only localise" in window.map_files.dialog.windowTitle()) == localise
    accept(window.map_files.dialog, path)
    assert operator.calls == [("open_map", path, localise)]


def test_all_that_can_be_done_with_a_map_is_in_the_menu(window):
    titles = [action.text() for action in window.map_files.button.menu().actions()]
    assert [title.split()[0] for title in titles if title] == ["Open", "Open", "Save", "Export"]


def test_the_heads_of_the_maps_fit_into_the_smallest_window(open_window):
    window = open_window(width_px=1120, height_px=740)
    window.grab()
    buttons = (window.map_files.button, window.map2d.follow_button, window.map2d.fit_button)
    assert [b.text() for b in buttons if b.width() < b.sizeHint().width()] == []


def test_a_cancelled_dialog_asks_nothing(window, operator):
    window.map_files.continue_action.trigger()
    window.map_files.dialog.reject()
    assert operator.calls == []
    assert window.map_files.dialog is None


def test_a_dialog_holds_up_neither_the_window_nor_the_emergency_stop(window, operator, qtbot):
    window.map_files.continue_action.trigger()
    assert not window.map_files.dialog.isModal()
    qtbot.mousePress(window.mission.emergency, Qt.MouseButton.LeftButton)
    assert operator.calls == [("emergency_stop",)]


def test_without_a_map_there_is_nothing_to_save(open_window):
    window = open_window()
    assert not window.map_files.save_action.isEnabled()
    assert window.map_files.continue_action.isEnabled()


@pytest.mark.parametrize(
    ("tracking", "places", "hint", "sentence"),
    [
        (Tracking.LOST, 0, "LOST", "It is lost: no place of the map fits"),
        (Tracking.SEARCHING, 0, "LOOKING FOR THE ROBOT", "is looked for."),
        (Tracking.SEARCHING, 3, "3 places may be it", "3 places may be it"),
    ],
)
def test_a_lost_robot_is_shown_as_lost(window, operator, scenes, room, tracking, places, hint, sentence):
    operator.current = scenes.connected_view(snapshot=dataclasses.replace(room, tracking=tracking, places=places))
    window.refresh()
    view = operator.current
    assert hint in window.map2d._hint.text()
    assert window.map2d._hint.isVisible()
    assert sentence in words.mission_sentence(view, 1.5)
    assert window.mission.sentence.property("tone") == "warning"
    assert robot_on_map(view) is None
    assert len(scan_on_map_m(view)) == 0
    assert not allowed(view, 1.5).go_to
    assert not window.commands.go_to.isEnabled()
    assert allowed(view, 1.5).drive
    assert window.commands.hint.toolTip() == "Go to needs its place in the map."

    operator.current = scenes.connected_view(snapshot=room)
    window.refresh()
    assert not window.map2d._hint.isVisible()
    assert window.commands.go_to.isEnabled()


def test_a_click_on_the_map_sends_a_lost_robot_nowhere(window, operator, scenes, room):
    lost = dataclasses.replace(room, tracking=Tracking.LOST)
    operator.current = scenes.connected_view(MissionState.COMMAND, lost)
    window.refresh()
    window.map2d.goal_picked.emit(1.0, 1.0)
    assert operator.calls == []


@pytest.mark.parametrize(
    ("tracking", "fixed", "shown"),
    [
        (Tracking.LOCATED, False, "located   ·"),
        (Tracking.LOCATED, True, "located, map is not changed"),
        (Tracking.SEARCHING, False, "searching"),
        (Tracking.LOST, True, "lost, map is not changed"),
        (Tracking.APART, False, "new piece"),
    ],
)
def test_the_status_bar_says_whether_the_place_is_known(scenes, room, tracking, fixed, shown):
    view = scenes.connected_view(snapshot=dataclasses.replace(room, tracking=tracking, fixed=fixed))
    assert status_text(view).startswith(shown)


def test_a_robot_on_a_new_piece_of_map_is_shown_and_told(window, operator, scenes, room):
    operator.current = scenes.connected_view(snapshot=dataclasses.replace(room, tracking=Tracking.APART))
    window.refresh()
    assert robot_on_map(operator.current) is not None
    assert "not joined to the rest" in words.mission_sentence(operator.current, 1.5)
    assert not window.map2d._hint.isVisible()
