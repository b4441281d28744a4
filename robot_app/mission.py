"""The mission: what the car is to do now (paper 1, figure 4). Knows no thread, no link and no device."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from enum import Enum
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from robot_app.control.motion import Motion
from shared.geometry.se2 import Pose2, wrap_angle
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
    """When the observation counts as one round of the room."""

    lap_min_distance_m: float = 5.0  # a round is no shorter
    lap_return_m: float = 0.50  # so near the start again …
    lap_heading_rad: float = 1.0  # … and heading as at the start …
    lap_overlap_m: float = 0.6  # … and so much further, so that SLAM sees the start twice
    lap_max_distance_m: float = 60.0  # whoever has not come round by then will not
    drive_hold_s: float = 0.5  # a drive command holds for so long


class Behaviour(Enum):
    STAND = "stand"
    FOLLOW_WALL = "follow wall"
    FOLLOW_PATH = "follow path"
    BY_HAND = "by hand"


@dataclass(frozen=True, slots=True)
class Answer:
    accepted: bool
    reason: str = ""


_YES = Answer(True)


class Mission:
    """Commands and progress in, behaviour out; safe to call from any thread."""

    def __init__(self, config: MissionConfig) -> None:
        self._config = config
        self._lock = threading.RLock()
        self._state = MissionState.IDLE
        self._stop_reason = StopReason.NONE
        self._goal_id: int | None = None
        self._path: NDArray[np.float32] | None = None
        self._path_revision = 0
        self._drive: tuple[Motion, float] | None = None
        self._lap: _Lap | None = None

    @property
    def state(self) -> MissionState:
        return self._state

    @property
    def stop_reason(self) -> StopReason:
        """Why the mission halted."""
        return self._stop_reason

    @property
    def path(self) -> tuple[int, NDArray[np.float32] | None]:
        """The path to follow and its revision, which grows with every new path."""
        with self._lock:
            return self._path_revision, self._path

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
                return Behaviour.FOLLOW_WALL
            return Behaviour.STAND if self._path is None else Behaviour.FOLLOW_PATH

    def hand_motion(self, now_s: float) -> Motion | None:
        """What the operator asks for by hand, while it holds."""
        with self._lock:
            if self._drive is None or now_s > self._drive[1]:
                return None
            return self._drive[0]

    def progress(self, odom_from_robot: Pose2, distance_m: float) -> None:
        """Watch for the end of the observation: once round and a little further."""
        with self._lock:
            if self._state is not MissionState.OBSERVE:
                return
            if self._lap is None:
                self._lap = _Lap(odom_from_robot, distance_m)
            if self._lap.finished(odom_from_robot, distance_m, self._config):
                self._state = MissionState.COMMAND
                self._lap = None

    def path_ended(self, revision: int) -> None:
        """The car has come to the end of this path, or has given it up."""
        with self._lock:
            if revision == self._path_revision:
                self._path = None

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
        self._goal_id = command.goal_id
        self._path = command.path
        self._path_revision += 1
        return _YES

    def _drive_by_hand(self, command: Drive, now_s: float) -> Answer:
        if self._state not in {MissionState.OBSERVE, MissionState.COMMAND}:
            return Answer(False, "press start before driving by hand")
        motion = Motion(command.speed_mps, command.steering_rad)
        self._drive = (motion, now_s + self._config.drive_hold_s)
        return _YES

    def _forget_orders(self) -> None:
        self._path = None
        self._drive = None
        self._lap = None


class _Lap:
    """One round of the room, by odometry."""

    def __init__(self, start: Pose2, distance_m: float) -> None:
        self._start = start
        self._start_m = distance_m
        self._back_m = math.inf

    def finished(self, pose: Pose2, distance_m: float, config: MissionConfig) -> bool:
        driven_m = distance_m - self._start_m
        if driven_m >= config.lap_max_distance_m:
            return True
        if math.isinf(self._back_m) and driven_m >= config.lap_min_distance_m and self._is_back(pose, config):
            self._back_m = distance_m
        return distance_m >= self._back_m + config.lap_overlap_m

    def _is_back(self, pose: Pose2, config: MissionConfig) -> bool:
        turned_rad = abs(wrap_angle(pose.theta_rad - self._start.theta_rad))
        return pose.distance_m(self._start) <= config.lap_return_m and turned_rad <= config.lap_heading_rad
