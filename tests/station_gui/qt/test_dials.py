"""Painted gauges."""

import math

import numpy as np
import pytest

from station_gui.qt import theme
from station_gui.qt.dials import Band, Battery, Compass, Dial, Reading
from station_gui.qt.widgets import picture_of


def colours_of(widget):
    raw = np.frombuffer(picture_of(widget).constBits(), np.uint8).reshape(-1, 4)
    return {(int(r), int(g), int(b)) for b, g, r, _ in raw}


def rgb(name):
    return tuple(int(name[i : i + 2], 16) for i in (1, 3, 5))


@pytest.fixture
def dial(qtbot):
    made = Dial("Speed", 0.0, 0.5, (Band(0.4, theme.GOOD), Band(0.5, theme.WARNING)), ((0.0, "0"),))
    made.resize(140, 160)
    qtbot.addWidget(made)
    return made


@pytest.mark.parametrize(("value", "degrees"), [(0.0, 210.0), (0.25, 90.0), (0.5, -30.0), (9.0, -30.0), (-1.0, 210.0)])
def test_the_needle_goes_round_from_lower_left_and_stays_on_the_scale(dial, value, degrees):
    assert dial.angle_deg(value) == pytest.approx(degrees)


def test_bands_are_painted_in_their_colours(dial):
    dial.show_reading(Reading(0.2, "0.20 m/s"))
    assert {rgb(theme.GOOD), rgb(theme.WARNING)} <= colours_of(dial)


def test_an_old_reading_is_grey(dial):
    dial.show_reading(Reading(0.2, "0.20 m/s", "medium", theme.GOOD, stale=True))
    colours = colours_of(dial)
    assert rgb(theme.DISABLED) in colours
    assert rgb(theme.GOOD) not in colours


def test_the_battery_fills_with_its_charge(qtbot):
    battery = Battery("Battery", 5.6, 7.2)
    qtbot.addWidget(battery)
    assert [battery.share(v) for v in (5.0, 5.6, 6.4, 7.2, 8.0)] == pytest.approx([0, 0, 0.5, 1, 1])


@pytest.mark.parametrize("size", [(10, 10), (96, 128), (600, 90)])
def test_gauges_of_any_size_are_painted(qtbot, dial, size):
    for gauge in (dial, Compass("Heading"), Battery("Battery", 5.6, 7.2)):
        qtbot.addWidget(gauge)
        gauge.setMinimumSize(1, 1)
        gauge.resize(*size)
        for value in (0.3, math.nan):
            gauge.show_reading(Reading(value, "text", "note"))
            assert not gauge.grab().isNull()
