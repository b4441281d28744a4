"""The station without its window: session, mapping and planning behind the `Operator` protocol. No Qt."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path

from shared.geometry.ackermann import CarGeometry
from shared.link.base import Link, LinkPath
from shared.link.serial_port import list_serial_ports
from shared.messages import (
    Command,
    Drive,
    EmergencyStop,
    Hello,
    Observation,
    Pause,
    Pulse,
    Report,
    Resume,
    ReturnToStart,
    Start,
    Stop,
    Telemetry,
    Vitals,
)
from shared.protocol.observations import Received
from shared.recording import Recorder, RecordingError
from shared.runtime.clock import Clock, wall_clock_ns
from shared.runtime.runner import OnFault, Row, Task
from station_gui.comms.session import Session, SessionConfig
from station_gui.mapping.pipeline import MappingPipeline
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.snapshot import MapSnapshot, Tracking
from station_gui.model.figures import MissionFigures, RateMeter
from station_gui.model.goal import GoalKeeper
from station_gui.model.journal import Journal
from station_gui.model.map_files import MapFiles
from station_gui.model.telemetry_keeper import TelemetryKeeper
from station_gui.model.view import LinkFigures, LogEntry, OperatorView, Severity, Target
from station_gui.planning.on_the_spot import body_on_the_spot
from station_gui.planning.path_planner import PathPlanner

_QUEUE = 64  # observations that may wait for the mapping; the oldest give way
_OBSERVATIONS_PER_STEP = 8
_SAME_SIZE_M = 0.005
_LOOKING_S = 1.0  # without a look at the view for so long the operator is not there

MakeLink = Callable[[Target], Link]
MakePipeline = Callable[[], MappingPipeline]
NameRecording = Callable[[], Path | None]

SESSION_ROW = Row("session", 50.0, 0.5, 0.02, OnFault.RETRY)
MAPPING_ROW = Row("mapping", 50.0, 1.0, 0.10, OnFault.DEGRADE)
PLANNING_ROW = Row("planning", 10.0, 1.0, 0.50, OnFault.DEGRADE)
FILES_ROW = Row("map files", 50.0, 1.0, 5.0, OnFault.RETRY)


class Station:
    """Implements `Operator`. Its tasks run in threads, or in lock-step with a robot."""

    def __init__(
        self,
        session: SessionConfig,
        clock: Clock,
        make_link: MakeLink,
        make_pipeline: MakePipeline,
        car: CarGeometry,
        planner: PathPlanner,
        name_recording: NameRecording,
        first_command: int,
    ) -> None:
        self._clock = clock
        self._car = car
        self._planner = planner
        self._make_link = make_link
        self._name_recording = name_recording
        self._journal = Journal(clock)
        self._looked_s = -math.inf
        self._session = Session(session, clock, self, first_command, self._operator_is_there)
        self._goals = GoalKeeper(planner, self._send, self._journal)
        self._pipeline = make_pipeline()
        self._map_files = MapFiles(self._journal, self._pipeline)
        self._queue: deque[Observation] = deque(maxlen=_QUEUE)
        self._queue_lock = threading.Lock()
        self._recorder: Recorder | None = None
        self._recorder_lock = threading.Lock()
        self._target = Target()
        self._hello: Hello | None = None
        self._telemetry = TelemetryKeeper(self._journal)
        self._vitals: Vitals | None = None
        self._observation: Observation | None = None
        self._snapshot: MapSnapshot | None = None
        self._mapping_fault = False
        self._drawing_fault = False
        self._seen_revision = 0
        self._received = RateMeter()
        self._observed = RateMeter()
        self._observation_bytes = RateMeter()
        self._refreshed = RateMeter()
        self.figures = MissionFigures()

    # --- what runs ---

    def tasks(self) -> list[Task]:
        return [
            Task(SESSION_ROW, self._session.step),
            Task(MAPPING_ROW, self.step_mapping),
            Task(PLANNING_ROW, self._step_planning),
            Task(FILES_ROW, self._map_files.work),
        ]

    def close(self) -> None:
        """Let go of the link, end the recording, write what is to be saved; call it after the tasks have ended."""
        self._session.close()
        self._map_files.finish()
        self._end_recording()

    def on_fault(self, row: Row, error: Exception) -> None:
        self._journal.add(Severity.ERROR, f"{row.name}: {error}")

    def step_mapping(self) -> None:
        """Map what is waiting, then publish one snapshot."""
        done = 0
        if self._map_files.step():
            self._goals.forget()
            done += 1
        while done < _OBSERVATIONS_PER_STEP and (observation := self._next_observation()) is not None:
            self._map(observation)
            done += 1
        if done:
            self._publish()

    def finish_mapping(self) -> MapSnapshot | None:
        """Map everything that came and put the last touch to it; call it after the tasks have ended."""
        while (observation := self._next_observation()) is not None:
            self._map(observation)
        if self._pipeline.observations:
            self._pipeline.finish()
            self._publish()
        return self._snapshot

    def _publish(self) -> None:
        """The map as it is now; where it cannot be drawn the last picture of it stays."""
        try:
            snapshot = self._pipeline.snapshot()
        except MappingError as error:
            if not self._drawing_fault:  # told when it begins
                self._journal.add(Severity.ERROR, f"mapping: {error}; the last map stays")
            self._drawing_fault = True
            return
        self._drawing_fault = False
        self._snapshot = snapshot
        self._map_files.tell(snapshot.tracking)

    def _step_planning(self) -> None:
        slow = self._session.path is LinkPath.RADIO
        self._goals.step(self._snapshot, self._telemetry.telemetry, slow)

    # --- what the window asks for ---

    def view(self) -> OperatorView:
        now_s = self._looked_s = self._clock.now_s()
        snapshot = self._snapshot
        if snapshot is not None and snapshot.revision != self._seen_revision:
            self._seen_revision = snapshot.revision
            self._refreshed.add(now_s)
            self.figures.saw_update(now_s)
        recorder = self._recorder
        return OperatorView(
            time_s=now_s,
            link_state=self._session.state,
            target=self._target,
            link=self._link_figures(now_s),
            robot=self._hello,
            telemetry=self._telemetry.telemetry,
            telemetry_age_s=self._telemetry.age_s(now_s),
            observation=self._observation,
            snapshot=snapshot,
            goal_m=self._goals.goal_m,
            path_m=self._goals.path_m,
            recording=str(recorder.path) if recorder is not None else "",
            log_length=self._journal.length,
            going=self._goals.figures,
            vitals=self._vitals,
        )

    def log_since(self, index: int) -> list[LogEntry]:
        return self._journal.since(index)

    def connect(self, host: str, port: int, radio_ports: tuple[str, ...] = ()) -> None:
        self._target = target = Target(host, port, radio_ports)
        self._begin_recording()
        self._journal.add(Severity.INFO, f"connecting to {target}")
        self._session.connect(lambda: self._make_link(target))

    def serial_ports(self) -> list[str]:
        return [port.path for port in list_serial_ports()]

    def disconnect(self) -> None:
        self._session.disconnect()
        self._end_recording()

    def start(self) -> None:
        self._send(Start())

    def pause(self) -> None:
        self._send(Pause())

    def resume(self) -> None:
        self._send(Resume())

    def return_to_start(self) -> None:
        self._goals.forget()
        self._send(ReturnToStart())

    def stop(self) -> None:
        self._goals.forget()
        self._send(Stop())

    def emergency_stop(self) -> None:
        self._goals.forget()
        self._send(EmergencyStop())

    def go_to(self, x_m: float, y_m: float) -> None:
        if not (math.isfinite(x_m) and math.isfinite(y_m)):
            self._journal.add(Severity.WARNING, "a goal needs a place on the map")
            return
        self._goals.ask(x_m, y_m)

    def save_map(self, path: Path) -> None:
        self._map_files.save(path)

    def export_map(self, folder: Path) -> None:
        self._map_files.export(self._snapshot, folder)

    def open_map(self, path: Path, *, localise: bool) -> None:
        self._map_files.open(path, fixed=localise)

    def drive(self, speed_mps: float, steering_rad: float) -> None:
        if not (math.isfinite(speed_mps) and math.isfinite(steering_rad)):
            self._journal.add(Severity.WARNING, "driving needs a speed and a steering angle")
            return
        self._goals.forget()
        self._send(Drive(speed_mps, steering_rad))

    def _send(self, command: Command) -> bool:
        name = type(command).__name__
        try:
            sent = self._session.send(command)
        except ValueError as error:
            self._journal.add(Severity.ERROR, f"{name} cannot be sent: {error}")
            return False
        if not sent:
            self._journal.add(Severity.WARNING, f"{name} was not sent: there is no connection")
        return sent

    def _operator_is_there(self) -> bool:
        """Whether somebody has looked at the view lately; a window that hangs does not hold the dead man's handle."""
        return self._clock.now_s() - self._looked_s <= _LOOKING_S

    # --- what the session hears ---

    def on_datagram(self, received: Received, size: int) -> None:
        now_s = self._clock.now_s()
        self._received.add(now_s, size)
        if isinstance(received.message, Observation):
            self.figures.observation_bytes += size
            self._observation_bytes.add(now_s, size)
        with self._recorder_lock:
            recorder = self._recorder
            if recorder is None:
                return
            recorder.write(received.datagram, now_s)
            if recorder.error is not None:
                self._journal.add(Severity.ERROR, recorder.error)
                self._recorder = None

    def on_report(self, report: Report) -> None:
        match report:
            case Observation():
                self._take_observation(report)
            case Telemetry() | Pulse():
                self._telemetry.take(report, self._clock.now_s())
            case Vitals():
                self._vitals = report
            case Hello():
                self._take_hello(report)
            case _:
                pass

    def on_event(self, severity: Severity, text: str) -> None:
        self._journal.add(severity, text)

    def _take_observation(self, observation: Observation) -> None:
        self.figures.observations += 1
        now_s = self._clock.now_s()
        self._observed.add(now_s)
        if self._session.path is LinkPath.RADIO:
            self._telemetry.take_motion(observation, now_s)
        with self._queue_lock:
            full = len(self._queue) == _QUEUE
            self._queue.append(observation)
        if full and self.figures.observations_dropped == 0:
            self._journal.add(Severity.WARNING, "mapping is too slow for what comes: observations are dropped")
        self.figures.observations_dropped += full

    def _take_hello(self, hello: Hello) -> None:
        body = body_on_the_spot(hello)
        self._goals.use_planner(self._planner if body is None else self._planner.for_body(body))
        if hello != self._hello and body is None and not self._is_planned_for(hello):
            self._journal.add(
                Severity.WARNING,
                f"{hello.robot_name} has another size than [car] in station.toml: paths may not fit it",
            )
        self._hello = hello

    def _is_planned_for(self, hello: Hello) -> bool:
        ours = (*self._car.footprint_m(), (self._car.min_turning_radius_m, 0.0))
        theirs = (*hello.footprint_m, (hello.min_turning_radius_m, 0.0))
        return len(ours) == len(theirs) and all(
            math.dist(a, b) <= _SAME_SIZE_M for a, b in zip(ours, theirs, strict=True)
        )

    # --- mapping and recording ---

    def _next_observation(self) -> Observation | None:
        with self._queue_lock:
            return self._queue.popleft() if self._queue else None

    def _map(self, observation: Observation) -> None:
        begun = self._pipeline.maps_begun
        try:
            if not self._pipeline.add(observation):
                return
        except MappingError as error:
            if not self._mapping_fault:  # told when it begins
                self._journal.add(Severity.ERROR, f"mapping: {error}; the last map stays")
            self._mapping_fault = True
            return
        self._mapping_fault = False
        self._observation = observation
        if self._pipeline.maps_begun != begun:
            self._journal.add(Severity.WARNING, f"another robot, or the same one started again: {self._beginning()}")
            self._goals.forget()

    def _beginning(self) -> str:
        located = self._pipeline.tracking is Tracking.LOCATED
        return "a new map begins" if located else "it has to be found in the map"

    def _link_figures(self, now_s: float) -> LinkFigures:
        return LinkFigures(
            observations_hz=self._observed.per_second(now_s),
            refresh_hz=self._refreshed.per_second(now_s),
            bytes_per_observation=self._observation_bytes.mean(now_s),
            received_bps=8 * self._received.per_second(now_s),
            round_trip_s=self._session.round_trip_s,
            path=self._session.path,
            health=self._session.link_health,
            problem=self._session.problem,
        )

    def _begin_recording(self) -> None:
        self._end_recording()
        path = self._name_recording()
        if path is None:
            return
        try:
            recorder = Recorder(
                path, {"address": str(self._target)}, wall_clock_ns() - round(self._clock.now_s() * 1e9)
            )
        except RecordingError as error:
            self._journal.add(Severity.ERROR, f"{error}; the mission is not recorded")
            return
        with self._recorder_lock:
            self._recorder = recorder

    def _end_recording(self) -> None:
        with self._recorder_lock:
            recorder, self._recorder = self._recorder, None
            if recorder is not None:
                recorder.close()
