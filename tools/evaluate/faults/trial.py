"""One fault in the middle of a mission in lock-step, and what came of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot_app.config import load_config as load_robot
from shared.messages import MissionState, StopReason
from station_gui.comms.state import LinkState
from station_gui.config import load_config as load_station
from station_gui.views.words import mission_sentence
from tools.evaluate.faults.cases import Case
from tools.simulator.lockstep import Lockstep
from tools.simulator.scenario import find_scenario
from tools.simulator.world import World

_CONNECTS_S, _DRIVES_S, _LONGEST_S = 3.0, 4.0, 30.0
_DRIVING_MPS = 0.25  # faster than most of the way
_STANDS_MPS = 0.01
_STEP_S = 0.01
_STALE_AFTER_S = 1.5


@dataclass(frozen=True, slots=True)
class Outcome:
    """`driven_s`, `moved_s`: from the fault until the motor was told to turn the way the car went, and until the car
    moved, for the last time before it stood; NaN where it never stood. `end_mps`: at the end of the watch.
    """

    name: str
    text: str
    speed_mps: float
    driven_s: float
    moved_s: float
    way_m: float
    reason: str
    seen: str  # by the operator, while it lasts
    after: str  # the mission's state at the end
    end_mps: float
    collisions: int
    failure: str  # of what was asked, or nothing


class _Motion:
    """Looks at the world after each step of 2 ms."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._began_s = self._standing_since_s = math.inf
        self._way_mps = 0.0
        self.driven_s = self.moved_s = 0.0
        self.has_stood = False
        world.add_observer(self)

    def begin(self) -> None:
        self._began_s, self._way_mps = self._world.time_s, self._world.speed_mps()

    def after_step(self) -> None:
        elapsed_s = self._world.time_s - self._began_s
        if elapsed_s < 0 or self.has_stood:
            return
        speed_mps = self._world.speed_mps()
        if abs(speed_mps) > _STANDS_MPS:
            self.moved_s, self._standing_since_s = elapsed_s, math.inf
            if self._world.motor_command_radps() * self._way_mps > 0:
                self.driven_s = elapsed_s
        else:
            self._standing_since_s = min(self._standing_since_s, elapsed_s)
            self.has_stood = elapsed_s - self._standing_since_s > 0.5


def try_case(case: Case, seed: int) -> Outcome:
    system = _driving(seed)
    try:
        return _watch(case, system)
    finally:
        system.close()


def _driving(seed: int) -> Lockstep:
    system = Lockstep(find_scenario("lab"), seed, load_robot(None), load_station(None))
    system.station.connect("loopback", 0)
    system.run(_CONNECTS_S)
    system.station.start()
    system.run(_DRIVES_S)
    while system.world.speed_mps() < _DRIVING_MPS:
        system.run(_STEP_S)
        if system.clock.now_s() > _LONGEST_S:
            raise RuntimeError("the mission does not get going")
    return system


def _watch(case: Case, system: Lockstep) -> Outcome:
    motion, speed_mps = _Motion(system.world), system.world.speed_mps()
    began_s, began_m = system.clock.now_s(), system.world.truth.distance_m
    motion.begin()
    case.begin(system)
    _run_until(system, motion, began_s + min(case.lasts_s - 0.1, case.watched_s / 2 - 0.1, case.seen_s))
    way_m = system.world.truth.distance_m - began_m
    reason, seen = _reason(system), _seen(system)
    if math.isfinite(case.lasts_s):
        _run_until(system, motion, began_s + case.lasts_s)
        case.end(system)
    _run_until(system, motion, began_s + case.watched_s)
    nan = math.nan
    return Outcome(
        name=case.name,
        text=case.text,
        speed_mps=speed_mps,
        driven_s=motion.driven_s if motion.has_stood else nan,
        moved_s=motion.moved_s if motion.has_stood else nan,
        way_m=way_m,
        reason=reason,
        seen=seen,
        after=_state(system),
        end_mps=system.world.speed_mps(),
        collisions=system.world.collisions.count,
        failure=_failure(case, system, motion),
    )


def _run_until(system: Lockstep, motion: _Motion, time_s: float) -> None:
    if time_s > system.clock.now_s():
        system.run(time_s - system.clock.now_s())


def _reason(system: Lockstep) -> str:
    telemetry = system.station.view().telemetry
    return telemetry.stop_reason.name.lower() if telemetry is not None else ""


def _seen(system: Lockstep) -> str:
    return mission_sentence(system.station.view(), _STALE_AFTER_S)


def _state(system: Lockstep) -> str:
    view = system.station.view()
    if view.link_state is not LinkState.CONNECTED or view.telemetry is None:
        return "no link"
    telemetry = view.telemetry
    if telemetry.state is MissionState.HALTED:
        return "halted"
    return "goes on" if telemetry.stop_reason is StopReason.NONE else "waits"


def _failure(case: Case, system: Lockstep, motion: _Motion) -> str:
    moves = abs(system.world.speed_mps()) > _STANDS_MPS
    if system.world.collisions.count:
        return "a collision"
    if case.stops and not motion.has_stood:
        return "it did not stop"
    if case.stops and motion.moved_s > case.within_s:
        return f"it did not stand within {case.within_s} s"
    if not case.stops and motion.has_stood and not moves:
        return "it stopped"
    if case.stops and not case.resumes and moves:
        return "it set off again"
    return ""
