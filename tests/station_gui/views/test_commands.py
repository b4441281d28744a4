"""Which command makes sense when."""

import dataclasses
import math

import pytest

from shared.messages import MissionState
from station_gui.model.view import LinkState
from station_gui.views.commands import Allowed, allowed

STALE_AFTER_S = 1.5


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (MissionState.IDLE, Allowed(start=True, stop=True, emergency=True)),
        (MissionState.OBSERVE, Allowed(stop=True, emergency=True, drive=True, pause=True, go_home=True)),
        (MissionState.COMMAND, Allowed(stop=True, emergency=True, go_to=True, drive=True, pause=True, go_home=True)),
        (MissionState.RETURN, Allowed(stop=True, emergency=True, pause=True)),
        (MissionState.PAUSED, Allowed(start=True, stop=True, emergency=True, resume=True, go_home=True)),
        (MissionState.HALTED, Allowed(start=True, emergency=True, resume=True)),
    ],
)
def test_a_connected_robot_may_be_asked_what_fits_its_state(scenes, room, state, expected):
    assert allowed(scenes.connected_view(state, room), STALE_AFTER_S) == expected


def test_nothing_may_be_asked_without_a_connection(scenes):
    assert allowed(scenes.disconnected_view(), STALE_AFTER_S) == Allowed()


def test_there_is_no_goal_without_a_map(scenes):
    assert not allowed(scenes.connected_view(MissionState.COMMAND), STALE_AFTER_S).go_to


@pytest.mark.parametrize("age_s", [1.6, math.inf, math.nan])
def test_old_news_allow_stopping_only(scenes, room, age_s):
    view = dataclasses.replace(scenes.connected_view(MissionState.COMMAND, room), telemetry_age_s=age_s)
    assert allowed(view, STALE_AFTER_S) == Allowed(stop=True, emergency=True)


def test_both_stops_stay_while_the_link_is_lost(scenes, room):
    view = dataclasses.replace(scenes.connected_view(MissionState.OBSERVE, room), link_state=LinkState.LOST)
    assert allowed(view, STALE_AFTER_S) == Allowed(stop=True, emergency=True)
