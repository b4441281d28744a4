"""What happens when something fails in the middle of a mission: what moves stops first, and the operator reads why."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from robot_app.drivers.base import DriveSetting, EncoderCount, ImuSample
from shared.messages import MissionState, StopReason, Telemetry
from shared.runtime.runner import Task
from station_gui.comms.state import LinkState
from tools.simulator.faults import FaultKind
from tools.simulator.lockstep import Lockstep

STANDS_MPS = 0.01
WITHIN_S = 0.32  # 0.3 s, looked at every 0.02 s


def telemetry(system: Lockstep) -> Telemetry:
    seen = system.station.view().telemetry
    assert seen is not None
    return seen


def time_to_stand_s(system: Lockstep, longest_s: float = 3.0) -> float:
    began_s = system.clock.now_s()
    while abs(system.world.speed_mps()) > STANDS_MPS:
        system.run(0.02)
        assert system.clock.now_s() - began_s < longest_s, "the car goes on"
    return system.clock.now_s() - began_s


@pytest.mark.parametrize("device", ["scanner", "imu", "encoders"])
@pytest.mark.parametrize("kind", [FaultKind.UNPLUGGED, FaultKind.SILENT])
def test_without_a_sensor_it_needs_the_car_stands_and_goes_on_when_it_is_back(
    driving: Lockstep, device: str, kind: FaultKind
) -> None:
    fault = getattr(driving.faults, device)
    fault.kind = kind
    assert time_to_stand_s(driving) < WITHIN_S
    driving.run(0.5)
    assert telemetry(driving).stop_reason in {StopReason.DEVICE_FAULT, StopReason.SENSOR_STALE}
    fault.kind = FaultKind.NONE
    driving.run(3.0)
    assert telemetry(driving).stop_reason is StopReason.NONE
    assert driving.world.speed_mps() > 0.05
    assert driving.world.collisions.count == 0


def lose(system: Lockstep, device: str, seconds: float, kind: FaultKind = FaultKind.SILENT) -> None:
    fault = getattr(system.faults, device)
    fault.kind = kind
    system.run(seconds)
    fault.kind = FaultKind.NONE


def test_a_scan_that_was_damaged_is_not_noticed_and_a_longer_gap_costs_a_moment(driving: Lockstep) -> None:
    lap = driving.app._pilot._wall  # type: ignore[attr-defined]
    driven_m = lap._distance_m
    lose(driving, "scanner", 0.04)
    driving.run(0.2)
    assert telemetry(driving).stop_reason is StopReason.NONE
    for _ in range(3):
        lose(driving, "scanner", 0.24)
        driving.run(0.2)
    assert telemetry(driving).stop_reason is StopReason.SENSOR_STALE
    assert abs(driving.world.speed_mps()) < STANDS_MPS
    driving.run(1.5)
    assert (telemetry(driving).state, telemetry(driving).stop_reason) == (MissionState.OBSERVE, StopReason.NONE)
    assert driving.world.speed_mps() > 0.05
    assert lap._distance_m > driven_m > 0.0, "the round goes on where it was"


@pytest.mark.parametrize("device", ["scanner", "encoders", "drive"])
def test_a_device_that_stays_away_ends_the_mission_which_the_operator_can_continue(
    driving: Lockstep, device: str
) -> None:
    lose(driving, device, 3.0, FaultKind.UNPLUGGED)
    driving.run(1.0)
    assert (telemetry(driving).state, telemetry(driving).stop_reason) == (MissionState.HALTED, StopReason.DEVICE_FAULT)
    assert any(device in fault for fault in telemetry(driving).faults), "it is still named"
    assert abs(driving.world.speed_mps()) < STANDS_MPS
    driving.station.resume()
    driving.run(2.5)
    assert driving.world.speed_mps() > 0.05


def test_wheels_that_are_held_for_a_moment_do_not_end_the_mission(driving: Lockstep) -> None:
    lose(driving, "encoders", 0.12, FaultKind.FROZEN)
    driving.run(0.4)
    assert telemetry(driving).stop_reason is StopReason.STALLED
    assert abs(driving.world.speed_mps()) < STANDS_MPS
    driving.run(2.5)
    assert (telemetry(driving).state, telemetry(driving).stop_reason) == (MissionState.OBSERVE, StopReason.NONE)
    assert driving.world.speed_mps() > 0.05


def test_dead_encoders_end_the_mission_after_one_more_try(driving: Lockstep) -> None:
    driving.faults.encoders.kind = FaultKind.FROZEN
    assert time_to_stand_s(driving) < WITHIN_S
    driving.run(2.5)
    assert (telemetry(driving).state, telemetry(driving).stop_reason) == (MissionState.HALTED, StopReason.STALLED)
    assert abs(driving.world.speed_mps()) < STANDS_MPS


@pytest.mark.parametrize(
    ("device", "kind", "reason"),
    [
        ("scanner", FaultKind.FROZEN, StopReason.SENSOR_STALE),
        ("scanner", FaultKind.BLIND, StopReason.SENSOR_STALE),
        ("imu", FaultKind.FROZEN, StopReason.SENSOR_STALE),
        ("encoders", FaultKind.FROZEN, StopReason.STALLED),
    ],
)
def test_a_sensor_that_lies_stops_the_car(driving: Lockstep, device: str, kind: FaultKind, reason: StopReason) -> None:
    getattr(driving.faults, device).kind = kind
    assert time_to_stand_s(driving) < WITHIN_S
    driving.run(0.5)
    assert telemetry(driving).stop_reason is reason
    assert driving.world.collisions.count == 0


def test_with_encoders_dead_from_the_start_no_try_to_set_off_lasts_longer_than_it_may(
    make_system: Callable[..., Lockstep],
) -> None:
    system = make_system()
    system.station.connect("loopback", 0)
    system.run(3.0)
    system.faults.encoders.kind = FaultKind.FROZEN
    system.station.start()
    longest_s = moving_s = 0.0
    for _ in range(125):
        system.run(0.02)
        moving_s = moving_s + 0.02 if abs(system.world.speed_mps()) > STANDS_MPS else 0.0
        longest_s = max(longest_s, moving_s)
    assert 0.0 < longest_s < WITHIN_S
    assert (telemetry(system).state, telemetry(system).stop_reason) == (MissionState.HALTED, StopReason.STALLED)


def stuck_on_the_left() -> Callable[[EncoderCount], EncoderCount]:
    held: list[int] = []

    def change(count: EncoderCount) -> EncoderCount:
        held.append(count.left)
        return replace(count, left=held[0])

    return change


def test_one_dead_encoder_is_named_and_ends_the_mission(driving: Lockstep) -> None:
    driving.faults.encoders.change = stuck_on_the_left()
    assert time_to_stand_s(driving) < WITHIN_S
    driving.run(0.5)
    assert (telemetry(driving).state, telemetry(driving).stop_reason) == (MissionState.HALTED, StopReason.ENCODER_FAULT)
    assert "the left encoder does not count" in telemetry(driving).faults


def test_a_robot_on_its_side_stops(driving: Lockstep) -> None:
    driving.faults.imu.change = lambda imu: replace(imu, acceleration_mps2=(0.0, 9.8, 0.1))
    assert time_to_stand_s(driving) < WITHIN_S
    driving.run(0.5)
    assert telemetry(driving).stop_reason is StopReason.TILTED


def test_a_gyro_whose_bias_has_jumped_is_learnt_anew_and_the_mission_goes_on(driving: Lockstep) -> None:
    def biased(imu: ImuSample) -> ImuSample:
        x, y, z = imu.gyro_radps
        return replace(imu, gyro_radps=(x, y, z + 0.26))

    driving.faults.imu.change = biased
    time_to_stand_s(driving)
    driving.run(0.5)
    assert telemetry(driving).stop_reason is StopReason.SENSORS_DISAGREE
    driving.run(4.0)
    assert telemetry(driving).state is MissionState.OBSERVE
    assert driving.world.speed_mps() > 0.05
    assert driving.app._odometry.gyro_bias_radps == pytest.approx(0.26, abs=0.1)


def test_a_control_task_that_hangs_is_noticed_and_the_motor_cut(driving: Lockstep) -> None:
    guarded = next(g for g in driving._runner._guarded if g.task.row.name == "control")
    guarded.task = Task(guarded.task.row, lambda: None)
    assert time_to_stand_s(driving) < WITHIN_S


def test_a_control_task_that_fails_cuts_the_motor(driving: Lockstep) -> None:
    def fail(now_s: float, may_move: bool) -> DriveSetting:
        raise RuntimeError("a bug")

    driving.app._pilot.step = fail  # type: ignore[method-assign]
    assert time_to_stand_s(driving) < WITHIN_S
    driving.run(0.5)
    assert telemetry(driving).stop_reason is StopReason.TASK_FAULT
    assert "control: a bug" in telemetry(driving).faults


@pytest.mark.parametrize("setting", [DriveSetting(math.nan, 0.0), DriveSetting(0.2, math.inf)])
def test_a_setting_that_is_no_number_never_reaches_the_motor(driving: Lockstep, setting: DriveSetting) -> None:
    driving.app._pilot.step = lambda now_s, may_move: setting  # type: ignore[method-assign]
    assert time_to_stand_s(driving) < 0.5
    driving.run(0.5)
    assert telemetry(driving).stop_reason is StopReason.TASK_FAULT


def test_an_app_that_ends_stops_the_car_first_and_keeps_it_stopped(driving: Lockstep) -> None:
    driving.app.stop_for_good()
    assert time_to_stand_s(driving) < 0.5
    driving.station.start()
    driving.run(2.0)
    assert abs(driving.world.speed_mps()) < STANDS_MPS


def test_an_emergency_stop_pressed_while_the_link_is_lost_holds_when_it_is_back(driving: Lockstep) -> None:
    driving.cut_link()
    driving.run(0.5)
    driving.station.emergency_stop()
    driving.run(1.5)
    driving.mend_link()
    driving.run(6.0)
    assert driving.station.view().link_state is LinkState.CONNECTED
    assert (telemetry(driving).state, telemetry(driving).stop_reason) == (MissionState.HALTED, StopReason.EMERGENCY)
    assert abs(driving.world.speed_mps()) < STANDS_MPS


def test_an_emergency_stop_between_two_connections_holds(driving: Lockstep) -> None:
    driving.cut_link()
    driving.run(0.3)
    driving.station.disconnect()
    driving.station.connect("loopback", 0)
    driving.run(0.3)
    driving.station.emergency_stop()
    driving.mend_link()
    driving.run(6.0)
    assert telemetry(driving).state is MissionState.HALTED
    assert abs(driving.world.speed_mps()) < STANDS_MPS


def test_an_operator_who_connects_again_must_start_again(driving: Lockstep) -> None:
    driving.station.disconnect()
    driving.run(0.2)
    driving.station.connect("loopback", 0)
    driving.run(4.0)
    assert telemetry(driving).state is MissionState.HALTED
    assert abs(driving.world.speed_mps()) < STANDS_MPS
    driving.station.start()
    driving.run(3.0)
    assert driving.world.speed_mps() > 0.05


def test_a_window_that_hangs_does_not_keep_the_robot_going(driving: Lockstep) -> None:
    driving.use_operator(lambda: None)  # nobody looks at the view any more
    began_s = driving.clock.now_s()
    while abs(driving.world.speed_mps()) > STANDS_MPS:
        driving.run(0.02)
        assert driving.clock.now_s() - began_s < 3.0
    driving.run(0.5)
    assert telemetry(driving).stop_reason is StopReason.COMMAND_SILENCE


def test_an_unplugged_device_is_named_to_the_operator(driving: Lockstep) -> None:
    driving.faults.scanner.kind = FaultKind.UNPLUGGED
    driving.run(0.5)
    assert "scan: scanner: is unplugged" in telemetry(driving).faults
    assert any("scanner: is unplugged" in entry.text for entry in driving.station.log_since(0))


@pytest.mark.parametrize("device", ["camera", "power", "thermometer"])
def test_without_a_device_it_can_do_without_the_robot_goes_on(driving: Lockstep, device: str) -> None:
    getattr(driving.faults, device).kind = FaultKind.UNPLUGGED
    driving.run(2.5)
    assert driving.world.speed_mps() > 0.05
    assert telemetry(driving).state is MissionState.OBSERVE
    assert any("is unplugged" in fault for fault in telemetry(driving).faults)


def test_a_dead_link_stops_the_car_and_the_mission_goes_on_when_it_is_back(driving: Lockstep) -> None:
    driving.cut_link()
    assert time_to_stand_s(driving) < 1.5  # a second of silence, and the braking
    assert driving.station.view().link_state is LinkState.LOST
    driving.run(3.0)
    driving.mend_link()
    driving.run(6.0)
    assert driving.station.view().link_state is LinkState.CONNECTED
    assert telemetry(driving).state is MissionState.OBSERVE
    assert driving.world.speed_mps() > 0.05
    assert driving.world.collisions.count == 0


def test_a_link_that_stays_dead_ends_the_mission(driving: Lockstep) -> None:
    driving.cut_link()
    driving.run(17.0)
    driving.mend_link()
    driving.run(5.0)
    assert (telemetry(driving).state, telemetry(driving).stop_reason) == (
        MissionState.HALTED,
        StopReason.COMMAND_SILENCE,
    )
    assert abs(driving.world.speed_mps()) < STANDS_MPS


def test_an_emergency_stop_cuts_the_motor_at_once(driving: Lockstep) -> None:
    driving.station.emergency_stop()
    assert time_to_stand_s(driving) < 0.5  # the shorted motor brakes the car from 0.25 m/s
    driving.run(0.5)
    assert telemetry(driving).stop_reason is StopReason.EMERGENCY


def test_a_stopped_mission_can_be_started_again_and_the_map_goes_on(driving: Lockstep) -> None:
    driving.station.stop()
    time_to_stand_s(driving)
    driving.run(0.3)
    before = driving.station.view().snapshot
    driving.station.start()
    driving.run(3.0)
    after = driving.station.view().snapshot
    assert driving.world.speed_mps() > 0.05
    assert before is not None
    assert after is not None
    assert after.observations > before.observations


def test_driving_by_hand_refuses_to_hit_a_wall(make_system: Callable[..., Lockstep]) -> None:
    system = make_system()
    system.station.connect("loopback", 0)
    system.run(3.0)
    system.station.start()
    system.run(0.5)
    system.use_operator(lambda: (system.station.view(), system.station.drive(0.4, 0.0)))
    system.run(12.0)
    assert system.world.collisions.count == 0
    assert system.truth().distance_m > 0.5


def test_an_order_to_race_is_limited_to_the_robots_speed(driving: Lockstep) -> None:
    fastest = 0.0
    driving.use_operator(lambda: (driving.station.view(), driving.station.drive(30.0, 9.0)))
    for _ in range(100):
        driving.run(0.02)
        fastest = max(fastest, abs(driving.world.speed_mps()))
    assert fastest < 0.5
    assert driving.world.collisions.count == 0


def test_a_robot_that_is_idle_does_not_move(make_system: Callable[..., Lockstep]) -> None:
    system = make_system()
    system.station.connect("loopback", 0)
    system.use_operator(lambda: (system.station.view(), system.station.drive(0.4, 0.0)))
    system.run(3.0)
    assert system.truth().distance_m < 0.005
    assert any("press start before driving by hand" in entry.text for entry in system.station.log_since(0))
