from __future__ import annotations

import numpy as np
import pytest

from robot_app.mission import Behaviour, Mission, MissionConfig
from shared.geometry.se2 import Pose2
from shared.messages import (
    Command,
    Drive,
    EmergencyStop,
    GoTo,
    MissionState,
    Pause,
    Resume,
    ReturnToStart,
    Start,
    Stop,
    StopReason,
)

PATH = np.zeros((5, 3), np.float32)


@pytest.fixture
def mission() -> Mission:
    return Mission(MissionConfig(lap_overlap_m=0.6))


def in_command(mission: Mission) -> Mission:
    mission.handle(Start(), 0.0)
    mission.observed(10.0, came_round=True)
    mission.observed(10.7, came_round=True)
    return mission


def test_a_new_mission_is_idle_and_stands(mission: Mission) -> None:
    assert mission.state is MissionState.IDLE
    assert mission.behaviour(0.0) is Behaviour.STAND


def test_start_begins_the_observation(mission: Mission) -> None:
    assert mission.handle(Start(), 0.0).accepted
    assert mission.behaviour(0.0) is Behaviour.FOLLOW_WALL
    assert not mission.handle(Start(), 0.0).accepted


def test_the_observation_ends_a_little_after_coming_round(mission: Mission) -> None:
    mission.handle(Start(), 0.0)
    mission.observed(1.0, came_round=False)
    mission.observed(9.0, came_round=True)
    assert mission.state is MissionState.OBSERVE
    mission.observed(9.7, came_round=False)
    assert mission.state is MissionState.COMMAND


def test_an_observation_that_never_comes_round_ends_too(mission: Mission) -> None:
    mission.handle(Start(), 0.0)
    mission.observed(1.0, came_round=False)
    mission.observed(82.0, came_round=False)
    assert mission.state is MissionState.COMMAND


@pytest.mark.parametrize("state", ["idle", "observe", "halted"])
def test_going_somewhere_needs_the_command_task(mission: Mission, state: str) -> None:
    if state != "idle":
        mission.handle(Start(), 0.0)
    if state == "halted":
        mission.handle(Stop(), 0.0)
    answer = mission.handle(GoTo(1, PATH), 0.0)
    assert not answer.accepted
    assert "observation" in answer.reason


def test_a_path_is_followed_until_it_ends(mission: Mission) -> None:
    in_command(mission).handle(GoTo(1, PATH), 0.0)
    assert mission.behaviour(0.0) is Behaviour.FOLLOW_PATH
    order = mission.order
    assert order is not None
    mission.path_ended(order)
    assert mission.behaviour(0.0) is Behaviour.STAND


def test_the_end_of_an_old_path_does_not_end_a_new_one(mission: Mission) -> None:
    in_command(mission).handle(GoTo(1, PATH), 0.0)
    old = mission.order
    mission.handle(GoTo(2, PATH), 0.0)
    assert old is not None
    mission.path_ended(old)
    assert mission.behaviour(0.0) is Behaviour.FOLLOW_PATH


def test_a_path_without_a_way_is_refused(mission: Mission) -> None:
    assert not in_command(mission).handle(GoTo(1, PATH[:1]), 0.0).accepted


@pytest.mark.parametrize("far_m", [1.0, 1e30])
def test_a_path_with_a_gap_is_refused(mission: Mission, far_m: float) -> None:
    path = PATH.copy()
    path[3, 0] = far_m
    answer = in_command(mission).handle(GoTo(1, path), 0.0)
    assert not answer.accepted
    assert "gap" in answer.reason


def test_driving_by_hand_holds_for_half_a_second_and_longer_over_lora(mission: Mission) -> None:
    in_command(mission).handle(Drive(0.2, 0.1), 5.0)
    assert mission.behaviour(5.4) is Behaviour.BY_HAND
    assert mission.behaviour(5.6) is Behaviour.STAND
    assert mission.hand_motion(5.6) is None
    mission.slow_link = True
    mission.handle(Drive(0.2, 0.1), 6.0)
    assert mission.behaviour(7.1) is Behaviour.BY_HAND
    assert mission.behaviour(7.3) is Behaviour.STAND


def test_driving_by_hand_needs_a_running_mission(mission: Mission) -> None:
    assert not mission.handle(Drive(0.2, 0.0), 0.0).accepted


@pytest.mark.parametrize(
    ("command", "reason"), [(Stop(), StopReason.OPERATOR), (EmergencyStop(), StopReason.EMERGENCY)]
)
def test_stopping_halts_and_forgets_every_order(
    mission: Mission, command: Stop | EmergencyStop, reason: StopReason
) -> None:
    in_command(mission).handle(GoTo(1, PATH), 0.0)
    mission.handle(command, 0.0)
    assert (mission.state, mission.stop_reason) == (MissionState.HALTED, reason)
    assert mission.order is None
    assert mission.behaviour(0.0) is Behaviour.STAND


def test_the_first_reason_of_a_halt_stands_but_for_an_emergency(mission: Mission) -> None:
    mission.halt(StopReason.LOW_BATTERY)
    mission.halt(StopReason.OPERATOR)
    assert mission.stop_reason is StopReason.LOW_BATTERY
    mission.halt(StopReason.EMERGENCY)
    assert mission.stop_reason is StopReason.EMERGENCY


def exploring(mission: Mission) -> Mission:
    """In the middle of an observation, 2 m ahead of its start, the round over."""
    mission.explores = True
    mission.handle(Start(), 0.0)
    mission.at(Pose2(), 0.0)
    mission.observed(8.0, came_round=False, is_over=True)
    mission.at(Pose2(2.0, 0.0, 0.0), 8.0)
    return mission


def test_a_robot_that_explores_does_so_after_its_round_until_nothing_is_left(mission: Mission) -> None:
    assert exploring(mission).behaviour(0.0) is Behaviour.EXPLORE
    mission.explored()
    assert mission.state is MissionState.COMMAND


@pytest.mark.parametrize("order", [Pause(), Stop(), EmergencyStop()])
def test_a_mission_goes_on_where_it_was_paused_or_stopped(mission: Mission, order: Command) -> None:
    exploring(mission).handle(order, 0.0)
    assert mission.behaviour(0.0) is Behaviour.STAND
    assert mission.handle(Resume(), 0.0).accepted
    assert (mission.behaviour(0.0), mission.stop_reason) == (Behaviour.EXPLORE, StopReason.NONE)


def test_a_path_outlasts_a_pause_but_no_stop(mission: Mission) -> None:
    in_command(mission).handle(GoTo(1, PATH), 0.0)
    mission.handle(Pause(), 0.0)
    mission.handle(Resume(), 0.0)
    assert mission.behaviour(0.0) is Behaviour.FOLLOW_PATH
    mission.handle(Stop(), 0.0)
    mission.handle(Resume(), 0.0)
    assert mission.behaviour(0.0) is Behaviour.STAND


@pytest.mark.parametrize("order", [Pause(), Resume(), ReturnToStart()])
def test_without_a_mission_there_is_nothing_to_pause_go_on_with_or_return_from(
    mission: Mission, order: Command
) -> None:
    assert not mission.handle(order, 0.0).accepted


def test_a_robot_back_at_its_start_takes_commands_or_can_go_on_observing(mission: Mission) -> None:
    assert exploring(mission).handle(ReturnToStart(), 0.0).accepted
    assert mission.behaviour(0.0) is Behaviour.GO_HOME
    mission.returned(found_way=True)
    assert mission.state is MissionState.PAUSED
    mission.handle(Resume(), 0.0)
    mission.explored()
    mission.handle(ReturnToStart(), 0.0)
    mission.returned(found_way=True)
    assert mission.state is MissionState.COMMAND


def test_a_robot_that_finds_no_way_back_says_so_and_may_try_again(mission: Mission) -> None:
    exploring(mission).handle(ReturnToStart(), 0.0)
    mission.returned(found_way=False)
    assert (mission.state, mission.stop_reason) == (MissionState.PAUSED, StopReason.BLOCKED)
    mission.handle(Resume(), 0.0)
    assert mission.behaviour(0.0) is Behaviour.GO_HOME


def test_a_robot_that_has_not_moved_yet_knows_no_way_back(mission: Mission) -> None:
    answer = in_command(mission).handle(ReturnToStart(), 0.0)
    assert not answer.accepted
    assert "way back" in answer.reason


def test_a_mission_goes_on_after_the_app_was_started_again(mission: Mission) -> None:
    record = exploring(mission).record
    again = Mission(MissionConfig())
    again.explores = True
    again.restore(record)
    assert (again.state, again.stop_reason) == (MissionState.PAUSED, StopReason.RESTARTED)
    again.handle(Resume(), 0.0)
    again.at(Pose2(), 0.0)
    again.at(Pose2(1.0, 0.0, 0.0), 1.5)
    assert again.behaviour(0.0) is Behaviour.EXPLORE
    assert again.record.distance_m == pytest.approx(9.5)
    assert again.home == Pose2(-2.0, 0.0, 0.0)
    assert again.record.robot_from_home == Pose2(-3.0, 0.0, 0.0)


def test_without_a_mission_before_the_app_comes_up_idle(mission: Mission) -> None:
    mission.restore(Mission(MissionConfig()).record)
    assert mission.state is MissionState.IDLE


@pytest.mark.parametrize("order", [None, Pause()])
def test_it_goes_home_when_the_battery_asks_for_it(mission: Mission, order: Command | None) -> None:
    exploring(mission)
    if order is not None:
        mission.handle(order, 0.0)
    assert mission.go_home()
    assert mission.state is MissionState.RETURN
    assert mission.go_home(), "asking again changes nothing"


def test_a_robot_that_was_stopped_does_not_set_off_for_home_by_itself(mission: Mission) -> None:
    assert not mission.go_home()
    exploring(mission).handle(EmergencyStop(), 0.0)
    assert not mission.go_home()
    assert (mission.state, mission.stop_reason) == (MissionState.HALTED, StopReason.EMERGENCY)
