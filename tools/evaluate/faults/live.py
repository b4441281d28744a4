"""Faults that only a real process can have: it is killed, it hangs, its disk is full, its clock jumps.

The app runs by the wall's time with its real drive, whose PWM is a folder that looks like the kernel's. What is looked
at is the motor's duty in it, which stays as it is when the process that has written it is gone.
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

from shared.command_line import Refused
from shared.messages import MissionState
from shared.runtime.clock import MonotonicClock
from shared.runtime.runner import ThreadRunner
from station_gui.build import build_station
from station_gui.config import load_config as load_station
from station_gui.model.station import Station
from station_gui.views.words import mission_sentence
from tools.demo_robot import program

_DRIVES_S, _LONGEST_S = 4.0, 60.0
_WATCHED_S = 3.0
_LOOK_S = 0.0005
_ZERO_FOR_S = 0.1
_STALE_AFTER_S = 1.5
_MOTOR = Path("pwmchip0/pwm1/duty_cycle")
_LIMIT_S = 0.3


@dataclass(frozen=True, slots=True)
class LiveOutcome:
    """`cut_s`: from the fault until the motor's duty was zero and stayed so; NaN where it did not."""

    name: str
    text: str
    cut_s: float
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
    "clock-step": _LiveCase("time of day jumps by an hour", False, _signalled(signal.SIGUSR2)),
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
    motor = folder / _MOTOR
    _get_going(station, motor)
    case.strike(robot, folder)
    cut_s = _time_to_zero_s(motor, station)
    _look(station, _WATCHED_S)
    view, duty = station.view(), _duty(motor)
    after = "the motor gets nothing" if duty == 0 else "goes on"
    failure = ""
    if case.stops and not cut_s < _LIMIT_S:
        failure = "the motor was not cut in time"
    elif not case.stops and (view.telemetry is None or view.telemetry.state is MissionState.HALTED):
        failure = "the mission ended"
    return LiveOutcome(name, case.text, cut_s, mission_sentence(view, _STALE_AFTER_S), after, failure)


def _get_going(station: Station, motor: Path) -> None:
    began_s = going_s = time.monotonic()
    started_s = -math.inf
    while time.monotonic() - going_s < _DRIVES_S:
        now_s, view = time.monotonic(), station.view()
        if now_s - began_s > _LONGEST_S:
            raise Refused("the mission does not get going")
        standing = view.telemetry is None or view.telemetry.state in {MissionState.IDLE, MissionState.HALTED}
        if standing or _duty(motor) == 0:
            going_s = now_s
        if standing and view.telemetry is not None and now_s - started_s > 2.0:
            started_s = now_s
            station.start()
        time.sleep(0.05)


def _time_to_zero_s(motor: Path, station: Station) -> float:
    """The hand looks at the view meanwhile, as a window does: the robot must not stop for want of an operator."""
    began_s, looked_s, zero_s = time.monotonic(), -math.inf, math.nan
    while (now_s := time.monotonic()) - began_s < _WATCHED_S:
        if _duty(motor) != 0:
            zero_s = math.nan
        elif math.isnan(zero_s):
            zero_s = now_s
        elif now_s - zero_s > _ZERO_FOR_S:
            return zero_s - began_s
        if now_s - looked_s > 0.1:
            looked_s = now_s
            station.view()
        time.sleep(_LOOK_S)
    return math.nan


def _look(station: Station, seconds: float) -> None:
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        station.view()
        time.sleep(0.1)


def _duty(motor: Path) -> int:
    return int(motor.read_text("ascii").split("\n")[0] or 0)


def _let_end(robot: int) -> None:
    """One that was stopped must go on to end."""
    try:
        os.kill(robot, signal.SIGCONT)
    except ProcessLookupError:
        logging.getLogger(__name__).debug("the robot has ended")
