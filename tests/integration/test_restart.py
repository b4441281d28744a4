"""The mission over a start of the app, in lock-step."""

from __future__ import annotations

from pathlib import Path

from robot_app.app import RobotApp
from robot_app.config import load_config
from robot_app.mission_store import MissionStore
from shared.link.loopback import loopback_pair
from shared.messages import Command, Heartbeat, MissionState, NumberedCommand, Pause, Resume, Start, StopReason
from shared.protocol.codec import encode
from shared.runtime.clock import ManualClock
from shared.runtime.runner import LockstepRunner, Row
from tools.simulator.drivers import SimulatedHardware
from tools.simulator.scenario import find_scenario
from tools.simulator.world import World


def never(row: Row, error: Exception) -> None:
    raise error


class Rig:
    """A robot with a station that only speaks."""

    def __init__(self, world: World, clock: ManualClock, folder: Path) -> None:
        robot, self._station = loopback_pair()
        hardware = SimulatedHardware(world, waits=False).hardware
        self.app = RobotApp(hardware, robot, clock, load_config(None), 1, MissionStore(folder))
        self._clock = clock
        tasks = [task for task in self.app.tasks() if task.row.name != "depth"]
        self._runner = LockstepRunner(tasks, clock, world.advance_to, never)
        self._number = 0

    def run(self, seconds: float, *orders: Command) -> None:
        for k in range(round(seconds * 5)):
            for command in (*(orders if k == 0 else ()), Heartbeat()):
                self._number += 1
                self._station.send(encode(NumberedCommand(self._number, command)))
            self._runner.run_until(self._clock.now_s() + 0.2)
            while self._station.receive(0.0) is not None:
                pass


def _ready(world: World, clock: ManualClock, folder: Path) -> Rig:
    rig = Rig(world, clock, folder)
    rig.app.warm_up()
    rig.run(3.0)
    return rig


def test_a_mission_is_paused_by_a_start_of_the_app_and_goes_on_when_told(tmp_path: Path) -> None:
    clock, world = ManualClock(), World(find_scenario("lab"), 1)
    first = _ready(world, clock, tmp_path)
    first.run(4.0, Start())
    assert world.truth.distance_m > 0.3
    del first  # killed: nothing is said or written any more
    world.cut_motor()
    again = Rig(world, clock, tmp_path)
    again.run(2.0)
    mission = again.app._mission
    assert (mission.state, mission.stop_reason) == (MissionState.PAUSED, StopReason.RESTARTED)
    stood_m = world.truth.distance_m
    again.run(1.0)
    assert world.truth.distance_m - stood_m < 0.01
    again.run(4.0, Resume())
    assert mission.state is MissionState.OBSERVE
    assert world.truth.distance_m - stood_m > 0.3
    assert mission.record.distance_m > 0.6


def test_a_car_whose_battery_gets_low_while_it_is_paused_drives_home_once_it_goes_on(tmp_path: Path) -> None:
    clock, world = ManualClock(), World(find_scenario("lab"), 1)
    rig = _ready(world, clock, tmp_path)
    rig.run(3.0, Start())
    rig.run(1.0, Pause())
    world.battery._charge = 0.05
    rig.run(15.0)  # the voltage is smoothed
    mission = rig.app._mission
    assert mission.state is MissionState.PAUSED
    rig.run(2.0, Resume())
    assert mission.state is MissionState.RETURN
