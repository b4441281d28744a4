"""The mission: what the car is to do now (paper 1, figure 4). Knows no thread, no link and no device."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from enum import Enum
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from robot_app.control.motion import Motion
from shared.messages import (
    Command,
    Drive,
    EmergencyStop,
    GoTo,
    Heartbeat,
    MissionState,
    Start,
    Stop,
    StopReason,
)


@dataclass(frozen=True, slots=True)
class MissionConfig:
    lap_overlap_m: float = 0.8  # driven on after coming round, so that SLAM sees the beginning twice
    lap_max_distance_m: float = 80.0  # whoever has not come round by then will not
    drive_hold_s: float = 0.5  # a drive command holds for so long …
    drive_hold_radio_s: float = 1.2  # … and over LoRa, where one comes with each turn
    max_path_step_m: float = 0.5  # a path with wider gaps is no path
    max_path_m: float = 500.0


class Behaviour(Enum):
    STAND = "stand"
    FOLLOW_WALL = "follow wall"
    EXPLORE = "explore"
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


_YES = Answer(True)


class Mission:
    """Commands and progress in, behaviour out; safe to call from any thread."""

    def __init__(self, config: MissionConfig) -> None:
        self.slow_link = False  # LoRa alone carries the commands
        self.explores = False  # whether the pilot looks for what a round of the room has not shown
        self._config = config
        self._lock = threading.RLock()
        self._state = MissionState.IDLE
        self._stop_reason = StopReason.NONE
        self._order: PathOrder | None = None
        self._drive: tuple[Motion, float] | None = None
        self._began_m: float | None = None  # where the observation began, in metres driven
        self._round_m: float | None = None  # where it came round
        self._is_round_over = False  # the rest of the room is explored

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

    def handle(self, command: Command, now_s: float) -> Answer:
        """Carry out a command."""
        with self._lock:
            match command:
                case Start():
                    return self._start()
                case Stop():
                    return self.halt(StopReason.OPERATOR)
                case EmergencyStop():
                    return self.halt(StopReason.EMERGENCY)
                case GoTo():
                    return self._go_to(command)
                case Drive():
                    return self._drive_by_hand(command, now_s)
                case Heartbeat():
                    return _YES
                case _:
                    assert_never(command)

    def halt(self, reason: StopReason) -> Answer:
        """End the mission; the first reason stands until the next start."""
        with self._lock:
            if self._state is not MissionState.HALTED or reason is StopReason.EMERGENCY:
                self._stop_reason = reason
            self._state = MissionState.HALTED
            self._forget_orders()
        return _YES

    def behaviour(self, now_s: float) -> Behaviour:
        with self._lock:
            if self._state not in {MissionState.OBSERVE, MissionState.COMMAND}:
                return Behaviour.STAND
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
                    self._state = MissionState.COMMAND

    def explored(self) -> None:
        """Nothing is left to be seen."""
        with self._lock:
            if self._state is MissionState.OBSERVE and self._is_round_over:
                self._state = MissionState.COMMAND

    def path_ended(self, order: PathOrder) -> None:
        """The car has come to the end of this path, or has given it up."""
        with self._lock:
            if self._order is order:
                self._order = None

    def _start(self) -> Answer:
        if self._state in {MissionState.OBSERVE, MissionState.COMMAND}:
            return Answer(False, "the mission is running already")
        self._state = MissionState.OBSERVE
        self._stop_reason = StopReason.NONE
        self._forget_orders()
        return _YES

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
        self._began_m = None
        self._round_m = None
        self._is_round_over = False
