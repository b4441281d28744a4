from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from shared.geometry.rays import cast_rays
from shared.geometry.se2 import Pose2
from shared.link.loopback import LoopbackLink, loopback_pair
from shared.messages import (
    Ack,
    Drive,
    GoTo,
    Heartbeat,
    Hello,
    MissionState,
    NumberedCommand,
    ObjectNetwork,
    Observation,
    Report,
    Start,
    Stop,
    StopReason,
)
from shared.protocol.codec import Decoder, encode
from shared.recording import MissionReader
from shared.runtime.clock import ManualClock
from shared.runtime.runner import LockstepRunner
from station_gui.build import build_station
from station_gui.comms.state import LinkState
from station_gui.config import load_config
from station_gui.mapping.pipeline import MappingPipeline
from station_gui.mapping.saved_map import read_map
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.snapshot import MapSnapshot, Tracking
from station_gui.model.station import Station
from tests.shared import samples

ROOM = np.array(  # x0, y0, x1, y1 of its walls
    [[-1, -1, 3, -1], [3, -1, 3, 2], [3, 2, -1, 2], [-1, 2, -1, -1], [2, -1, 2, 0]], np.float64
)


def observation(sequence: int, pose: Pose2) -> Observation:
    """A perfect scan of the room."""
    geometry = dataclasses.replace(samples.GEOMETRY, beam_interval_s=0.0)
    scanner = pose @ geometry.robot_from_scanner
    angles = geometry.angles_rad(227) + scanner.theta_rad
    ranges = np.empty(len(angles))
    cast_rays(scanner.x_m, scanner.y_m, angles, ROOM, geometry.range_max_m, ranges)
    return Observation(
        sequence, sequence / 10, pose, 0.0, 0.0, geometry, ranges.astype(np.float32), ObjectNetwork(), has_objects=False
    )


class Scene:
    """A station and the robot's end of its link, on one clock."""

    def __init__(self, recording: Path | None) -> None:
        self.clock = ManualClock()
        car = load_config(None).car
        self.hello = Hello("r", "0", car.footprint_m(), car.min_turning_radius_m)
        self.robot: LoopbackLink | None = None
        self.station: Station = build_station(
            load_config(None), self.clock, 1, make_link=self._make_link, name_recording=lambda: recording
        )
        self.runner = LockstepRunner(self.station.tasks(), self.clock, lambda _: None, self._fail)

    def _make_link(self, host: str, port: int) -> LoopbackLink:
        self.robot, station = loopback_pair()
        self.robot.send(encode(self.hello))
        return station

    @staticmethod
    def _fail(row: object, error: Exception) -> None:
        raise error

    def run(self, seconds: float) -> None:
        self.runner.run_until(self.clock.now_s() + seconds)

    def send(self, *reports: Report) -> None:
        assert self.robot is not None
        for report in reports:
            assert self.robot.send(encode(report))
        self.run(0.1)

    def commands(self) -> list[NumberedCommand]:
        assert self.robot is not None
        found = []
        while (datagram := self.robot.receive(0.0)) is not None:
            message = Decoder().decode(datagram)
            assert isinstance(message, NumberedCommand)
            if not isinstance(message.command, Heartbeat):
                found.append(message)
                self.robot.send(encode(Ack(message.number, True)))
        return found

    def log(self) -> str:
        return "\n".join(entry.text for entry in self.station.log_since(0))


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    scene = Scene(tmp_path / "m.mcap")
    scene.station.connect("robot", 47100)
    scene.run(0.1)
    yield scene
    scene.station.close()


def with_map(scene: Scene, scans: int = 12) -> Scene:
    for i in range(scans):
        scene.send(observation(i, Pose2(0.04 * i, 0.0, 0.0)))
    scene.send(samples.telemetry(state=MissionState.COMMAND, stamp_s=2.0, faults=()))
    return scene


def test_a_station_that_was_not_connected_shows_nothing_and_sends_nothing() -> None:
    scene = Scene(None)
    scene.station.start()
    view = scene.station.view()
    assert view.link_state is LinkState.DISCONNECTED
    assert view.telemetry is None
    assert view.snapshot is None
    assert "Start was not sent: there is no connection" in scene.log()


def test_observations_become_a_map(scene: Scene) -> None:
    with_map(scene)
    view = scene.station.view()
    assert view.snapshot is not None
    assert view.snapshot.observations == 12
    assert view.snapshot.map_from_robot.x_m == pytest.approx(0.44, abs=0.01)
    assert len(view.snapshot.grid.occupied_m()) > 100
    assert view.link.observations_hz > 0


def test_buttons_become_commands(scene: Scene) -> None:
    scene.station.start()
    scene.run(0.1)
    started = [m.command for m in scene.commands()]
    scene.station.stop()
    scene.run(0.1)
    assert started + [m.command for m in scene.commands()] == [Start(), Stop()]


def test_a_drive_that_is_no_number_is_refused_and_a_stop_still_goes_out(scene: Scene) -> None:
    scene.station.drive(math.nan, 0.0)
    scene.station.stop()
    scene.run(0.1)
    assert [m.command for m in scene.commands()] == [Stop()]


def test_the_map_is_exported_in_every_format_and_a_bad_folder_is_told(scene: Scene, tmp_path: Path) -> None:
    scene.station.export_map(tmp_path / "early")
    assert "no map yet to export" in scene.log()
    with_map(scene).station.export_map(tmp_path / "out")
    (tmp_path / "taken").write_text("a file")
    scene.station.export_map(tmp_path / "taken")
    scene.run(0.2)
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".yaml", ".pgm", ".png", ".ply", ".glb", ".tum"}
    assert f"map exported to {tmp_path / 'out'}" in scene.log()
    assert "choose another folder" in scene.log()
    assert not (tmp_path / "early").exists()


def test_an_export_that_still_waits_at_the_end_is_written(scene: Scene, tmp_path: Path) -> None:
    with_map(scene).station.export_map(tmp_path / "out")
    scene.station.close()
    assert (tmp_path / "out" / "map.glb").is_file()


def test_a_goal_becomes_a_path_in_the_robots_frame(scene: Scene) -> None:
    with_map(scene)
    scene.station.go_to(1.4, 1.2)
    scene.run(0.3)
    orders = [m.command for m in scene.commands() if isinstance(m.command, GoTo)]
    assert len(orders) == 1
    assert math.dist(orders[0].path[-1, :2].tolist(), (1.4, 1.2)) < 0.05
    view = scene.station.view()
    assert view.goal_m == (1.4, 1.2)
    assert view.path_m is not None


@pytest.mark.parametrize(
    ("goal", "reason"), [((10.0, 10.0), "outside the map"), ((2.6, -0.7), "unknown"), ((math.nan, 0.0), "place")]
)
def test_a_goal_that_cannot_be_reached_is_refused_with_its_reason(
    scene: Scene, goal: tuple[float, float], reason: str
) -> None:
    with_map(scene)
    scene.station.go_to(*goal)
    scene.run(0.3)
    assert reason in scene.log()
    assert scene.station.view().goal_m is None
    assert not [m for m in scene.commands() if isinstance(m.command, GoTo)]


def test_a_goal_inside_of_something_is_refused(scene: Scene) -> None:
    snapshot = with_map(scene).station.view().snapshot
    assert snapshot is not None
    x_m, y_m = snapshot.grid.occupied_m()[len(snapshot.grid.occupied_m()) // 2].tolist()
    scene.station.go_to(x_m, y_m)
    scene.run(0.3)
    assert "inside an obstacle" in scene.log()


def test_a_goal_before_the_observation_has_finished_is_refused(scene: Scene) -> None:
    with_map(scene)
    scene.send(samples.telemetry(state=MissionState.OBSERVE, stamp_s=2.2))
    scene.station.go_to(1.4, 1.2)
    scene.run(0.3)
    assert "once the observation has finished" in scene.log()


def test_a_goal_is_reached_when_the_robot_stands_there(scene: Scene) -> None:
    with_map(scene)
    scene.station.go_to(1.4, 1.2)
    scene.run(0.3)
    scene.send(observation(40, Pose2(1.4, 1.2, 1.0)))
    for i in range(12):
        scene.send(samples.telemetry(state=MissionState.COMMAND, stamp_s=4.0 + i / 4, following_goal=0, faults=()))
    assert "goal reached" in scene.log()
    assert scene.station.view().goal_m is None


def test_an_observation_that_comes_twice_counts_once(scene: Scene) -> None:
    for i in (0, 1, 1, 0, 2):
        scene.send(observation(i, Pose2(0.04 * i, 0.0, 0.0)))
    snapshot = scene.station.view().snapshot
    assert snapshot is not None
    assert snapshot.observations == 3


def restarted(scans: int = 3) -> list[Observation]:
    """Of the robot after another start, at the place where its first one began."""
    return [dataclasses.replace(observation(k, Pose2()), boot_id=7) for k in range(scans)]


def test_a_robot_that_was_restarted_before_there_was_a_map_begins_one(scene: Scene) -> None:
    with_map(scene, scans=2)
    scene.send(*restarted())
    snapshot = scene.station.view().snapshot
    assert snapshot is not None
    assert snapshot.observations == 3
    assert "a new map begins" in scene.log()


def test_a_robot_that_was_restarted_is_found_in_its_map(scene: Scene) -> None:
    for k in range(40):
        scene.send(observation(k, Pose2(0.04 * k, 0.0, 0.02 * k)))
    assert scene.station.view().snapshot is not None
    scene.send(*restarted())
    assert "it has to be found in the map" in scene.log()
    for k in range(3, 23):
        scene.send(dataclasses.replace(observation(k, Pose2()), boot_id=7))
    snapshot = scene.station.view().snapshot
    assert snapshot is not None
    assert snapshot.tracking is Tracking.LOCATED
    assert snapshot.map_from_robot.distance_m(Pose2()) < 0.03


def test_one_stray_observation_of_another_start_changes_nothing(scene: Scene) -> None:
    with_map(scene)
    scene.send(*restarted(scans=1))
    scene.send(observation(12, Pose2(0.48, 0.0, 0.0)))
    snapshot = scene.station.view().snapshot
    assert snapshot is not None
    assert snapshot.observations == 13
    assert "another robot" not in scene.log()


def test_a_map_that_cannot_be_drawn_is_told_once_and_mapping_goes_on(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_map(scene)
    before = scene.station.view().snapshot

    def fail(self: MappingPipeline) -> MapSnapshot:
        raise MappingError("the map would be too large")

    with monkeypatch.context() as patch:
        patch.setattr(MappingPipeline, "snapshot", fail)
        for k in range(12, 15):
            scene.send(observation(k, Pose2(0.04 * k, 0.0, 0.0)))
        assert scene.station.view().snapshot is before
    scene.send(observation(15, Pose2(0.6, 0.0, 0.0)))
    after = scene.station.view().snapshot
    assert after is not None
    assert after.observations == 16
    assert scene.log().count("the map would be too large") == 1


def test_one_stamp_from_the_future_does_not_wipe_the_map(scene: Scene) -> None:
    with_map(scene)
    scene.send(dataclasses.replace(observation(12, Pose2(0.48, 0.0, 0.0)), stamp_s=1e9))
    scene.send(observation(13, Pose2(0.52, 0.0, 0.0)))
    snapshot = scene.station.view().snapshot
    assert snapshot is not None
    assert snapshot.observations == 14


def test_an_observation_from_the_moon_is_refused_and_the_map_stays(scene: Scene) -> None:
    with_map(scene)
    scene.send(dataclasses.replace(observation(20, Pose2()), odom_from_robot=Pose2(4e8, 0.0, 0.0)))
    snapshot = scene.station.view().snapshot
    assert snapshot is not None
    assert snapshot.observations == 12
    assert "the last map stays" in scene.log()


def test_every_change_of_the_mission_is_logged_once(scene: Scene) -> None:
    for stamp in (1.0, 1.2):
        scene.send(
            samples.telemetry(
                state=MissionState.HALTED, stop_reason=StopReason.LOW_BATTERY, stamp_s=stamp, faults=("scanner: lost",)
            )
        )
    assert scene.log().count("mission: halted, stopped: low battery") == 1
    assert scene.log().count("robot: scanner: lost") == 1


def test_everything_received_is_recorded(scene: Scene, tmp_path: Path) -> None:
    with_map(scene)
    scene.station.close()
    messages = [Decoder().decode(r.datagram) for r in MissionReader(tmp_path / "m.mcap")]
    assert sum(isinstance(m, Observation) for m in messages) == 12
    assert len(messages) == 14


def test_disconnecting_ends_the_recording(scene: Scene, tmp_path: Path) -> None:
    with_map(scene)
    scene.station.disconnect()
    scene.run(0.1)
    assert scene.station.view().recording == ""
    reader = MissionReader(tmp_path / "m.mcap")
    assert len(list(reader)) == 14
    assert reader.truncated is None


def test_looking_twice_at_one_map_counts_as_one_update(scene: Scene) -> None:
    with_map(scene)
    for _ in range(5):
        scene.station.view()
    assert scene.station.figures.updates_seen == 1


def test_a_robot_of_another_size_is_told(scene: Scene) -> None:
    assert "another size" not in scene.log()
    scene.send(dataclasses.replace(scene.hello, min_turning_radius_m=0.8))
    assert "r has another size than [car] in station.toml" in scene.log()


def drive_through(scene: Scene, first: int, scans: int, odom_from_map: Pose2) -> None:
    """The robot goes on where `with_map` left it, or elsewhere; its odometry has an origin of its own."""
    for k in range(scans):
        pose = Pose2(0.02 * k, 0.02 * k, 0.02 * k)
        there = observation(first + k, pose)
        scene.send(dataclasses.replace(there, odom_from_robot=odom_from_map @ pose))


@pytest.mark.parametrize("localise", [False, True])
def test_a_saved_map_is_opened_and_the_robot_found_in_it(scene: Scene, tmp_path: Path, localise: bool) -> None:
    path = tmp_path / "room.labmap"
    with_map(scene).station.save_map(path)
    scene.run(0.1)
    assert path.is_file()
    scene.station.open_map(path, localise=localise)
    scene.run(0.1)
    opened = scene.station.view().snapshot
    assert opened is not None
    assert opened.tracking is Tracking.SEARCHING
    assert opened.fixed == localise

    drive_through(scene, 100, 25, Pose2(5.0, 5.0, 1.0))

    found = scene.station.view().snapshot
    assert found is not None
    assert found.located
    assert found.map_from_robot.distance_m(Pose2(0.48, 0.48, 0.48)) < 0.03
    assert (len(found.trajectory) > len(opened.trajectory)) != localise
    assert "map saved" in scene.log()
    assert "map opened to localise in" in scene.log() if localise else "map opened to go on with" in scene.log()
    assert "the robot's place is not known" in scene.log()
    assert "the robot's place in the map is known" in scene.log()


def test_a_goal_is_refused_while_the_robot_is_lost(scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "room.labmap"
    with_map(scene).station.save_map(path)
    scene.station.open_map(path, localise=False)
    scene.run(0.3)
    scene.commands()
    scene.station.go_to(1.0, 0.5)
    scene.run(0.3)
    assert scene.station.view().goal_m is None
    assert not any(isinstance(command.command, GoTo) for command in scene.commands())
    assert "possible once the robot's place in the map is known" in scene.log()


def test_a_robot_that_gets_lost_on_its_way_stands_still(scene: Scene) -> None:
    with_map(scene).station.go_to(1.0, 0.5)
    scene.run(0.3)
    assert scene.station.view().goal_m is not None
    scene.commands()
    for k in range(12):  # carried to where nothing is as it was
        there = observation(50 + k, Pose2(2.6, 1.7, 2.0))
        ranges = np.where(np.isfinite(there.ranges_m), 0.5 * there.ranges_m + 0.1, 1.3).astype(np.float32)
        scene.send(dataclasses.replace(there, odom_from_robot=Pose2(0.44, 0.0, 0.0), ranges_m=ranges))
    scene.send(samples.telemetry(state=MissionState.COMMAND, stamp_s=7.0, faults=()))
    scene.run(0.3)
    assert scene.station.view().goal_m is None
    assert any(command.command == Drive(0.0, 0.0) for command in scene.commands())
    assert "goal given up: the robot's place in the map is no longer known" in scene.log()


def test_files_that_cannot_be_used_are_told_and_the_map_stays(scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "photo.labmap"
    path.write_bytes(bytes(500))
    before = with_map(scene).station.view().snapshot
    scene.station.open_map(path, localise=False)
    scene.station.save_map(path / "below.labmap")
    scene.run(0.1)
    assert f"{path}: is not a saved map" in scene.log()
    assert "cannot be written" in scene.log()
    assert scene.station.view().snapshot is before


def test_mapping_goes_on_while_a_map_is_written_and_read(scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "room.labmap"
    with_map(scene)
    scene.station.save_map(path)
    for k in range(12, 15):  # the task that writes is not called meanwhile
        scene.station.on_report(observation(k, Pose2(0.04 * k, 0.0, 0.0)))
        scene.station.step_mapping()
    snapshot = scene.station.view().snapshot
    assert snapshot is not None
    assert snapshot.observations == 15
    assert not path.exists()
    scene.run(0.1)
    assert path.exists()

    scene.station.open_map(path, localise=False)
    scene.station.step_mapping()
    scene.station.on_report(observation(15, Pose2(0.6, 0.0, 0.0)))
    scene.station.step_mapping()
    snapshot = scene.station.view().snapshot
    assert snapshot is not None
    assert snapshot.located
    assert snapshot.observations == 16
    scene.run(0.1)
    assert "map opened to go on with" in scene.log()


def test_a_map_is_saved_before_another_one_is_opened_and_at_the_end(scene: Scene, tmp_path: Path) -> None:
    first, second, third = (tmp_path / name for name in ("1.labmap", "2.labmap", "3.labmap"))
    with_map(scene).station.save_map(first)
    scene.station.open_map(first, localise=True)
    scene.station.save_map(second)
    scene.run(0.5)
    assert len(read_map(second).keyframes) == len(read_map(first).keyframes)
    told = scene.log()
    assert told.index("1.labmap") < told.index("map opened") < told.index("2.labmap")
    scene.station.open_map(tmp_path / "none.labmap", localise=True)
    scene.station.save_map(third)
    scene.station.close()
    assert third.exists()


def test_there_is_nothing_to_save_before_the_first_scan(scene: Scene, tmp_path: Path) -> None:
    scene.station.save_map(tmp_path / "room.labmap")
    scene.run(0.1)
    assert "there is no map to save yet" in scene.log()
    assert list(tmp_path.glob("*.labmap*")) == []


def test_a_robot_that_starts_again_has_to_be_found_in_the_map_that_was_given(scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "room.labmap"
    with_map(scene).station.save_map(path)
    scene.station.open_map(path, localise=False)
    drive_through(scene, 100, 25, Pose2(5.0, 5.0, 1.0))
    before = scene.station.view().snapshot
    assert before is not None
    assert before.located
    scene.send(*restarted())
    after = scene.station.view().snapshot
    assert after is not None
    assert after.tracking is Tracking.SEARCHING
    assert len(after.trajectory) == len(before.trajectory)
    assert "it has to be found in the map" in scene.log()


def test_a_robot_that_turns_on_the_spot_is_planned_for_as_it_says(scene: Scene) -> None:
    around = ((-0.17, -0.17), (0.17, -0.17), (0.17, 0.17), (-0.17, 0.17))
    scene.send(dataclasses.replace(scene.hello, footprint_m=around, min_turning_radius_m=0.0))
    assert "another size" not in scene.log()
    assert scene.station._goals._planner is not scene.station._planner
    scene.send(scene.hello)
    assert scene.station._goals._planner is scene.station._planner
