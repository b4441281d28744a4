"""What the operator reads."""

import dataclasses
import math

import pytest

from shared.messages import FanState, MissionState, StopReason, TaskVitals, Vitals
from station_gui.model.goal_figures import GoalFigures, GoalState
from station_gui.model.view import LinkState
from station_gui.views import words


@pytest.mark.parametrize(
    ("value", "decimals", "unit", "text"),
    [
        (0.1849, 2, "m/s", "0.18 m/s"),
        (-0.001, 2, "m", "0.00 m"),
        (-12.4, 0, "°", "−12°"),
        (61.0, 0, "°C", "61 °C"),
        (math.nan, 1, "V", "–"),
        (math.inf, 1, "V", "–"),
        (None, 1, "V", "–"),
    ],
)
def test_a_number_has_its_unit_or_is_a_dash(value, decimals, unit, text):
    assert words.number(value, decimals, unit) == text


def vitals(late_share: float = 0.0, **changes: object) -> Vitals:
    tasks = (
        TaskVitals("odometry", 100.0, late_share, 0.0, 0.0132, 0.0004),
        TaskVitals("depth", 10.0, 0.0, 0.0, 0.0, 0.0),
    )
    whole = Vitals(3.0, 0.312, 221.4, FanState.ON, ("under-voltage",), tasks, (("lost edges", 2), ("damaged scans", 0)))
    return dataclasses.replace(whole, **changes)


def test_how_the_schedule_is_kept_is_told_by_the_task_that_is_late_most_often(scenes):
    telemetry = scenes.telemetry(MissionState.OBSERVE, late_ticks=0)
    assert words.schedule_text(telemetry, None) == "kept"
    assert words.schedule_text(telemetry, vitals()) == "kept"
    assert words.schedule_text(telemetry, vitals(late_share=0.021)) == "odometry late 2.1 %, to 13 ms"
    skipped = dataclasses.replace(telemetry, late_ticks=7)
    assert words.schedule_text(skipped, vitals()) == "kept, 7 ticks skipped"


def test_the_computer_tells_what_holds_it_back():
    assert words.computer_text(None) == "–"
    assert words.computer_text(vitals()) == "under-voltage, 0.31 cores, 221 MB, fan on"
    calm = vitals(fan=FanState.UNKNOWN, throttling=())
    assert words.computer_text(calm) == "0.31 cores, 221 MB"


def test_what_the_devices_lost_is_counted():
    assert words.losses_text(vitals()) == "2 lost edges"
    assert words.losses_text(vitals(counters=())) == "nothing lost"


def test_bits_per_second_take_the_prefix_that_fits():
    assert words.bits_per_second(71_300) == "71.3 kbit/s"
    assert words.bits_per_second(2_340_000) == "2.34 Mbit/s"
    assert words.bits_per_second(math.nan) == "–"


@pytest.mark.parametrize("reason", list(StopReason))
@pytest.mark.parametrize("state", list(MissionState))
def test_each_state_and_reason_has_a_sentence(scenes, state, reason):
    sentence = words.telemetry_sentence(scenes.telemetry(state, stop_reason=reason))
    assert sentence.endswith(".")
    assert "_" not in sentence


def test_a_halt_says_why_and_how_to_go_on(scenes):
    telemetry = scenes.telemetry(MissionState.HALTED, stop_reason=StopReason.BLOCKED, faults=("camera lost",))
    assert words.telemetry_sentence(telemetry) == (
        "Stopped: something is in the way. Fault: camera lost. "
        "Press Continue to go on, or Start observation to begin anew."
    )


def test_what_is_waited_for_is_no_end_of_the_mission(scenes):
    late = scenes.telemetry(
        MissionState.OBSERVE, stop_reason=StopReason.SENSOR_STALE, faults=("waiting for the scanner",)
    )
    assert words.telemetry_sentence(late) == "Standing for a moment: a sensor is late. Fault: waiting for the scanner."
    gone = dataclasses.replace(late, state=MissionState.HALTED)
    assert words.telemetry_sentence(gone).startswith("Stopped: a sensor no longer delivers.")


def test_a_mission_cut_off_by_a_start_of_the_app_says_how_to_go_on(scenes):
    telemetry = scenes.telemetry(MissionState.PAUSED, stop_reason=StopReason.RESTARTED, faults=())
    assert words.telemetry_sentence(telemetry) == ("Paused: its program was started again. Press Continue to go on.")


def test_without_connection_the_sentence_says_what_to_do(scenes):
    assert "press Connect" in words.mission_sentence(scenes.disconnected_view(), 1.5)


def test_silence_of_the_robot_is_told_with_its_length(scenes):
    view = dataclasses.replace(scenes.connected_view(), telemetry_age_s=7.26)
    assert words.mission_sentence(view, 1.5) == "No report from the robot for 7.3 s."


def test_a_lost_link_is_told(scenes):
    view = dataclasses.replace(scenes.connected_view(), link_state=LinkState.LOST)
    assert words.mission_sentence(view, 1.5) == "Connection lost, trying again…"


def test_on_the_way_to_a_goal_the_sentence_tells_how_far_it_is(scenes, room):
    pose = room.map_from_robot
    view = dataclasses.replace(
        scenes.connected_view(MissionState.COMMAND, room),
        telemetry=scenes.telemetry(stamp_s=0.0),
        goal_m=(pose.x_m + 3.0, pose.y_m + 4.0),
    )
    assert words.mission_sentence(view, 1.5) == f"Going to x {pose.x_m + 3:.2f}, y {pose.y_m + 4:.2f} m: 5.00 m away."
    assert words.mission_sentence(dataclasses.replace(view, snapshot=None), 1.5).endswith(" m.")


def test_the_sentence_tells_length_clearance_and_planning_time_of_the_path(scenes, room):
    view = dataclasses.replace(
        scenes.connected_view(MissionState.COMMAND, room),
        telemetry=scenes.telemetry(stamp_s=0.0),
        goal_m=(1.0, 2.0),
        going=GoalFigures(1, (1.0, 2.0), GoalState.GOING, 3.24, 0.12, 0.044, 0.044, 1),
    )
    assert words.mission_sentence(view, 1.5).endswith("away. Path 3.2 m, 12 cm clear, planned in 44 ms.")


def test_a_goal_that_was_refused_is_told_with_the_reason_and_one_that_was_reached_is_not(scenes, room):
    refused = GoalFigures(1, (1.0, 2.0), GoalState.REFUSED, reason="the goal is in unknown space")
    view = dataclasses.replace(
        scenes.connected_view(MissionState.COMMAND, room), telemetry=scenes.telemetry(stamp_s=0.0), going=refused
    )
    sentence = words.mission_sentence(view, 1.5)
    assert sentence.startswith("The goal x 1.00, y 2.00 m was refused: the goal is in unknown space. ")
    reached = dataclasses.replace(view, going=dataclasses.replace(refused, state=GoalState.REACHED))
    assert words.mission_sentence(reached, 1.5) == words.mission_sentence(dataclasses.replace(view, going=None), 1.5)
