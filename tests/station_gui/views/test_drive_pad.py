"""Driving by hand: only while somebody holds on."""

import pytest
from PySide6.QtCore import QCoreApplication, QEvent, QPoint, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QLineEdit

from shared.messages import MissionState
from station_gui.views.config import WindowConfig
from station_gui.views.drive_pad import DrivePanel


@pytest.fixture
def panel(qtbot):
    made = DrivePanel(WindowConfig())
    qtbot.addWidget(made)
    with qtbot.waitExposed(made):
        made.show()
    made.set_on(True)
    return made


@pytest.fixture
def asked(panel):
    calls = []
    panel.drive_asked.connect(lambda speed, steering: calls.append((round(speed, 3), round(steering, 3))))
    return calls


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ([Qt.Key.Key_Up], (0.2, 0.0)),
        ([Qt.Key.Key_W, Qt.Key.Key_A], (0.2, 0.4)),
        ([Qt.Key.Key_Down, Qt.Key.Key_Right], (-0.2, -0.4)),
        ([Qt.Key.Key_W, Qt.Key.Key_S], (0.0, 0.0)),
    ],
)
def test_held_keys_drive_and_steer(panel, asked, qtbot, keys, expected):
    for key in keys:
        qtbot.keyPress(panel.stick, key)
    panel.stick._send()
    assert asked[-1] == expected


def test_releasing_the_last_key_stops_at_once(panel, asked, qtbot):
    qtbot.keyPress(panel.stick, Qt.Key.Key_Up)
    assert panel.stick.active
    qtbot.keyRelease(panel.stick, Qt.Key.Key_Up)
    assert asked == [(0.2, 0.0), (0.0, 0.0)]
    assert not panel.stick.active


def test_the_stick_is_proportional_and_springs_back(panel, asked, qtbot):
    stick = panel.stick
    centre = stick.rect().center()
    up = QPoint(centre.x(), centre.y() - round(stick._reach() / 2))
    qtbot.mousePress(stick, Qt.MouseButton.LeftButton, pos=up)
    speed_mps, steering_rad = asked[-1]
    assert speed_mps == pytest.approx(0.1, abs=0.01)
    assert steering_rad == pytest.approx(0.0, abs=0.01)
    qtbot.mouseRelease(stick, Qt.MouseButton.LeftButton, pos=up)
    assert asked[-1] == (0.0, 0.0)


def test_beyond_its_rim_the_stick_asks_for_no_more(panel, asked, qtbot):
    qtbot.mousePress(panel.stick, Qt.MouseButton.LeftButton, pos=panel.stick.rect().center())
    qtbot.mouseMove(panel.stick, QPoint(panel.stick.width() // 2, -400))
    panel.stick._send()
    assert asked[-1][0] == pytest.approx(0.2, abs=0.002)


def test_the_slider_sets_the_speed_at_the_rim(panel, asked, qtbot):
    panel.slider.setValue(40)
    qtbot.keyPress(panel.stick, Qt.Key.Key_Up)
    assert asked == [(0.4, 0.0)]


def test_losing_the_keyboard_stops(panel, asked, qtbot):
    other = QLineEdit(panel)
    other.show()
    with qtbot.waitActive(panel):
        panel.activateWindow()
    panel.stick.setFocus()
    qtbot.keyPress(panel.stick, Qt.Key.Key_Up)
    other.setFocus()
    assert asked[-1] == (0.0, 0.0)
    assert not panel.stick.active


@pytest.mark.parametrize("action", ["disable", "hide"])
def test_a_stick_taken_away_stops(panel, asked, qtbot, action):
    qtbot.keyPress(panel.stick, Qt.Key.Key_Up)
    panel.set_on(False) if action == "disable" else panel.hide()
    assert asked[-1] == (0.0, 0.0)
    assert not panel.stick.active


def test_it_is_sent_again_while_held(panel, asked, qtbot):
    qtbot.keyPress(panel.stick, Qt.Key.Key_Up)
    qtbot.waitUntil(lambda: len(asked) >= 3, timeout=5000)
    assert panel.stick._timer.interval() == 100


def test_a_held_key_that_repeats_is_one_press(panel, asked, qtbot):
    for kind in (QEvent.Type.KeyPress, QEvent.Type.KeyRelease, QEvent.Type.KeyPress):
        repeat = QKeyEvent(kind, Qt.Key.Key_Up, Qt.KeyboardModifier.NoModifier, "", True)
        QCoreApplication.sendEvent(panel.stick, repeat)
    assert asked == []


def test_in_the_window_the_pad_drives_the_station(open_window, operator, scenes, room, qtbot):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window()
    assert not window.drive.stick.isEnabled()
    window.commands.drive.setChecked(True)
    qtbot.keyPress(window.drive.stick, Qt.Key.Key_W)
    assert operator.calls == [("drive", 0.2, 0.0)]
    operator.current = scenes.connected_view(MissionState.HALTED, room)
    window.refresh()
    assert operator.calls[-1] == ("drive", 0.0, 0.0)
    assert not window.drive.stick.isEnabled()


def test_a_click_on_the_map_leaves_the_keyboard_with_the_pad(open_window, operator, scenes, room, qtbot):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window()
    with qtbot.waitActive(window):
        window.activateWindow()
    window.commands.drive.setChecked(True)
    viewport = window.map2d.plot().viewport()
    qtbot.mouseClick(viewport, Qt.MouseButton.LeftButton, pos=window.map2d.pixel_of(1.0, 1.0).toPoint())
    assert window.drive.stick.hasFocus()
