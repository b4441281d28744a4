"""Missions over LoRa, and over Wi-Fi that fails with LoRa beside it, through emulated modules in lock-step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from robot_app.config import load_config as load_robot
from shared.link.base import LinkPath
from shared.messages import MissionState, Observation, StopReason
from station_gui.comms.state import LinkState
from station_gui.config import load_config as load_station
from tools.replay import MissionSource
from tools.simulator.links import LinkName
from tools.simulator.lockstep import Lockstep
from tools.simulator.scenario import find_scenario

STANDS_MPS = 0.01
BRAKING_S = 0.5


@pytest.fixture
def driving(tmp_path: Path) -> Iterator[Callable[[LinkName], Lockstep]]:
    """A robot in the middle of its observation."""
    made: list[Lockstep] = []

    def make(link: LinkName) -> Lockstep:
        recording = tmp_path / "mission.mcap"
        system = Lockstep(find_scenario("lab"), 1, load_robot(None), load_station(None), recording, link)
        made.append(system)
        system.station.connect("loopback", 0)
        while system.station.view().link_state is not LinkState.CONNECTED:
            system.run(0.2)
            assert system.clock.now_s() < 10.0
        system.station.start()
        system.run(3.0)
        assert system.world.speed_mps() > 0.1
        return system

    yield make
    for system in made:
        system.close()


def time_to_stand_s(system: Lockstep) -> float:
    began_s = system.clock.now_s()
    while abs(system.world.speed_mps()) > STANDS_MPS:
        system.run(0.02)
        assert system.clock.now_s() - began_s < 5.0, "the car goes on"
    return system.clock.now_s() - began_s


def recorded(system: Lockstep, path: Path) -> list[Observation]:
    system.station.disconnect()
    return list(MissionSource(path))


def test_a_mission_over_lora_alone_keeps_its_pace_in_few_bytes(
    driving: Callable[[LinkName], Lockstep], tmp_path: Path
) -> None:
    system = driving("lora")
    system.run(5.0)
    view = system.station.view()
    assert view.link.path is LinkPath.RADIO
    assert view.link.observations_hz >= 8.0
    assert view.link.bytes_per_observation <= 75
    assert view.telemetry is not None
    assert view.telemetry.speed_mps == pytest.approx(system.world.speed_mps(), abs=0.1)
    assert view.telemetry_age_s < 0.3
    assert view.robot is not None
    assert view.snapshot is not None
    system.station.emergency_stop()
    assert time_to_stand_s(system) < 1.0 + BRAKING_S
    system.run(1.0)
    assert system.station.view().telemetry.stop_reason is StopReason.EMERGENCY  # type: ignore[union-attr]
    sequences = [o.sequence for o in recorded(system, tmp_path / "mission.mcap")]
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences))), "nothing lost, nothing doubled"
    assert system.failures == []


def test_without_lora_the_car_stands_and_goes_on_when_it_is_back(driving: Callable[[LinkName], Lockstep]) -> None:
    system = driving("lora")
    limit_s = load_robot(None).safety.command_silence_radio_s
    system.cut_link()
    assert time_to_stand_s(system) < limit_s + BRAKING_S
    system.run(4.0)
    assert system.station.view().link_state is LinkState.LOST
    system.mend_link()
    system.run(6.0)
    view = system.station.view()
    assert view.link_state is LinkState.CONNECTED
    assert view.telemetry is not None
    assert view.telemetry.state is MissionState.OBSERVE
    assert system.world.speed_mps() > 0.05
    assert system.world.collisions.count == 0


def test_wifi_that_fails_again_and_again_costs_no_observation_and_no_stop(
    driving: Callable[[LinkName], Lockstep], tmp_path: Path
) -> None:
    system = driving("switch")
    paths: set[LinkPath | None] = set()
    slowest_mps = 1.0
    while system.clock.now_s() < 17.0:
        system.run(0.1)
        paths.add(system.station.view().link.path)
        slowest_mps = min(slowest_mps, abs(system.world.speed_mps()))
    assert paths == {LinkPath.WIFI, LinkPath.RADIO}
    assert slowest_mps > STANDS_MPS
    assert any("using LoRa" in entry.text for entry in system.station.log_since(0))
    observations = recorded(system, tmp_path / "mission.mcap")
    assert len(observations) > 9.0 * (17.0 - 2.0)
    np.testing.assert_array_equal(np.diff([o.sequence for o in observations]), 1)
    assert system.failures == []
