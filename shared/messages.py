"""What the robot and the station say to each other.

All quantities are SI. Messages are immutable and so are their arrays: one may be handed to any thread.
Times are seconds of the robot's monotonic clock, which starts near zero when its app starts.
Frames: `robot` has its origin on the floor under the middle of the rear axle, x forward, y left, z up;
`odom` is where `robot` stood when the app started, and drifts; `map` belongs to the station.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2


def _frozen(array: NDArray[np.generic], dtype: np.dtype[np.generic]) -> NDArray[np.generic]:
    """A read-only array of `dtype`; what is read-only already is not copied."""
    if array.dtype == dtype and not array.flags.writeable:
        return array
    copy = np.array(array, dtype=dtype, copy=True)
    copy.setflags(write=False)
    return copy


class MissionState(IntEnum):
    """Where the mission stands (paper 1, figure 4)."""

    IDLE = 0  # nothing asked for yet
    OBSERVE = 1  # the robot goes round the room by itself
    COMMAND = 2  # the map is there; the robot does what the operator asks
    HALTED = 3  # stopped by the operator, by a fault or by silence
    RETURN = 4  # on its way back to where it started
    PAUSED = 5  # stands until the operator lets it go on


class StopReason(IntEnum):
    """Why the robot stands still although a mission may be running."""

    NONE = 0
    OPERATOR = 1
    EMERGENCY = 2
    COMMAND_SILENCE = 3
    SENSOR_STALE = 4
    DEVICE_FAULT = 5
    LOW_BATTERY = 6
    OVER_TEMPERATURE = 7
    BLOCKED = 8
    TASK_FAULT = 9
    SHUTDOWN = 10
    STALLED = 11  # the motor gets current and the encoders do not count
    TILTED = 12
    ENCODER_FAULT = 13  # one of the encoders counts nothing while the other does
    SENSORS_DISAGREE = 14  # gyro and encoders do not agree on how the robot turns
    RESTARTED = 15  # the app was started again in the middle of a mission, which can be continued


@dataclass(frozen=True, slots=True)
class ScanGeometry:
    """Where the beams of a scan point and how the scanner sits on the robot.

    Beam i points to `first_angle_rad + i * step_rad` in the scanner's frame, counter-clockwise, and is
    measured `i * beam_interval_s` after the scan's stamp.
    """

    first_angle_rad: float
    step_rad: float
    beam_interval_s: float
    range_min_m: float
    range_max_m: float
    robot_from_scanner: Pose2

    def angles_rad(self, count: int) -> NDArray[np.float64]:
        """(count,) angles in the scanner's frame."""
        return self.first_angle_rad + self.step_rad * np.arange(count, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class ObjectNetwork:
    """Outlines of 3D objects: nodes and the connections between them (paper 1, section 3.2).

    `nodes_m`: (N, 3) float32, robot frame at the observation's stamp, z up from the floor.
    `edges`: (M, 2) uint16 indices into `nodes_m`. Objects are its connected components.
    """

    nodes_m: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    edges: NDArray[np.uint16] = field(default_factory=lambda: np.zeros((0, 2), np.uint16))

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes_m", _frozen(self.nodes_m, np.dtype(np.float32)))
        object.__setattr__(self, "edges", _frozen(self.edges, np.dtype(np.uint16)))
        if self.nodes_m.ndim != 2 or self.nodes_m.shape[1] != 3:
            raise ValueError(f"nodes_m must be (N, 3), not {self.nodes_m.shape}")
        if self.edges.ndim != 2 or self.edges.shape[1] != 2:
            raise ValueError(f"edges must be (M, 2), not {self.edges.shape}")
        if len(self.edges) and int(self.edges.max()) >= len(self.nodes_m):
            raise ValueError(f"edges name node {int(self.edges.max())} of {len(self.nodes_m)}")


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What the robot saw at one moment: a 2D scan and the 3D objects, with its own idea of where it was."""

    sequence: int
    stamp_s: float  # of beam 0
    odom_from_robot: Pose2
    speed_mps: float  # forward, at the stamp
    yaw_rate_radps: float
    geometry: ScanGeometry
    ranges_m: NDArray[np.float32]  # (B,); NaN where the scanner measured nothing
    objects: ObjectNetwork
    has_objects: bool  # False when no depth image was fresh enough: "saw none" is not "did not look"
    boot_id: int = 0  # drawn by the app when it starts: another one is another odom frame, and a new map

    def __post_init__(self) -> None:
        object.__setattr__(self, "ranges_m", _frozen(self.ranges_m, np.dtype(np.float32)))


@dataclass(frozen=True, slots=True)
class Telemetry:
    """What the operator's gauges show."""

    stamp_s: float
    state: MissionState
    stop_reason: StopReason
    odom_from_robot: Pose2
    speed_mps: float
    yaw_rate_radps: float
    steering_rad: float
    battery_v: float  # NaN where it was not measured
    motor_current_a: float
    cpu_temperature_c: float
    distance_m: float  # driven since the app started
    late_ticks: int  # ticks that the scheduler skipped since the app started
    following_goal: int = 0  # the `goal_id` of the path being followed; 0 when none is
    faults: tuple[str, ...] = ()  # one short text per fault that stands


@dataclass(frozen=True, slots=True)
class Pulse:
    """What of the telemetry goes over LoRa, once a second; the names are those of `Telemetry`."""

    stamp_s: float
    state: MissionState
    stop_reason: StopReason
    odom_from_robot: Pose2
    speed_mps: float
    steering_rad: float
    battery_v: float
    motor_current_a: float
    cpu_temperature_c: float
    distance_m: float


class FanState(IntEnum):
    UNKNOWN = 0
    OFF = 1
    ON = 2


@dataclass(frozen=True, slots=True)
class TaskVitals:
    """How a task keeps its row of the schedule: rates and shares since the last report, the worst since the start."""

    name: str
    rate_hz: float
    late_share: float  # of the ticks, by more than 5 ms
    over_budget_share: float
    latest_s: float
    longest_s: float  # processor time of a tick


@dataclass(frozen=True, slots=True)
class Vitals:
    """How the robot's computer does. Over LoRa only the tasks that are not on time are named."""

    stamp_s: float
    cores: float  # processor time of the app over time, since the last report
    memory_mb: float
    fan: FanState
    throttling: tuple[str, ...]  # what holds the processor back now
    tasks: tuple[TaskVitals, ...]
    counters: tuple[tuple[str, int], ...] = ()  # of the drivers: what was damaged or lost since the start


@dataclass(frozen=True, slots=True)
class KeyframeWanted:
    """The station cannot follow the compact observations any more: the next one must stand for itself."""


@dataclass(frozen=True, slots=True)
class Hello:
    """The robot's first words on a new connection."""

    robot_name: str
    software_version: str
    footprint_m: tuple[tuple[float, float], ...]  # corners, robot frame, counter-clockwise
    min_turning_radius_m: float


@dataclass(frozen=True, slots=True)
class Ack:
    """The robot's answer to the command with this number."""

    command: int
    accepted: bool
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Refusal:
    """The robot will not talk to this station; it closes the link after that."""

    reason: str


@dataclass(frozen=True, slots=True)
class Start:
    """Begin the observation task."""


@dataclass(frozen=True, slots=True)
class Stop:
    """End the mission; the robot stands still until the next `Start`."""


@dataclass(frozen=True, slots=True)
class EmergencyStop:
    """Cut the drive now, whatever is going on."""


@dataclass(frozen=True, slots=True, eq=False)
class GoTo:
    """Follow a path to its last point and stand still there.

    `path`: (N, 3) float32, x_m, y_m, theta_rad of the robot along the way, odom frame, from near the robot to the
    goal, a point at least every 10 cm. Where the heading points against the way to the next point, the robot goes
    there in reverse. The station sends a path again with the same `goal_id` when the map moved under it.
    """

    goal_id: int
    path: NDArray[np.float32]

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", _frozen(self.path, np.dtype(np.float32)))
        if self.path.ndim != 2 or self.path.shape[1] != 3:
            raise ValueError(f"path must be (N, 3), not {self.path.shape}")


@dataclass(frozen=True, slots=True)
class Drive:
    """Drive by hand; holds for half a second unless sent again."""

    speed_mps: float
    steering_rad: float


@dataclass(frozen=True, slots=True)
class ReturnToStart:
    """Go back to where the mission was started, by the robot's own map; it needs no path from the station."""


@dataclass(frozen=True, slots=True)
class Pause:
    """Stand still, and keep all that the mission has come to."""


@dataclass(frozen=True, slots=True)
class Resume:
    """Go on with the mission that was paused, halted, or cut off when the app was started again."""


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """The operator is still there. Without one the robot stops."""


Command = Start | Stop | EmergencyStop | GoTo | Drive | Heartbeat | ReturnToStart | Pause | Resume


@dataclass(frozen=True, slots=True)
class NumberedCommand:
    """A command as it crosses the air; the robot acknowledges `number` and does not carry it out twice."""

    number: int
    command: Command


Report = Observation | Telemetry | Pulse | Vitals | Hello | Ack | Refusal
Message = Report | NumberedCommand | KeyframeWanted
