from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from robot_app.config import load_config as load_robot
from station_gui.config import load_config as load_station
from tools.simulator.lockstep import Lockstep
from tools.simulator.scenario import find_scenario


@pytest.fixture
def make_system() -> Iterator[Callable[..., Lockstep]]:
    """Robot, world and station in lock-step."""
    made: list[Lockstep] = []

    def make(seed: int = 1) -> Lockstep:
        system = Lockstep(find_scenario("lab"), seed, load_robot(None), load_station(None))
        made.append(system)
        return system

    yield make
    for system in made:
        system.close()


@pytest.fixture
def driving(make_system: Callable[..., Lockstep]) -> Lockstep:
    """A robot in the middle of its observation."""
    system = make_system()
    system.station.connect("loopback", 0)
    system.run(3.0)
    system.station.start()
    system.run(4.0)
    assert system.world.speed_mps() > 0.1
    return system
