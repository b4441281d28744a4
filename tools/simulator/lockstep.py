"""Robot, world and station in one thread on a manual clock: the same app, the same station, no real time."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robot_app.app import RobotApp
from robot_app.config import AnyRobotConfig
from robot_app.schedule import DEPTH
from shared.geometry.se2 import Pose2
from shared.runtime.clock import ManualClock
from shared.runtime.runner import LockstepRunner, OnFault, Row, Task
from station_gui.build import build_station
from station_gui.config import StationConfig
from station_gui.mapping.snapshot import MapSnapshot
from station_gui.model.figures import MissionFigures
from station_gui.model.station import MAPPING_ROW, PLANNING_ROW, Station
from tools.director import Director, Outcome
from tools.simulator.drivers import SimulatedHardware
from tools.simulator.faults import with_faults
from tools.simulator.links import Cut, Joint, LinkName, WatchedJoint, open_links
from tools.simulator.scenario import Scenario
from tools.simulator.slip import SlipFigures
from tools.simulator.truth import RecordedTruth, read_truth, write_truth
from tools.simulator.witness import Witness
from tools.simulator.world import World

_OPERATOR = Row("operator", 10.0, 1.0, 0.1, OnFault.RETRY)
_SLICE_S = 1.0
MAPPING_AND_DEPTH = frozenset({DEPTH, MAPPING_ROW, PLANNING_ROW})
_LONGEST_S = 900.0


@dataclass(frozen=True, slots=True, eq=False)
class MissionResult:
    truth: RecordedTruth
    snapshot: MapSnapshot | None
    figures: MissionFigures
    outcome: Outcome
    slip: SlipFigures
    gyro_bias_dps: float  # of the axis that points up, at the end
    cuts: tuple[Cut, ...] = ()  # of Wi-Fi


class Lockstep:
    """One robot and one station, joined by a link that can be cut and mended."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        robot: AnyRobotConfig,
        station: StationConfig,
        recording: Path | None = None,
        link: LinkName = "tcp",
        witness: Witness | None = None,
        link_seed: int | None = None,
        without: frozenset[Row] = frozenset(),
    ) -> None:
        """`without`: tasks that do not run."""
        self.clock = ManualClock()
        self.joint: Joint = open_links(link, self.clock, seed if link_seed is None else link_seed)
        if witness is not None:
            self.joint = WatchedJoint(self.joint, witness, self.clock)
        self.world = World(scenario, seed)
        simulated = SimulatedHardware(self.world, waits=False)
        self.slip, self.imu = simulated.slip, simulated.imu
        hardware, self.faults = with_faults(simulated.hardware)
        self.app = RobotApp(hardware, self.joint.robot, self.clock, robot, boot_id=1)
        self.station: Station = build_station(
            station, self.clock, 1, make_link=self.joint.make_station, name_recording=lambda: recording
        )
        self._operator: Callable[[], object] = self.station.view
        self.failures: list[str] = []
        tasks = [*self.app.tasks(), *self.station.tasks(), Task(_OPERATOR, self._operate)]
        tasks = [task for task in tasks if task.row not in without]
        self._runner = LockstepRunner(tasks, self.clock, self._advance_to, self._on_fault)
        self.app.use_health(lambda: self._runner.health)
        self.app.warm_up()

    def use_operator(self, step: Callable[[], object]) -> None:
        """`step` is called ten times a second, in place of the look at the view that keeps the robot going."""
        self._operator = step

    def hang(self, task: str, hangs: bool) -> None:
        """Whether the task stands still from now on."""
        self._runner.hang(task, hangs)

    def replace_step(self, task: str, step: Callable[[], None]) -> Callable[[], None]:
        """Make the task fail; returns what it did so far."""
        return self._runner.replace_step(task, step)

    def run(self, seconds: float) -> None:
        self._runner.run_until(self.clock.now_s() + seconds)

    def carry_robot(self, room_from_robot: Pose2) -> None:
        """Somebody puts the robot down somewhere else; it feels nothing of it."""
        self.world.place(room_from_robot)

    def cut_link(self) -> None:
        """Nothing gets through, and no link can be made again, until `mend_link`."""
        self.joint.cut()

    def mend_link(self) -> None:
        self.joint.mend()

    def close(self) -> None:
        self.app.shut_down()
        self.station.close()

    def truth(self, kept: Path | None = None) -> RecordedTruth:
        """As it is read back from its files, which stay in the folder `kept`, where that is given."""
        with tempfile.TemporaryDirectory() as passing:
            folder = kept if kept is not None else Path(passing)
            write_truth(self.world, folder)
            return read_truth(folder)

    def _advance_to(self, time_s: float) -> None:
        self.world.advance_to(time_s)
        self.joint.advance_to(time_s)

    def _operate(self) -> None:
        self._operator()

    def _on_fault(self, row: Row, error: Exception) -> None:
        self.failures.append(f"{row.name}: {error}")
        self.app.on_fault(row, error)


class Orders:
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
    robot: AnyRobotConfig,
    station: StationConfig,
    say: Callable[[str], None],
    progress: Callable[[float], None],
    recording: Path | None = None,
    link: LinkName = "tcp",
    witness: Witness | None = None,
    ends_s: float | None = None,
    link_seed: int | None = None,
) -> MissionResult:
    """The demo's mission; `progress` is told the simulated seconds now and then. The truth is kept beside a recording.

    With `ends_s` it ends then, however many goals are left, and that is no failure. `link_seed`: of the link alone,
    where it shall be another one than `seed`.

    Raises `RuntimeError` when a task of the robot or of the station failed: in a mission without faults that is a bug.
    """
    system = Lockstep(scenario, seed, robot, station, recording, link, witness, link_seed)
    director = Director(Orders(system.station), scenario.goals_in_start_frame_m(), say)
    system.use_operator(lambda: director.step(system.station.view()))
    longest_s = ends_s if ends_s is not None else _LONGEST_S
    try:
        while director.outcome is None and system.clock.now_s() < longest_s and not system.failures:
            system.run(_SLICE_S)
            progress(system.clock.now_s())
    finally:
        system.close()
    if system.failures:
        raise RuntimeError(f"a task failed: {system.failures[0]}")
    late = f"not finished after {longest_s:.0f} s" if ends_s is None else ""
    outcome = director.outcome or Outcome(late, 0.0, system.clock.now_s())
    snapshot = system.station.finish_mapping()
    bias_dps = math.degrees(float(system.imu.gyro_bias_radps[2]))
    truth = system.truth(recording.parent / "truth" if recording is not None else None)
    return MissionResult(
        truth, snapshot, system.station.figures, outcome, system.slip.figures(), bias_dps, system.joint.cuts
    )
