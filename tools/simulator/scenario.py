"""What is simulated: a room, what stands in it, the robot's devices and the mission of the demo.

Room frame: origin on the floor in a corner, x and y along the walls, z up. The map's frame of a perfect mapper
is the robot's start pose in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from shared.config import ConfigError, load, parse, read_table
from shared.geometry.se2 import Pose2

SCENARIO_FOLDER = Path(__file__).parent / "scenarios"
_STEPS_PER_TURN = 1024
_HALF_CAR_M = 0.10
_CLOSED = frozenset({"box", "wall"})
_MIN_HEIGHT_M = 0.10  # the low scanner must see everything that the robot could touch


@dataclass(frozen=True, slots=True)
class Room:
    length_x_m: float = 3.95  # paper 1, figure 15d
    width_y_m: float = 4.2
    wall_height_m: float = 1.5
    wall_reflectivity: float = 0.8

    def __post_init__(self) -> None:
        if min(self.length_x_m, self.width_y_m, self.wall_height_m) <= 0:
            raise ValueError("length_x_m, width_y_m and wall_height_m must be positive")


@dataclass(frozen=True, slots=True)
class Item:
    """A thing in the room: a closed box, a table on four legs, a chair (legs, seat and back), or a wall within it."""

    name: str
    position_m: tuple[float, float]  # of its middle
    size_m: tuple[float, float, float]  # along its own x, along its own y, height
    kind: Literal["box", "table", "chair", "wall"] = "box"
    yaw_deg: float = 0.0
    reflectivity: float = 0.6  # diffuse, 0 to 1, at the wavelength of scanner and camera
    leg_m: float = 0.04  # side of a square leg

    def __post_init__(self) -> None:
        if min(self.size_m) <= 0 or self.size_m[2] < _MIN_HEIGHT_M:
            raise ValueError(f"{self.name}: size_m must be positive and at least {_MIN_HEIGHT_M} m high")
        if not 0 < self.reflectivity <= 1:
            raise ValueError(f"{self.name}: reflectivity must be in (0, 1]")


@dataclass(frozen=True, slots=True)
class Start:
    position_m: tuple[float, float]
    heading_deg: float = 0.0

    @property
    def room_from_robot(self) -> Pose2:
        return Pose2(self.position_m[0], self.position_m[1], math.radians(self.heading_deg))


@dataclass(frozen=True, slots=True)
class Goal:
    """A place the demo sends the robot to after its observation, room frame."""

    position_m: tuple[float, float]


@dataclass(frozen=True, slots=True)
class ScannerParameters:
    """Hokuyo UBG-04LX-F01.

    The spread is that of two recordings of a standing URG-04LX (medians of 3 to 5 mm at 1 to 2 m, 7 to 8 mm at 2 to
    4 m). The data sheet's 10 mm and 1 % are accuracy, which is mostly bias: it is smooth in range and stays.
    """

    period_s: float = 0.040  # 25 Hz, paper 1
    beams: int = 682  # steps 44 to 725 of 1024 a turn
    range_min_m: float = 0.06
    range_max_m: float = 4.0
    sigma_m: float = 0.0025
    sigma_fraction: float = 0.0015  # of the range, added to it
    bias_m: float = 0.004  # greatest; its place in the range is drawn
    bias_period_m: float = 1.5
    dropout: float = 0.005
    edge_step_m: float = 0.10  # neighbouring beams that differ by more straddle an edge
    edge_lost: float = 0.25  # of the beams at an edge
    edge_mixed: float = 0.25
    min_signal_per_m2: float = 0.006  # reflectivity * cos(incidence) / range²: echoes below twice this get lost

    def __post_init__(self) -> None:
        if self.period_s <= 0 or not 1 <= self.beams <= _STEPS_PER_TURN or not 0 < self.range_min_m < self.range_max_m:
            raise ValueError("period_s must be positive, beams from 1 to 1024, range_min_m below range_max_m")


@dataclass(frozen=True, slots=True)
class CameraParameters:
    """Intel RealSense L515: 640 x 480 at 30 frames a second, 70 x 50 degrees, 0.5 to 9 m."""

    width: int = 640
    height: int = 480
    horizontal_deg: float = 70.0
    vertical_deg: float = 50.0
    rate_hz: float = 30.0
    unit_m: float = 0.00025
    range_min_m: float = 0.5
    range_max_m: float = 9.0
    sigma_at_1m_m: float = 0.0025
    sigma_at_9m_m: float = 0.0155
    neighbour_correlation: float = 0.35
    dropout: float = 0.002
    edge_fraction: float = 0.03  # neighbouring pixels whose depths differ by more straddle an edge
    edge_lost: float = 0.35
    edge_flying: float = 0.25
    reflectivity: float = 0.6
    min_signal_per_m2: float = 0.0059  # half of a 95 % target at 9 m, the longest range it promises


@dataclass(frozen=True, slots=True)
class ImuParameters:
    """LSM9DS1 at 245 deg/s and 2 g."""

    rate_hz: float = 100.0
    gyro_noise_dps_rthz: float = 0.012
    gyro_bias_dps: float = 2.0  # standard deviation of the bias at switching on, each axis
    gyro_walk_dps_rts: float = 0.002  # random walk of the bias
    gyro_step_dps: float = 0.00875
    acceleration_noise_mg_rthz: float = 0.25
    acceleration_bias_mg: float = 20.0
    acceleration_step_mg: float = 0.061


@dataclass(frozen=True, slots=True)
class SlipParameters:
    """How far the rear wheels slip, as shares of the way that they roll; `tools/simulator/slip.py` tells the parts."""

    steady: float = 0.0
    wheels_differ: float = 0.0  # of the steady part, greatest
    wander: float = 0.0  # standard deviation
    wander_way_m: float = 0.5  # over which it changes
    burst: float = 0.0  # mean; from half of it to one and a half
    burst_s: float = 0.2  # mean, likewise
    bursts_hz: float = 4.0  # of each wheel, while there is reason for one
    burst_above_mps2: float = 0.1
    burst_above_radps: float = 0.5  # of the steering

    def __post_init__(self) -> None:
        if min(self.steady, self.wheels_differ, self.wander, self.burst, self.bursts_hz) < 0:
            raise ValueError("steady, wheels_differ, wander, burst and bursts_hz must not be negative")
        if self.wander_way_m <= 0 or self.burst_s <= 0:
            raise ValueError("wander_way_m and burst_s must be positive")

    @property
    def is_any(self) -> bool:
        return max(self.steady, self.wander, self.burst) > 0

    @staticmethod
    def of(share: float) -> SlipParameters:
        """A floor on which the wheels' counts are wrong by `share` in the long run, and by more from metre to metre."""
        return SlipParameters(steady=share, wheels_differ=0.2, wander=share, burst=6 * share)


@dataclass(frozen=True, slots=True)
class EncoderParameters:
    ticks_per_turn: int = 80
    left_scale_error: float = 0.003  # a wheel a little larger than its drawing
    right_scale_error: float = -0.002
    slip: SlipParameters = field(default_factory=SlipParameters)


@dataclass(frozen=True, slots=True)
class BatteryParameters:
    """Two LiFePO4 cells in series."""

    nominal_v: float = 6.6
    capacity_ah: float = 3.0
    charge: float = 0.9  # at the start, 0 to 1
    resistance_ohm: float = 0.06
    idle_current_a: float = 1.8  # computer and sensors
    noise_v: float = 0.004


@dataclass(frozen=True, slots=True)
class TemperatureParameters:
    ambient_c: float = 24.0
    rise_c: float = 31.0  # of the busy processor, in the end
    time_constant_s: float = 240.0
    noise_c: float = 0.3


@dataclass(frozen=True, slots=True)
class CarParameters:
    """350 x 200 x 200 mm; what follows from a small geared motor and a hobby servo."""

    wheelbase_m: float = 0.26
    track_m: float = 0.17
    wheel_radius_m: float = 0.04
    wheel_width_m: float = 0.03
    front_m: float = 0.305
    rear_m: float = 0.045
    width_m: float = 0.20
    height_m: float = 0.20
    mass_kg: float = 3.0
    max_steering_rad: float = 0.5
    servo_rate_radps: float = 4.0
    servo_lag_s: float = 0.04
    no_load_speed_mps: float = 0.70  # full duty at the battery's nominal voltage
    stall_torque_nm: float = 0.8  # of both rear wheels together
    stall_current_a: float = 4.0
    gear_friction_nm: float = 0.02  # each rear wheel
    scanner_x_m: float = 0.25
    scanner_z_m: float = 0.09
    camera_x_m: float = 0.28
    camera_z_m: float = 0.17
    camera_pitch_down_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class OmniParameters:
    """A disc of 340 mm on three omnidirectional wheels, each with a small geared motor."""

    wheel_distance_m: float = 0.13
    wheel_radius_m: float = 0.04
    radius_m: float = 0.17
    height_m: float = 0.20
    mass_kg: float = 4.0
    no_load_speed_mps: float = 0.70  # of a wheel, full duty at the battery's nominal voltage
    stall_torque_nm: float = 0.8  # of each wheel
    stall_current_a: float = 3.0
    gear_friction_nm: float = 0.02
    wheel_inertia_kgm2: float = 4e-4  # with its motor behind the gear
    ticks_per_turn: int = 320
    wheel_scale_errors: tuple[float, float, float] = (0.003, -0.002, 0.001)  # wheels larger than their drawing
    scanner_x_m: float = 0.0
    scanner_z_m: float = 0.09
    camera_x_m: float = 0.13
    camera_z_m: float = 0.17
    camera_pitch_down_deg: float = 0.0


RobotName = Literal["car", "omni"]
ROBOT_NAMES: tuple[RobotName, ...] = get_args(RobotName)


@dataclass(frozen=True, slots=True)
class Scenario:
    name: str
    start: Start
    room: Room = field(default_factory=Room)
    items: tuple[Item, ...] = ()
    goals: tuple[Goal, ...] = ()
    floor_friction: float = 1.0
    robot: RobotName = "car"
    car: CarParameters = field(default_factory=CarParameters)
    omni: OmniParameters = field(default_factory=OmniParameters)
    scanner: ScannerParameters = field(default_factory=ScannerParameters)
    camera: CameraParameters = field(default_factory=CameraParameters)
    imu: ImuParameters = field(default_factory=ImuParameters)
    encoders: EncoderParameters = field(default_factory=EncoderParameters)
    battery: BatteryParameters = field(default_factory=BatteryParameters)
    temperature: TemperatureParameters = field(default_factory=TemperatureParameters)

    def __post_init__(self) -> None:
        names = [item.name for item in self.items]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ValueError(f"items must have different names; twice: {', '.join(sorted(twice))}")
        for what, (x, y) in (("start", self.start.position_m), *(("goals", g.position_m) for g in self.goals)):
            if not (0 < x < self.room.length_x_m and 0 < y < self.room.width_y_m):
                raise ValueError(f"{what}: ({x}, {y}) is not in the room")
        self._check_items()

    def _check_items(self) -> None:
        for item in self.items:
            x, y = item.position_m
            if not (0 <= x <= self.room.length_x_m and 0 <= y <= self.room.width_y_m):
                raise ValueError(f"items: {item.name} at ({x}, {y}) is not in the room")
        places = [("start", self.start.position_m), *(("goals", goal.position_m) for goal in self.goals)]
        for what, place in places:
            inside = next((item.name for item in self.items if item.kind in _CLOSED and _covers(item, place)), None)
            if inside is not None:
                raise ValueError(f"{what}: {place} is in or against {inside}")

    @property
    def body(self) -> CarParameters | OmniParameters:
        """Of the robot that is simulated."""
        return self.car if self.robot == "car" else self.omni

    def goals_in_start_frame_m(self) -> tuple[tuple[float, float], ...]:
        """The goals as seen from the start pose, which is where a map begins."""
        start_from_room = self.start.room_from_robot.inverse()
        moved = [start_from_room.apply(np.array([goal.position_m]))[0] for goal in self.goals]
        return tuple((float(x), float(y)) for x, y in moved)


def _covers(item: Item, place_m: tuple[float, float]) -> bool:
    """Whether the car's middle cannot stand there."""
    pose = Pose2(*item.position_m, math.radians(item.yaw_deg))
    dx, dy = pose.inverse().apply(np.array([place_m]))[0]
    return bool(abs(dx) < item.size_m[0] / 2 + _HALF_CAR_M and abs(dy) < item.size_m[1] / 2 + _HALF_CAR_M)


def scenario_names() -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in SCENARIO_FOLDER.glob("*.toml")))


def find_scenario(name_or_path: str) -> Scenario:
    """The scenario of this name, or in this file; a wrong one is a `ConfigError` that lists the known ones."""
    known = SCENARIO_FOLDER / f"{name_or_path}.toml"
    if name_or_path in scenario_names():
        return _load(known)
    path = Path(name_or_path)
    if path.suffix == ".toml" and path.is_file():
        return _load(path)
    raise ConfigError(
        f"no scenario {name_or_path!r}; known are {', '.join(scenario_names())}, or the path of a TOML file"
    )


def _load(path: Path) -> Scenario:
    """A file may name another scenario as its `base` and then say only what differs from it."""
    table = read_table(path)
    base = table.pop("base", None)
    if base is None:
        return load(path, Scenario)
    if base not in scenario_names():
        raise ConfigError(f"{path}: base must be one of {', '.join(scenario_names())}, not {base!r}")
    try:
        return parse(_merged(read_table(SCENARIO_FOLDER / f"{base}.toml"), table), Scenario)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Tables are merged, everything else is taken from `changes`."""
    merged = dict(base)
    for key, value in changes.items():
        below = merged.get(key)
        merged[key] = _merged(below, value) if isinstance(value, dict) and isinstance(below, dict) else value
    return merged
