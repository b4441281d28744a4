"""What the gauges read."""

import dataclasses
import math

import pytest

from shared.messages import MissionState
from station_gui.qt import theme
from station_gui.views import gauges
from station_gui.views.config import GaugeConfig

CONFIG = GaugeConfig()


@pytest.mark.parametrize(
    ("speed_mps", "text", "note"),
    [
        (0.0, "0.00 m/s", "standing"),
        (0.08, "0.08 m/s", "slow"),
        (0.20, "0.20 m/s", "medium"),
        (0.44, "0.44 m/s", "fast"),
        (-0.15, "0.15 m/s", "medium, backward"),
        (math.nan, "–", ""),
    ],
)
def test_the_speed_falls_into_the_papers_bands(speed_mps, text, note):
    reading = gauges.speed_reading(speed_mps, CONFIG, stale=False)
    assert (reading.text, reading.note) == (text, note)


@pytest.mark.parametrize(
    ("battery_v", "note", "colour"),
    [
        (6.6, "good", theme.GOOD),
        (6.1, "low", theme.WARNING),
        (5.7, "nearly empty", theme.BAD),
        (math.nan, "not measured", theme.MUTED),
    ],
)
def test_the_battery_is_coloured_by_its_level(battery_v, note, colour):
    reading = gauges.battery_reading(battery_v, CONFIG, stale=False)
    assert (reading.note, reading.colour) == (note, colour)


@pytest.mark.parametrize(
    ("temperature_c", "note"), [(55.0, "good"), (74.0, "warm"), (80.0, "throttling"), (86.0, "throttled")]
)
def test_the_temperature_knows_where_the_computer_slows_down(temperature_c, note):
    assert gauges.temperature_reading(temperature_c, CONFIG, stale=False).note == note


def test_a_steering_to_the_left_points_left():
    reading = gauges.steering_reading(0.2, stale=False)
    assert (reading.text, reading.note) == ("11°", "left")
    assert reading.value < 0


def test_a_high_motor_current_is_told():
    assert gauges.current_reading(7.0, CONFIG, stale=False).note == "high"
    assert gauges.current_reading(1.0, CONFIG, stale=False).note == "normal"


def test_the_heading_is_that_on_the_map_or_else_by_odometry(scenes, room):
    view = scenes.connected_view(MissionState.COMMAND, room)
    on_map = gauges.heading_reading(view, view.telemetry, stale=False)
    assert (on_map.text, on_map.note) == ("−29°", "on the map")
    without = dataclasses.replace(view, snapshot=None)
    assert gauges.heading_reading(without, view.telemetry, stale=False).note == "by odometry"


def test_old_telemetry_greys_all_gauges_and_shows_its_age(open_window, operator, scenes):
    operator.current = dataclasses.replace(scenes.connected_view(), telemetry_age_s=7.3)
    panel = open_window().gauges
    assert all(gauge.reading.stale for gauge in panel.gauges())
    assert panel.speed.reading.text == "0.18 m/s"
    assert panel._age.text() == "telemetry is 7.3 s old"


def test_fresh_telemetry_is_not_grey(open_window, operator, scenes):
    operator.current = scenes.connected_view()
    assert not any(gauge.reading.stale for gauge in open_window().gauges.gauges())


def test_before_the_first_telemetry_there_are_dashes(open_window):
    assert {gauge.reading.text for gauge in open_window().gauges.gauges()} == {"–"}
