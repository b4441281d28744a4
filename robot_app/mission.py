"""The mission: what the car is to do now (paper 1, figure 4). Knows no thread, no link and no device."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from enum import Enum
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from robot_app.control.motion import Motion
from shared.geometry.se2 import Pose2
from shared.messages import (
    Command,
    Drive,
    EmergencyStop,
    GoTo,
    Heartbeat,
    MissionState,
    Pause,
    Resume,
    ReturnToStart,
    Start,
    Stop,
    StopReason,
)

RUNNING = frozenset({MissionState.OBSERVE, MissionState.COMMAND, MissionState.RETURN})


@dataclass(frozen=True, slots=True)
class MissionConfig:
    lap_overlap_m: float = 0.8  # driven on after coming round, so that SLAM sees the beginning twice
    lap_max_distance_m: float = 80.0  # whoever has not come round by then will not
    drive_hold_s: float = 0.5  # a drive command holds for so long …
    drive_hold_radio_s: float = 1.2  # … and over LoRa, where one comes with each turn
    max_path_step_m: float = 0.5  # a path with wider gaps is no path
    max_path_m: float = 500.0
    state_folder: str = ""  # where the mission is kept over a restart; empty: where systemd says, or nowhere


class Behaviour(Enum):
    STAND = "stand"
    FOLLOW_WALL = "follow wall"
    EXPLORE = "explore"
    GO_HOME = "go home"
    FOLLOW_PATH = "follow path"
    BY_HAND = "by hand"


@dataclass(frozen=True, slots=True)
class Answer:
    accepted: bool
    reason: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class PathOrder:
    """`path`: (N, 3) as in `GoTo`."""

    goal_id: int
    path: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class MissionRecord:
    """What is kept of a mission, so that the app can be started again in its middle.

    `going_on`: the state that it goes on in. `robot_from_home`: where it was started, seen from where the robot is.
    """

    going_on: MissionState = MissionState.IDLE
    is_round_over: bool = False
    is_observed: bool = False
    stop_reason: StopReason = StopReason.NONE
    distance_m: float = 0.0
    robot_from_home: Pose2 | None = None


_YES = Answer(True)


class Mission:
    """Commands and progress in, behaviour out; safe to call from any thread."""

    def __init__(self, config: MissionConfig) -> None:
        self.slow_link = False  # LoRa alone carries the commands
        self.explores = False  # whether the pilot looks for what a round of the room has not shown
        self._config = config
        self._lock = threading.RLock()
        self._number = 0
        self._state = MissionState.IDLE
        self._stop_reason = StopReason.NONE
        self._order: PathOrder | None = None
        self._drive: tuple[Motion, float] | None = None
        self._began_m: float | None = None  # where the observation began, in metres driven
        self._round_m: float | None = None  # where it came round
        self._is_round_over = False  # the rest of the room is explored
        self._is_observed = False  # all of it
        self._going_on = MissionState.IDLE  # what it goes on in after a pause or a halt
        self._home: Pose2 | None = None  # odom frame
        self._pose = Pose2()
        self._start_m: float | None = None  # the odometer at the mission's beginning
        self._driven_m = 0.0

    @property
    def state(self) -> MissionState:
        return self._state

    @property
    def stop_reason(self) -> StopReason:
        """Why the mission halted."""
        return self._stop_reason

    @property
    def order(self) -> PathOrder | None:
        """The path to follow, None when there is none."""
        with self._lock:
            return self._order

    @property
    def number(self) -> int:
        """How many were started; one that goes on is the same."""
        return self._number

    @property
    def home(self) -> Pose2 | None:
        """Where the mission was started, odom frame; None before its first moment."""
        with self._lock:
            return self._home

    def at(self, odom_from_robot: Pose2, distance_m: float) -> None:
        """Where the robot is, after so much driven since the app was started; tell it a few times a second."""
        with self._lock:
            self._pose = odom_from_robot
            if self._state not in RUNNING:
                return
            if self._home is None:
                self._home = odom_from_robot
            if self._start_m is None:
                self._start_m = distance_m - self._driven_m
            self._driven_m = distance_m - self._start_m

    @property
    def record(self) -> MissionRecord:
        """What is to be kept."""
        with self._lock:
            home = self._pose.inverse() @ self._home if self._home is not None else None
            going_on = self._state if self._state in RUNNING else self._going_on
            return MissionRecord(
                going_on, self._is_round_over, self._is_observed, self._stop_reason, self._driven_m, home
            )

    def restore(self, record: MissionRecord) -> None:
        """At the start of the app, the robot standing where the record was made: paused in the middle of a mission."""
        with self._lock:
            if record.going_on not in RUNNING:
                return
            self._state, self._stop_reason = MissionState.PAUSED, StopReason.RESTARTED
            self._going_on = record.going_on
            self._is_round_over, self._is_observed = record.is_round_over, record.is_observed
            self._driven_m, self._home = record.distance_m, record.robot_from_home

    def handle(self, command: Command, now_s: float) -> Answer:
        """Carry out a command."""
        with self._lock:
            match command:
                case Start():
                    answer = self._start()
                case Stop():
                    answer = self.halt(StopReason.OPERATOR)
                case EmergencyStop():
                    answer = self.halt(StopReason.EMERGENCY)
                case GoTo():
                    answer = self._go_to(command)
                case Drive():
                    answer = self._drive_by_hand(command, now_s)
                case ReturnToStart():
                    answer = self._go_home()
                case Pause():
                    answer = self._pause()
                case Resume():
                    answer = self._resume()
                case Heartbeat():
                    answer = _YES
                case _:
                    assert_never(command)
            return answer

    def halt(self, reason: StopReason) -> Answer:
        """End the mission; the first reason stands until the next start."""
        with self._lock:
            if self._state is not MissionState.HALTED or reason is StopReason.EMERGENCY:
                self._stop_reason = reason
            if self._state in RUNNING:
                self._going_on = self._state
            self._state = MissionState.HALTED
            self._forget_orders()
        return _YES

    def go_home(self) -> bool:
        """Break off what it does and go back to the start; False where that is not possible."""
        with self._lock:
            return self._go_home().accepted

    def behaviour(self, now_s: float) -> Behaviour:
        with self._lock:
            if self._state not in RUNNING:
                return Behaviour.STAND
            if self._state is MissionState.RETURN:
                return Behaviour.GO_HOME
            if self.hand_motion(now_s) is not None:
                return Behaviour.BY_HAND
            if self._state is MissionState.OBSERVE:
                return Behaviour.EXPLORE if self._is_round_over else Behaviour.FOLLOW_WALL
            return Behaviour.STAND if self._order is None else Behaviour.FOLLOW_PATH

    def hand_motion(self, now_s: float) -> Motion | None:
        """What the operator asks for by hand, while it holds."""
        with self._lock:
            if self._drive is None or now_s > self._drive[1]:
                return None
            return self._drive[0]

    def observed(self, distance_m: float, came_round: bool, is_over: bool = False) -> None:
        """Progress of the round: the metres driven so far, and whether the wall follower has come round, or whether
        going on round brings nothing."""
        with self._lock:
            if self._state is not MissionState.OBSERVE or self._is_round_over:
                return
            if self._began_m is None:
                self._began_m = distance_m
            if came_round and self._round_m is None:
                self._round_m = distance_m
            overlapped = self._round_m is not None and distance_m - self._round_m >= self._config.lap_overlap_m
            if overlapped or is_over or distance_m - self._began_m >= self._config.lap_max_distance_m:
                self._is_round_over = True
                if not self.explores:
                    self._end_observation()

    def explored(self) -> None:
        """Nothing is left to be seen."""
        with self._lock:
            if self._state is MissionState.OBSERVE and self._is_round_over:
                self._end_observation()

    def returned(self, found_way: bool) -> None:
        """The robot is at its start, or has found no way to it. An observation that was broken off can go on then."""
        with self._lock:
            if self._state is not MissionState.RETURN:
                return
            if found_way and self._is_observed:
                self._state = MissionState.COMMAND
                return
            self._state = MissionState.PAUSED
            self._going_on = MissionState.OBSERVE if found_way else MissionState.RETURN
            self._stop_reason = StopReason.NONE if found_way else StopReason.BLOCKED

    def path_ended(self, order: PathOrder) -> None:
        """The car has come to the end of this path, or has given it up."""
        with self._lock:
            if self._order is order:
                self._order = None

    def _start(self) -> Answer:
        if self._state in RUNNING:
            return Answer(False, "the mission is running already")
        self._state = MissionState.OBSERVE
        self._stop_reason = StopReason.NONE
        self._forget_orders()
        self._began_m = self._round_m = self._start_m = self._home = None
        self._is_round_over = self._is_observed = False
        self._driven_m = 0.0
        self._number += 1
        return _YES

    def _go_home(self) -> Answer:
        if self._state not in RUNNING | {MissionState.PAUSED}:
            return Answer(False, "there is no mission to return from")
        if self._home is None:
            return Answer(False, "the robot does not know the way back to its start")
        self._state = MissionState.RETURN
        self._stop_reason = StopReason.NONE
        self._forget_orders()
        return _YES

    def _pause(self) -> Answer:
        if self._state not in RUNNING:
            return Answer(False, "there is nothing to pause")
        self._going_on, self._state = self._state, MissionState.PAUSED
        self._stop_reason = StopReason.NONE
        self._drive = None
        return _YES

    def _resume(self) -> Answer:
        if self._state not in {MissionState.PAUSED, MissionState.HALTED} or self._going_on not in RUNNING:
            return Answer(False, "there is no mission to go on with")
        self._state = self._going_on
        self._stop_reason = StopReason.NONE
        return _YES

    def _end_observation(self) -> None:
        self._is_observed = True
        self._state = MissionState.COMMAND

    def _go_to(self, command: GoTo) -> Answer:
        if self._state is not MissionState.COMMAND:
            return Answer(False, "go to is possible once the observation has finished")
        if len(command.path) < 2:
            return Answer(False, "the path has fewer than two points")
        steps_m = np.hypot(*np.diff(command.path[:, :2].astype(np.float64), axis=0).T)
        if steps_m.max() > self._config.max_path_step_m or steps_m.sum() > self._config.max_path_m:
            return Answer(False, f"the path has a gap of {steps_m.max():.2g} m or is longer than is allowed")
        self._order = PathOrder(command.goal_id, command.path)
        return _YES

    def _drive_by_hand(self, command: Drive, now_s: float) -> Answer:
        if self._state not in {MissionState.OBSERVE, MissionState.COMMAND}:
            return Answer(False, "press start before driving by hand")
        motion = Motion(command.speed_mps, command.steering_rad)
        self._order = None  # who takes the wheel has other plans than the path
        hold_s = self._config.drive_hold_radio_s if self.slow_link else self._config.drive_hold_s
        self._drive = (motion, now_s + hold_s)
        return _YES

    def _forget_orders(self) -> None:
        self._order = None
        self._drive = None
