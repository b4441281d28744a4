"""The omnidirectional robot on the shared code: the same app and station, other wheels."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest

from robot_app.config import OmniRobotConfig
from robot_app.drivers.base import EncoderCount, OmniCount
from shared.messages import MissionState, StopReason
from station_gui.config import load_config as load_station
from tools.director import Director
from tools.simulator.faults import FaultKind
from tools.simulator.lockstep import MAPPING_AND_DEPTH, Lockstep, Orders
from tools.simulator.robots import with_robot
from tools.simulator.scenario import Item, Room, Start, find_scenario

STANDS_MPS = 0.01
WITHIN_S = 0.30
LOOKED_AT_S = 0.01


@pytest.fixture
def make_omni() -> Iterator[Callable[..., Lockstep]]:
    """In a short corridor with a thing at its wall; without map and camera."""
    made: list[Lockstep] = []

    def make(length_m: float = 3.4) -> Lockstep:
        scenario, config = with_robot(find_scenario("corridor"), "omni", None)
        assert isinstance(config, OmniRobotConfig)
        thing = Item("carton", (length_m - 1.8, 0.3), (0.3, 0.3, 0.3))
        scenario = replace(scenario, start=Start((0.8, 1.0)), room=Room(length_m, 2.0), items=(thing,), goals=())
        wall = replace(config.control.wall, look_round_radps=2.0)
        config = replace(config, control=replace(config.control, wall=wall))
        made.append(Lockstep(scenario, 1, config, load_station(None), without=MAPPING_AND_DEPTH))
        return made[-1]

    yield make
    for system in made:
        system.close()


@pytest.fixture
def driving(make_omni: Callable[[], Lockstep]) -> Lockstep:
    """Beside the wall, in the middle of its observation."""
    system = make_omni()
    system.station.connect("loopback", 0)
    system.run(3.0)
    system.station.start()
    system.run(7.0)
    assert speed_mps(system) > 0.1
    return system


def speed_mps(system: Lockstep) -> float:
    x, y = system.world.data.qvel[:2].tolist()
    return math.hypot(x, y)


def turn_radps(system: Lockstep) -> float:
    return abs(float(system.world.data.qvel[5]))


def state(system: Lockstep) -> MissionState:
    return system.app._mission.state


def time_to_stand_s(system: Lockstep) -> float:
    began_s = system.clock.now_s()
    while speed_mps(system) > STANDS_MPS or turn_radps(system) > 0.05:
        system.run(LOOKED_AT_S)
        assert system.clock.now_s() - began_s < 3.0, "the robot goes on"
    return system.clock.now_s() - began_s


def reason(system: Lockstep) -> StopReason:
    telemetry = system.station.view().telemetry
    assert telemetry is not None
    return telemetry.stop_reason


@pytest.mark.slow
def test_it_observes_a_corridor_without_contact_and_ends_by_itself(make_omni: Callable[[], Lockstep]) -> None:
    system = make_omni()
    director = Director(Orders(system.station), (), lambda _: None)
    system.use_operator(lambda: director.step(system.station.view()))
    while director.outcome is None and system.clock.now_s() < 90.0:
        system.run(1.0)
    assert director.outcome is not None
    assert director.outcome.failure == ""
    assert system.failures == []
    assert system.world.collisions.count == 0
    assert system.world.truth.distance_m > 5.0
    hello = system.station.view().robot
    assert hello is not None
    assert (hello.robot_name, hello.min_turning_radius_m) == ("omni-1", 0.0)


def test_without_what_it_needs_it_stands_and_goes_on_when_it_is_back(driving: Lockstep) -> None:
    for device in ("scanner", "imu", "encoders"):
        fault = getattr(driving.faults, device)
        fault.kind = FaultKind.UNPLUGGED
        assert time_to_stand_s(driving) < WITHIN_S, device
        driving.run(0.5)
        assert reason(driving) is StopReason.DEVICE_FAULT
        fault.kind = FaultKind.NONE
        driving.run(2.5)
        assert reason(driving) is StopReason.NONE
        assert speed_mps(driving) + turn_radps(driving) > 0.05, device
    driving.cut_link()
    driving.run(1.3)  # the silence that is allowed
    assert time_to_stand_s(driving) < 0.6
    assert driving.app._standing_reason is StopReason.COMMAND_SILENCE
    assert driving.world.collisions.count == 0


def test_from_its_greatest_speed_it_stands_as_soon(make_omni: Callable[..., Lockstep]) -> None:
    system = make_omni(12.0)
    system.station.connect("loopback", 0)
    system.run(3.0)
    system.station.start()
    for device, kind in (
        ("scanner", FaultKind.SILENT),
        ("imu", FaultKind.UNPLUGGED),
        ("encoders", FaultKind.SILENT),
    ):
        while speed_mps(system) < 0.40:
            system.run(0.1)
            assert system.clock.now_s() < 30.0
        fault = getattr(system.faults, device)
        fault.kind = kind
        system.run(0.02)
        assert time_to_stand_s(system) + 0.02 <= WITHIN_S, device
        at = system.world.room_from_robot()
        system.run(0.3)
        assert system.world.room_from_robot().distance_m(at) < 0.002
        fault.kind = FaultKind.NONE


def test_without_its_drive_it_rolls_out_and_the_mission_ends(driving: Lockstep) -> None:
    driving.faults.drive.kind = FaultKind.UNPLUGGED
    assert time_to_stand_s(driving) < 0.6  # nothing can push against the way
    driving.run(0.5)
    assert (state(driving), reason(driving)) == (MissionState.HALTED, StopReason.DEVICE_FAULT)


def test_one_dead_encoder_ends_the_mission_before_the_robot_swerves(driving: Lockstep) -> None:
    at = driving.world.room_from_robot()
    frozen: list[int] = []

    def front_right_is_dead(count: OmniCount | EncoderCount) -> OmniCount | EncoderCount:
        assert isinstance(count, OmniCount)
        frozen.append(count.wheels[0])
        return replace(count, wheels=(frozen[0], *count.wheels[1:]))

    driving.faults.encoders.change = front_right_is_dead
    assert time_to_stand_s(driving) < 0.8
    driving.run(0.5)
    assert reason(driving) is StopReason.ENCODER_FAULT
    assert driving.station.view().telemetry.state is MissionState.HALTED  # type: ignore[union-attr]
    assert driving.world.room_from_robot().distance_m(at) < 0.2
    assert driving.world.collisions.count == 0


def test_it_drives_home_when_the_battery_is_low(driving: Lockstep) -> None:
    home = driving.app._mission.home
    assert home is not None
    began = driving.world.room_from_robot() @ driving.app._odometry.state.odom_from_robot.inverse() @ home
    driving.faults.power.change = lambda power: replace(power, battery_v=5.9)
    driving.run(3.0)
    assert state(driving) is MissionState.RETURN
    while state(driving) is MissionState.RETURN and driving.clock.now_s() < 60.0:
        driving.run(0.5)
    assert state(driving) is MissionState.PAUSED
    assert driving.world.room_from_robot().distance_m(began) < 0.03
    assert driving.world.collisions.count == 0


def test_an_emergency_stop_stops_it(driving: Lockstep) -> None:
    driving.station.emergency_stop()
    assert time_to_stand_s(driving) < 0.5
    driving.run(0.5)
    assert reason(driving) is StopReason.EMERGENCY
