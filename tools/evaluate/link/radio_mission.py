"""`evaluate radio-mission`: the demo's mission over LoRa alone, by the wall's time, through the real firmware.

The robot is the simulator as a process of its own, its two modules on serial ports. The station's two hang on the
emulated Mega, which runs the hex; in a third process are the air and the modules. Meanwhile the USB plug is pulled,
the Mega is reset and a module loses its power: the operator does nothing about it.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import secrets
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared.command_line import EXIT_FAILED, EXIT_OK, Refused, seed
from shared.messages import MissionState, Observation
from shared.protocol.codec import Decoder
from shared.recording import MissionReader
from shared.runtime.clock import MonotonicClock
from shared.runtime.runner import ThreadRunner
from station_gui.build import build_station
from station_gui.comms.state import LinkState
from station_gui.config import StationConfig
from station_gui.config import load_config as load_station
from station_gui.export.map_picture import draw_map
from station_gui.model.station import Station
from tools.demo_robot import configure, program
from tools.director import Director, Outcome
from tools.evaluate.link.timeline_picture import draw_timeline
from tools.evaluate.summary import summarise
from tools.simulator.devices.mega import MegaError
from tools.simulator.devices.mega_build import MegaUnavailableError
from tools.simulator.radio.live import LiveRadiosProcess
from tools.simulator.radio.pair_rig import link_settings
from tools.simulator.scenario import Scenario, find_scenario
from tools.simulator.truth import TRUTH_FILE, read_truth

_LONGEST_S = 900.0
_BANDWIDTHS_HZ = (250_000, 500_000)  # a slower one cannot bring a word often enough for a car that drives
_STEP_S = 0.05
_RECORDING = "mission.mcap"


@dataclass(frozen=True, slots=True)
class _Incident:
    """At a time after the observation began; `ends` undoes it."""

    name: str
    at_s: float
    lasts_s: float
    begins: tuple[str, *tuple[int, ...]]
    ends: tuple[str, *tuple[int, ...]] | None = None


INCIDENTS = (
    _Incident("Mega reset", 8.0, 0.0, ("reset_mega",)),
    _Incident("USB plug pulled", 22.0, 2.0, ("pull_plug",), ("plug_in",)),
    _Incident("radio A without power", 38.0, 5.0, ("switch_off", 0), ("switch_on", 0)),
)


@dataclass(frozen=True, slots=True)
class Recovery:
    """`silent_s`: the longest time without an observation from the incident on, until the next incident."""

    name: str
    at_s: float  # in the recording
    lasts_s: float
    silent_s: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenario", default="lab", help="a scenario's name or TOML file (default: lab)")
    parser.add_argument("--seed", type=seed, default=1, help="of all noise (default: 1)")
    parser.add_argument(
        "--bandwidth",
        type=int,
        choices=_BANDWIDTHS_HZ,
        default=250_000,
        help="of the modules, Hz (default: 250000, the paper's rate)",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("out/radio"), help="default: out/radio")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    """Exit code 1 when the mission did not finish, an observation is missing or came twice."""
    logging.getLogger("station").setLevel(logging.INFO)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / _RECORDING).unlink(missing_ok=True)
    scenario = find_scenario(args.scenario)
    try:
        with LiveRadiosProcess(link_settings(args.bandwidth), args.seed) as radios:
            return _report(scenario, _Mission(scenario, radios, args).play(), args)
    except (MegaError, MegaUnavailableError) as error:
        raise Refused(str(error)) from error


@dataclass(slots=True, eq=False)
class _Played:
    station: Station
    outcome: Outcome
    connected_s: float  # then the recording begins
    done: list[tuple[_Incident, float]]


class _Mission:
    """The station's side, the director and the incidents."""

    def __init__(self, scenario: Scenario, radios: LiveRadiosProcess, args: argparse.Namespace) -> None:
        self._scenario = scenario
        self._radios = radios
        self._args = args
        self._clock = MonotonicClock()

    def play(self) -> _Played:
        args = self._args
        with tempfile.TemporaryDirectory(prefix="radio-mission-") as name:
            config = configure(Path(name), "radio", list(self._radios.robot_ports), args.bandwidth)
            arguments = ["--scenario", args.scenario, "--seed", str(args.seed), "--config", str(config)]
            arguments += ["--out", str(args.out / "truth"), "--until-eof", "--port-file"]
            with program("tools.simulator", arguments, args.out / "ready.txt", args.out):
                return self._operate(_station_config(config.with_name("pairing.pem"), args.bandwidth))

    def _operate(self, config: StationConfig) -> _Played:
        station = build_station(
            config, self._clock, secrets.randbits(31), name_recording=lambda: self._args.out / _RECORDING
        )
        usb = self._radios.station_port
        hands = _Hands(station, (f"{usb}:A", f"{usb}:B"))
        director = Director(hands, self._scenario.goals_in_start_frame_m(), lambda text: print(text, flush=True))
        runner = ThreadRunner(station.tasks(), self._clock, station.on_fault)
        runner.start()
        try:
            connected_s, done = self._watch(director, station)
        finally:
            runner.stop()
            station.close()
        outcome = director.outcome or Outcome(f"not finished after {_LONGEST_S:g} s", 0.0, self._clock.now_s())
        return _Played(station, outcome, connected_s, done)

    def _watch(self, director: Director, station: Station) -> tuple[float, list[tuple[_Incident, float]]]:
        waiting, ending = list(INCIDENTS), list[tuple[float, _Incident]]()
        done: list[tuple[_Incident, float]] = []
        connected_s = began_s = math.inf
        while director.outcome is None and self._clock.now_s() < _LONGEST_S:
            view, now_s = station.view(), self._clock.now_s()
            director.step(view)
            if view.link_state is LinkState.CONNECTED:
                connected_s = min(connected_s, now_s)
            if view.telemetry is not None and view.telemetry.state is MissionState.OBSERVE:
                began_s = min(began_s, now_s)
            if ending and now_s >= ending[0][0]:
                self._do(ending.pop(0)[1].ends)
            if waiting and now_s >= began_s + waiting[0].at_s:
                incident = waiting.pop(0)
                print(f"incident: {incident.name}", flush=True)
                done.append((incident, now_s))
                self._do(incident.begins)
                ending.append((now_s + incident.lasts_s, incident))
            time.sleep(_STEP_S)
        return connected_s, done

    def _do(self, action: tuple[str, *tuple[int, ...]] | None) -> None:
        if action is not None:
            self._radios.do(*action)


class _Hands:
    """Orders to the station's model; it connects once, whatever becomes of the link."""

    def __init__(self, station: Station, ports: tuple[str, ...]) -> None:
        self._station = station
        self._ports = ports

    def connect(self) -> None:
        self._station.connect("", 0, self._ports)

    def start(self) -> None:
        self._station.start()

    def go_to(self, x_m: float, y_m: float) -> None:
        self._station.go_to(x_m, y_m)

    def stop(self) -> None:
        self._station.stop()


def _station_config(pairing: Path, bandwidth_hz: int) -> StationConfig:
    config = load_station(None)
    return replace(config, pairing=str(pairing), radio=replace(config.radio, bandwidth_hz=bandwidth_hz))


def _report(scenario: Scenario, played: _Played, args: argparse.Namespace) -> int:
    snapshot, station = played.station.finish_mapping(), played.station
    truth = read_truth(args.out / "truth") if (args.out / "truth" / TRUTH_FILE).exists() else None
    goal = scenario.goals[-1].position_m if scenario.goals else None
    came_s, sequences = _recorded(args.out / _RECORDING)
    recoveries = _recoveries(played, came_s)
    steps = np.diff(sequences)
    figures = summarise(truth, snapshot, station.figures, played.outcome, goal).as_json() | {
        "observations_hz": round(len(steps) / float(np.ptp(came_s)), 2) if len(steps) else 0.0,
        "missing": int(np.sum(steps[steps > 1] - 1)),
        "doubled": int(np.sum(steps < 1)),
    }
    for key, value in figures.items():
        print(f"{key:24} {value}")
    for recovery in recoveries:
        print(f"{recovery.name:24} at {recovery.at_s:.1f} s, silent for {recovery.silent_s:.2f} s")
    if snapshot is not None:
        draw_map(snapshot.grid, snapshot.trajectory, snapshot.closures, args.out / "map2d.png", title="LoRa alone")
    spans = [(r.name, r.at_s, r.at_s + r.lasts_s) for r in recoveries]
    draw_timeline(came_s, spans, args.out / "timeline.png", title="Observations at the station, LoRa alone")
    if args.json:
        print(json.dumps(figures | {"recoveries": [asdict(r) for r in recoveries]}))
    clean = figures["finished"] and figures["missing"] == figures["doubled"] == 0
    return EXIT_OK if clean and len(recoveries) == len(INCIDENTS) else EXIT_FAILED


def _recorded(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """When observations came, s since the recording began, and their numbers."""
    decoder = Decoder()
    records = ((record.time_s, decoder.decode(record.datagram)) for record in MissionReader(path))
    came = [(time_s, message.sequence) for time_s, message in records if isinstance(message, Observation)]
    return np.array([time_s for time_s, _ in came]), np.array([number for _, number in came], np.int64)


def _recoveries(played: _Played, came_s: NDArray[np.float64]) -> list[Recovery]:
    """The recording begins when the station is connected."""
    found: list[Recovery] = []
    begins_s = [at_s - played.connected_s for _, at_s in played.done]
    for (incident, _), from_s, to_s in zip(played.done, begins_s, [*begins_s[1:], math.inf], strict=True):
        around = (came_s[1:] > from_s) & (came_s[1:] <= to_s)  # one that is still going on then is the next one's
        silent_s = float(np.diff(came_s)[around].max()) if around.any() else math.inf
        found.append(Recovery(incident.name, from_s, incident.lasts_s, silent_s))
    return found
