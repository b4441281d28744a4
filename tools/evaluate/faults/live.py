"""Faults that only a real process can have: it is killed, it hangs, its disk is full, its clock jumps.

The app runs by the wall's time with its real drive and the guardian, on emulated outputs. What is on these wires is
written down; afterwards the simulated car drives by it, which tells how long it moved.
"""

from __future__ import annotations

import json
import logging
import math
import os
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robot_app.drivers.config import DriveConfig
from shared.command_line import Refused
from shared.messages import MissionState
from shared.runtime.clock import MonotonicClock
from shared.runtime.runner import ThreadRunner
from station_gui.build import build_station
from station_gui.config import load_config as load_station
from station_gui.model.station import Station
from station_gui.views.words import mission_sentence
from tools.demo_robot import program
from tools.evaluate.faults.cases import LIMIT_S
from tools.evaluate.faults.wires import Reading, Ride, Wires, ride, watch

_DRIVES_S, _LONGEST_S = 1.5, 90.0
_WATCHED_S = 3.0
_BEFORE_S = 0.9  # so long the car needs to be as fast as it was
_REST_S, _LOOK_EVERY_S = 0.0005, 0.1
_STALE_AFTER_S = 1.5
_DRIVES_DUTY = 0.1
_FAST_DUTY, _FAST_FOR_S = 0.5, 0.4  # 0.28 m/s


@dataclass(frozen=True, slots=True)
class LiveOutcome:
    """`driven_s`, `moved_s`: since the fault the wires told the motor to push along the way, and the simulated car
    moved that was set by what was on them; NaN where it went on.
    """

    name: str
    text: str
    speed_mps: float
    driven_s: float
    moved_s: float
    seen: str
    after: str
    failure: str


@dataclass(frozen=True, slots=True)
class _LiveCase:
    text: str
    stops: bool
    strike: Callable[[int, Path], None]
    full_disk: bool = False  # for the station's recording


def _signalled(number: signal.Signals) -> Callable[[int, Path], None]:
    return lambda robot, folder: os.kill(robot, number)


def _fill_disk(robot: int, folder: Path) -> None:
    (folder / "mission.new").symlink_to("/dev/full")


LIVE_CASES = {
    "killed": _LiveCase("app killed with SIGKILL", True, _signalled(signal.SIGKILL)),
    "stopped": _LiveCase("app hangs as a whole (SIGSTOP)", True, _signalled(signal.SIGSTOP)),
    "thread-hung": _LiveCase("thread of the control task hangs", True, _signalled(signal.SIGUSR1)),
    "clock-step": _LiveCase("time of day jumps an hour ahead", False, _signalled(signal.SIGUSR2)),
    "clock-back": _LiveCase("time of day jumps an hour back", False, _signalled(signal.SIGRTMIN)),
    "disk-full": _LiveCase("disk full, the robot's and the station's", False, _fill_disk, full_disk=True),
}


def try_live(name: str) -> LiveOutcome:
    case = LIVE_CASES[name]
    with tempfile.TemporaryDirectory() as place:
        out, folder = Path(place), Path(place) / "robot"
        folder.mkdir()
        recording = out / "mission.mcap"
        if case.full_disk:
            recording.symlink_to("/dev/full")
        with program("tools.evaluate.faults.live_robot", [str(folder)], out / "ready.json", out) as said:
            ready = json.loads(said)
            clock = MonotonicClock()
            station = build_station(
                load_station(None), clock, 1, name_recording=lambda: recording if case.full_disk else None
            )
            runner = ThreadRunner(station.tasks(), clock, station.on_fault)
            runner.start()
            try:
                station.connect("127.0.0.1", ready["port"])
                return _try(name, case, station, ready["robot"], folder)
            finally:
                runner.stop()
                station.close()
                _let_end(ready["robot"])


def _try(name: str, case: _LiveCase, station: Station, robot: int, folder: Path) -> LiveOutcome:
    wires = Wires(folder, DriveConfig())
    _get_going(station, wires)
    readings = _at_speed(wires, station)
    began_s = time.monotonic()
    case.strike(robot, folder)
    readings += watch(wires, began_s + _WATCHED_S, time.monotonic, _rest(station))
    _look(station, _WATCHED_S)
    view, now = station.view(), wires.read()
    driven = ride(readings, began_s) if case.stops else Ride(math.nan, math.nan, math.nan)
    failure = ""
    if case.stops and not (0 < driven.moved_s <= LIMIT_S and now.duty == 0):
        failure = f"it did not stand within {LIMIT_S} s"
    elif not case.stops and (view.telemetry is None or view.telemetry.state is MissionState.HALTED):
        failure = "the mission ended"
    return LiveOutcome(
        name,
        case.text,
        driven.speed_mps,
        driven.driven_s,
        driven.moved_s,
        mission_sentence(view, _STALE_AFTER_S),
        "the motor gets nothing" if now.duty == 0 else "goes on",
        failure,
    )


def _get_going(station: Station, wires: Wires) -> None:
    began_s = going_s = time.monotonic()
    started_s = -math.inf
    while time.monotonic() - going_s < _DRIVES_S:
        now_s, view = time.monotonic(), station.view()
        if now_s - began_s > _LONGEST_S:
            raise Refused("the mission does not get going")
        standing = view.telemetry is None or view.telemetry.state in {MissionState.IDLE, MissionState.HALTED}
        if standing or wires.read().duty < _DRIVES_DUTY:
            going_s = now_s
        if standing and view.telemetry is not None and now_s - started_s > 2.0:
            started_s = now_s
            station.start()
        time.sleep(0.05)


def _at_speed(wires: Wires, station: Station) -> list[Reading]:
    """What was on the wires until now, the car being as fast as it gets on most of its way."""
    until_s = time.monotonic() + _LONGEST_S
    while time.monotonic() < until_s:
        now_s = time.monotonic() + _BEFORE_S
        readings = watch(wires, now_s, time.monotonic, _rest(station))
        before = [r for r in readings if r.time_s <= now_s - _FAST_FOR_S]
        if all(r.setting.duty > _FAST_DUTY for r in (*before[-1:], *readings[len(before) :])):
            return readings
    raise Refused("the mission does not get fast")


def _rest(station: Station) -> Callable[[], None]:
    """The hand looks at the view meanwhile, as a window does: the robot must not stop for want of an operator."""
    looked_s = -math.inf

    def rest() -> None:
        nonlocal looked_s
        if time.monotonic() - looked_s > _LOOK_EVERY_S:
            looked_s = time.monotonic()
            station.view()
        time.sleep(_REST_S)

    return rest


def _look(station: Station, seconds: float) -> None:
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        station.view()
        time.sleep(_LOOK_EVERY_S)


def _let_end(robot: int) -> None:
    """One that was stopped must go on to end."""
    try:
        os.kill(robot, signal.SIGCONT)
    except ProcessLookupError:
        logging.getLogger(__name__).debug("the robot has ended")
