"""The whole window on a station that only remembers."""

import dataclasses
import logging
import math

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QImage

from shared.link.base import LinkHealth, LinkPath, RadioHealth
from shared.messages import MissionState, StopReason
from station_gui.model.view import LinkFigures, LinkState, Severity, Target
from station_gui.qt.theme import style_sheet
from station_gui.views.main_window import status_text


def press(qtbot, button):
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def test_connect_takes_host_and_port(open_window, operator, qtbot):
    window = open_window()
    window.connection.host.setText(" robot.local ")
    window.connection.port.setText("7401")
    press(qtbot, window.connection.button)
    assert operator.calls == [("connect", "robot.local", 7401, ())]


def test_connect_is_not_possible_without_a_whole_address(open_window):
    window = open_window()
    window.connection.port.setText("")
    assert not window.connection.button.isEnabled()
    window.connection.port.setText("7400")
    window.connection.host.setText("  ")
    assert not window.connection.button.isEnabled()


def test_return_in_the_host_field_connects(open_window, operator, qtbot):
    window = open_window(host="127.0.0.1", port=7400)
    qtbot.keyClick(window.connection.host, Qt.Key.Key_Return)
    assert operator.calls == [("connect", "127.0.0.1", 7400, ())]


def test_the_same_button_disconnects(open_window, operator, scenes, qtbot):
    operator.current = scenes.connected_view()
    window = open_window()
    press(qtbot, window.connection.button)
    assert operator.calls == [("disconnect",)]


def test_the_address_of_a_connection_made_elsewhere_is_shown(open_window, operator, scenes):
    operator.current = scenes.connected_view()
    window = open_window()
    assert (window.connection.host.text(), window.connection.port.text()) == ("192.168.4.1", "7400")


@pytest.mark.parametrize(
    ("state", "button", "call"),
    [
        (MissionState.IDLE, "start", ("start",)),
        (MissionState.OBSERVE, "stop", ("stop",)),
        (MissionState.OBSERVE, "pause", ("pause",)),
        (MissionState.PAUSED, "pause", ("resume",)),
        (MissionState.HALTED, "pause", ("resume",)),
        (MissionState.COMMAND, "go_home", ("return_to_start",)),
    ],
)
def test_command_buttons_ask_for_what_they_say(open_window, operator, scenes, qtbot, state, button, call):
    operator.current = scenes.connected_view(state)
    window = open_window()
    press(qtbot, getattr(window.commands, button))
    assert operator.calls == [call]


@pytest.mark.parametrize("state", list(MissionState))
def test_buttons_are_enabled_where_they_make_sense(open_window, operator, scenes, room, state):
    operator.current = scenes.connected_view(state, room)
    commands = open_window().commands
    running = state in {MissionState.OBSERVE, MissionState.COMMAND}
    assert commands.start.isEnabled() is not (running or state is MissionState.RETURN)
    assert commands.pause.isEnabled() is (state is not MissionState.IDLE)
    assert commands.go_home.isEnabled() is (running or state is MissionState.PAUSED)
    assert commands.stop.isEnabled() is (state is not MissionState.HALTED)
    assert commands.go_to.isEnabled() is (state is MissionState.COMMAND)
    assert commands.drive.isEnabled() is running


def test_the_emergency_button_acts_on_press(open_window, operator, scenes, qtbot):
    operator.current = scenes.connected_view()
    window = open_window()
    qtbot.mousePress(window.mission.emergency, Qt.MouseButton.LeftButton)
    assert operator.calls == [("emergency_stop",)]


@pytest.mark.parametrize("key", [Qt.Key.Key_Space, Qt.Key.Key_Escape])
@pytest.mark.parametrize("focus", ["window", "host", "button"])
def test_space_and_escape_are_the_emergency_stop_wherever_the_keyboard_is(
    open_window, operator, scenes, qtbot, key, focus
):
    window = open_window()
    target = {"window": window, "host": window.connection.host, "button": window.connection.button}[focus]
    with qtbot.waitActive(window):
        window.activateWindow()
    target.setFocus()
    qtbot.keyClick(target, key)
    assert operator.calls == [("emergency_stop",)]
    assert " " not in window.connection.host.text()


def test_an_emergency_ends_driving_and_pointing(open_window, operator, scenes, room, qtbot):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window()
    window.commands.drive.setChecked(True)
    window.commands.go_to.setChecked(True)
    qtbot.mousePress(window.mission.emergency, Qt.MouseButton.LeftButton)
    assert not window.commands.drive.isChecked()
    assert not window.commands.go_to.isChecked()


@pytest.mark.parametrize("button", [Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton])
def test_a_click_on_the_map_sets_the_goal_in_metres(open_window, operator, scenes, room, qtbot, button):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window()
    window.commands.go_to.setChecked(button == Qt.MouseButton.LeftButton)
    qtbot.mouseClick(window.map2d.plot().viewport(), button, pos=window.map2d.pixel_of(2.75, 2.9).toPoint())
    ((name, x_m, y_m),) = operator.calls
    assert name == "go_to"
    assert math.hypot(x_m - 2.75, y_m - 2.9) < 0.02
    assert not window.commands.go_to.isChecked()


def test_a_left_click_without_goal_mode_asks_for_nothing(open_window, operator, scenes, room, qtbot):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window()
    pixel = window.map2d.pixel_of(1.0, 1.0).toPoint()
    qtbot.mouseClick(window.map2d.plot().viewport(), Qt.MouseButton.LeftButton, pos=pixel)
    assert operator.calls == []


def test_a_right_click_while_observing_asks_for_nothing(open_window, operator, scenes, room, qtbot):
    operator.current = scenes.connected_view(MissionState.OBSERVE, room)
    window = open_window()
    pixel = window.map2d.pixel_of(1.0, 1.0).toPoint()
    qtbot.mouseClick(window.map2d.plot().viewport(), Qt.MouseButton.RightButton, pos=pixel)
    assert operator.calls == []


def test_goal_mode_ends_when_it_makes_no_sense_any_more(open_window, operator, scenes, room):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window()
    window.commands.go_to.setChecked(True)
    operator.current = scenes.connected_view(MissionState.HALTED, room)
    window.refresh()
    assert not window.commands.go_to.isChecked()


def test_the_state_that_holds_is_lit(open_window, operator, scenes):
    operator.current = scenes.connected_view(MissionState.HALTED)
    operator.change(telemetry=scenes.telemetry(MissionState.HALTED, stop_reason=StopReason.COMMAND_SILENCE))
    window = open_window()
    lit = [state for state, chip in window.mission.steps.items() if chip.property("active")]
    assert lit == [MissionState.HALTED]
    assert "heard nothing from the station" in window.mission.sentence.text()


def test_each_state_has_a_light_of_its_own(open_window):
    for state in open_window().mission.steps:
        assert f'[role="step"][active="{state.name.lower()}"]' in style_sheet()


def test_link_figures_have_units(open_window, operator, scenes):
    operator.current = scenes.connected_view()
    texts = {name: value.text() for name, value in open_window().connection.figures.items()}
    assert texts == {
        "Map updates": "9.7 /s",
        "Observations": "9.8 /s",
        "Observation size": "812 B",
        "Received": "71.3 kbit/s",
        "Round trip": "12 ms",
        "Path": "Wi-Fi, open",
        "LoRa carries": "–",
        "Signal": "–",
    }


def over_lora(wifi: bool | None) -> LinkFigures:
    radios = (RadioHealth(True, -71.4), RadioHealth(False, math.nan, "the port is gone"))
    health = LinkHealth(wifi, True, radios, 3_210.0, is_secret=True)
    return LinkFigures(8.1, 8.0, 34.0, 2_900.0, 0.31, LinkPath.RADIO, health)


def test_the_path_in_use_is_shown_with_its_radios(open_window, operator, scenes):
    operator.current = scenes.connected_view()
    window = open_window()
    panel = window.connection
    assert not panel.figures["Signal"].isVisible()
    operator.change(
        link=over_lora(wifi=False), target=Target("192.168.4.1", 7400, ("/dev/ttyACM0:A", "/dev/ttyACM0:B"))
    )
    window.refresh()
    assert panel.use == "both"
    assert panel.radio.text() == "/dev/ttyACM0:A /dev/ttyACM0:B"
    shown = {name: panel.figures[name].text() for name in ("Path", "LoRa carries", "Signal")}
    assert shown == {"Path": "LoRa, no Wi-Fi", "LoRa carries": "3.2 kbit/s", "Signal": "−71 / off dBm"}
    assert panel.figures["Path"].property("tone") == "warning"


def test_a_low_window_shows_the_address_before_and_the_figures_after_connecting(open_window, operator, scenes):
    panel = open_window(width_px=1120, height_px=740, link="both").connection
    assert panel.host.isVisible()
    assert panel.radio.isVisible()
    assert not panel.figures["Path"].isVisible()
    operator.current = scenes.connected_view()
    panel.window().refresh()
    assert not panel.host.isVisible()
    assert panel.figures["Path"].isVisible()


def test_lora_is_asked_for_with_its_ports_alone_or_beside_wifi(qtbot, open_window, operator):
    panel = open_window(port=7400).connection
    press(qtbot, panel.uses["radio"])
    assert not panel.host.isVisible()
    assert not panel.button.isEnabled(), "no port is named"
    next(a for a in panel.port_menu().actions() if "transceiver" in a.text()).trigger()
    press(qtbot, panel.button)
    press(qtbot, panel.uses["both"])
    press(qtbot, panel.button)
    ports = ("/dev/ttyACM0:A", "/dev/ttyACM0:B")
    assert operator.calls == [("connect", "", 0, ports), ("connect", "127.0.0.1", 7400, ports)]
    for action in panel.port_menu().actions():
        if "module" in action.text():
            action.trigger()
    assert panel.radio.text() == "/dev/ttyACM0 /dev/ttyUSB0"


def test_the_lamp_is_red_when_the_link_is_lost(open_window, operator, scenes):
    operator.current = dataclasses.replace(scenes.connected_view(), link_state=LinkState.LOST)
    assert open_window().connection.lamp.colour == "#ef4b50"


def test_closing_stops_looking_and_disconnects(open_window, operator, scenes, room):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window()
    window.close()
    window.close()
    assert operator.calls == [("disconnect",)]
    assert not window._timer.isActive()


def test_a_station_that_fails_is_logged_once_and_the_window_lives(open_window, operator, scenes, caplog, monkeypatch):
    window = open_window()

    def broken():
        raise RuntimeError("no view today")

    with monkeypatch.context() as patch, caplog.at_level(logging.INFO):
        patch.setattr(operator, "view", broken)
        window.refresh()
        window.refresh()
    with caplog.at_level(logging.INFO):
        window.refresh()
    assert [record.getMessage() for record in caplog.records if record.name == "station_gui.qt.bridge"] == [
        "the station's state cannot be drawn",
        "the station's state is drawn again",
    ]
    assert window.isVisible()


def test_log_entries_appear_in_the_colour_of_their_severity(open_window, operator):
    window = open_window()
    operator.say(Severity.INFO, "connected")
    operator.say(Severity.ERROR, "camera lost")
    window.refresh()
    model = window.log.model
    assert [model.item(row).text() for row in range(model.rowCount())] == ["00:00.0  connected", "00:01.0  camera lost"]
    assert model.item(1).foreground().color().name() == "#ef4b50"


def test_the_log_is_bounded(open_window, operator):
    window = open_window(log_lines=10)
    for number in range(35):
        operator.say(Severity.INFO, f"event {number}")
        window.refresh()
    assert window.log.model.rowCount() == 10
    assert window.log.model.item(9).text().endswith("event 34")


def test_the_status_bar_tells_of_the_mapping(scenes, room):
    text = status_text(scenes.connected_view(snapshot=room))
    assert "61 keyframes" in text
    assert "3 loops" in text
    assert "SLAM 21 ms" in text


def test_pictures_of_window_and_3d_map_are_written(open_window, operator, scenes, room, tmp_path, gl_works):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window()
    window.save_pictures(tmp_path / "window.png", tmp_path / "map3d.png", (640, 480))
    whole, scene = QImage(str(tmp_path / "window.png")), QImage(str(tmp_path / "map3d.png"))
    assert (whole.width(), whole.height()) == (1600, 1000)
    assert (scene.width(), scene.height()) == (640, 480)


def test_a_picture_that_cannot_be_written_is_told(open_window, tmp_path):
    with pytest.raises(OSError, match="cannot be written"):
        open_window().save_pictures(tmp_path / "nowhere" / "window.png")


@pytest.mark.parametrize("size", [(1280, 800), (1600, 1000)])
def test_the_window_fits_its_screen(open_window, operator, scenes, room, size):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window(width_px=size[0], height_px=size[1])
    assert (window.width(), window.height()) == size
    for panel in (window.mission, window.connection, window.commands, window.drive, window.gauges, window.map2d):
        area = panel.rect()
        assert window.rect().contains(panel.mapTo(window, area.topLeft()))
        assert window.rect().contains(panel.mapTo(window, area.bottomRight()))


def _nan(array):
    return np.full_like(array, np.nan)


def test_nothing_but_nan_is_survived(open_window, operator, scenes, room, caplog):
    window = open_window()
    pose = type(room.map_from_robot)(math.nan, math.nan, math.nan)
    snapshot = dataclasses.replace(
        room,
        stamp_s=math.nan,
        map_from_robot=pose,
        map_from_odom=pose,
        grid=dataclasses.replace(room.grid, probability=_nan(room.grid.probability)),
        objects=dataclasses.replace(room.objects, segments_m=_nan(room.objects.segments_m)),
        trajectory=_nan(room.trajectory),
        slam_s=math.nan,
        combine_s=math.nan,
    )
    nothing = scenes.telemetry(
        stamp_s=math.nan,
        odom_from_robot=pose,
        speed_mps=math.nan,
        yaw_rate_radps=math.nan,
        steering_rad=math.nan,
        battery_v=math.nan,
        motor_current_a=math.nan,
        cpu_temperature_c=math.nan,
        distance_m=math.nan,
    )
    view = scenes.connected_view(MissionState.COMMAND, room)
    operator.current = dataclasses.replace(
        view,
        snapshot=snapshot,
        telemetry=nothing,
        goal_m=(math.nan, math.nan),
        path_m=np.full((4, 2), np.nan),
        observation=dataclasses.replace(view.observation, ranges_m=_nan(view.observation.ranges_m)),
    )
    window.refresh()
    window.grab()
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (1, 1), (5000, 3000)])
def test_grids_of_any_size_are_survived(open_window, operator, scenes, room, caplog, shape):
    window = open_window()
    grid = dataclasses.replace(room.grid, probability=np.full(shape, 0.1, np.float32))
    empty = dataclasses.replace(
        room,
        grid=grid,
        trajectory=np.zeros((0, 4)),
        closures=np.zeros((0, 2), np.int32),
        objects=type(room.objects)(np.zeros((0, 2, 3), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.int32)),
    )
    operator.current = scenes.connected_view(MissionState.COMMAND, empty)
    window.refresh()
    window.grab()
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


def test_a_view_of_nothing_is_survived(open_window, operator, scenes, caplog):
    window = open_window()
    operator.current = dataclasses.replace(
        scenes.connected_view(), robot=None, telemetry=None, observation=None, telemetry_age_s=math.inf
    )
    window.refresh()
    window.grab()
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


def test_a_map_that_goes_away_leaves_an_empty_canvas(open_window, operator, scenes, room):
    operator.current = scenes.connected_view(MissionState.COMMAND, room)
    window = open_window()
    operator.current = scenes.connected_view(MissionState.COMMAND, None)
    window.refresh()
    assert window.map2d.layers.known is None
    assert status_text(operator.current) == "No map yet"
