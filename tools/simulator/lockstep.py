"""A whole mission in one thread on a manual clock: the same app, the same station, no real time."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_app.app import RobotApp
from robot_app.config import RobotConfig
from shared.link.base import Link, LinkError
from shared.link.loopback import loopback_pair
from shared.runtime.clock import ManualClock
from shared.runtime.runner import LockstepRunner, OnFault, Row, Task
from station_gui.build import build_station
from station_gui.config import StationConfig
from station_gui.mapping.snapshot import MapSnapshot
from station_gui.model.figures import MissionFigures
from station_gui.model.station import Station
from tools.director import Director, Outcome
from tools.simulator.drivers import SimulatedHardware
from tools.simulator.scenario import Scenario
from tools.simulator.truth import RecordedTruth, read_truth, write_truth
from tools.simulator.world import World

_OPERATOR = Row("operator", 10.0, 1.0, 0.1, OnFault.RETRY)
_SLICE_S = 1.0
_LONGEST_S = 900.0


@dataclass(frozen=True, slots=True, eq=False)
class MissionResult:
    truth: RecordedTruth
    snapshot: MapSnapshot | None
    figures: MissionFigures
    outcome: Outcome


class _Hands:
    """Gives the director's orders straight to the station."""

    def __init__(self, station: Station) -> None:
        self._station = station

    def connect(self) -> None:
        self._station.connect("loopback", 0)

    def start(self) -> None:
        self._station.start()

    def go_to(self, x_m: float, y_m: float) -> None:
        self._station.go_to(x_m, y_m)

    def stop(self) -> None:
        self._station.stop()


def run_mission(
    scenario: Scenario,
    seed: int,
    robot: RobotConfig,
    station: StationConfig,
    say: Callable[[str], None],
    progress: Callable[[float], None],
    recording: Path | None = None,
) -> MissionResult:
    """The demo's mission; `progress` is told the simulated seconds now and then."""
    clock = ManualClock()
    world = World(scenario, seed)
    hardware = SimulatedHardware(world, waits=False).hardware
    robot_end, station_end = loopback_pair()
    app = RobotApp(hardware, robot_end, clock, robot, np.random.default_rng(seed))
    ends: list[Link] = [station_end]
    console = build_station(station, clock, 1, make_link=lambda *_: _take(ends), name_recording=lambda: recording)
    director = Director(_Hands(console), scenario.goals_in_start_frame_m(), say)
    operator = Task(_OPERATOR, lambda: director.step(console.view()))
    runner = LockstepRunner([*app.tasks(), *console.tasks(), operator], clock, world.advance_to, _never)
    app.use_health(lambda: runner.health)
    app.warm_up()
    try:
        while director.outcome is None and clock.now_s() < _LONGEST_S:
            runner.run_until(clock.now_s() + _SLICE_S)
            progress(clock.now_s())
    finally:
        app.shut_down()
        console.close()
    outcome = director.outcome or Outcome(f"not finished after {_LONGEST_S:.0f} s", 0.0, clock.now_s())
    return MissionResult(_truth(world), console.finish_mapping(), console.figures, outcome)


def _take(ends: list[Link]) -> Link:
    if not ends:
        raise LinkError("loopback: the link can be made only once")
    return ends.pop()


def _truth(world: World) -> RecordedTruth:
    with tempfile.TemporaryDirectory() as folder:
        write_truth(world, Path(folder))
        return read_truth(Path(folder))


def _never(row: Row, error: Exception) -> None:
    """In lock-step nothing may fail: a fault is a bug, and ends the mission where it is."""
    raise error
