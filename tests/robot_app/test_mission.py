from __future__ import annotations

import numpy as np
import pytest

from robot_app.mission import Behaviour, Mission, MissionConfig
from shared.messages import Drive, EmergencyStop, GoTo, MissionState, Start, Stop, StopReason

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
