"""Everything that can be set about the robot, as `robot.toml` holds it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

from robot_app.control.explorer import ExplorerConfig
from robot_app.control.obstacle_avoidance import AvoidanceConfig
from robot_app.control.obstacle_memory import ObstacleMemoryConfig
from robot_app.control.omni.avoidance import OmniAvoidanceConfig
from robot_app.control.omni.homing import HomingConfig
from robot_app.control.omni.path_follower import OmniPathConfig
from robot_app.control.omni.wall_follower import OmniWallConfig
from robot_app.control.omni.wheel_speeds import OmniSpeedConfig
from robot_app.control.path_follower import PathFollowerConfig
from robot_app.control.round_watch import RoundConfig
from robot_app.control.seen_ground import SeenGroundConfig
from robot_app.control.speed import SpeedConfig
from robot_app.control.wall_follower import WallFollowerConfig
from robot_app.drivers.config import DeviceConfig
from robot_app.mission import MissionConfig
from robot_app.perception.config import PerceptionConfig
from robot_app.safety.bands import SafetyConfig
from robot_app.sensing.odometry import OdometryConfig
from robot_app.sensing.scan_filter import ScanFilterConfig
from shared.config import load, read_table
from shared.geometry.ackermann import CarGeometry
from shared.geometry.camera import CameraMount
from shared.geometry.omni3 import OmniGeometry
from shared.link.radio_config import LinkUse, RadioConfig, longest_word_s

DEFAULT_PATH = Path(__file__).with_name("robot.toml")
OMNI_PATH = Path(__file__).with_name("omni.toml")

_FASTEST_MPS = 0.46  # the paper's robot; stopping distances and times were measured up to it
_UNSIGNED = ("odometry", "mission", "safety", "control")  # tables of sizes, times and gains, where a minus is a slip
_SIGNED = frozenset({"side"})  # -1 is the right one


def _check_speed(max_speed_mps: float) -> None:
    if not 0 < max_speed_mps <= _FASTEST_MPS:
        raise ValueError(f"max_speed_mps must be above 0 and at most {_FASTEST_MPS}")


def _below_zero(table: Any, name: str) -> Iterator[str]:
    """The names of the numbers in a table, and in the tables in it, that are negative."""
    for key in (entry.name for entry in fields(table)):
        value = getattr(table, key)
        if is_dataclass(value):
            yield from _below_zero(value, f"{name}.{key}")
        elif isinstance(value, int | float) and value < 0 and key not in _SIGNED:
            yield f"{name}.{key}"


@dataclass(frozen=True, slots=True)
class LinkConfig:
    use: LinkUse = "tcp"  # Wi-Fi, LoRa ("radio"), or both: LoRa for when Wi-Fi fails
    port: int = 47100
    bind: str = "0.0.0.0"  # noqa: S104 - the robot is reached from the lab's network
    pairing: str = ""  # the pairing file; empty lets anybody in over Wi-Fi, and nobody over LoRa

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65_535:
            raise ValueError(f"port must be from 0 to 65535, not {self.port}")


@dataclass(frozen=True, slots=True)
class ControlConfig:
    max_speed_mps: float = 0.46  # the fastest of the paper's robot; whoever asks for more gets this
    memory: ObstacleMemoryConfig = field(default_factory=ObstacleMemoryConfig)
    ground: SeenGroundConfig = field(default_factory=SeenGroundConfig)
    wall: WallFollowerConfig = field(default_factory=WallFollowerConfig)
    path: PathFollowerConfig = field(default_factory=PathFollowerConfig)
    round: RoundConfig = field(default_factory=RoundConfig)
    explorer: ExplorerConfig = field(default_factory=ExplorerConfig)
    avoidance: AvoidanceConfig = field(default_factory=AvoidanceConfig)
    speed: SpeedConfig = field(default_factory=SpeedConfig)

    def __post_init__(self) -> None:
        _check_speed(self.max_speed_mps)


@dataclass(frozen=True, slots=True)
class OmniControlConfig:
    max_speed_mps: float = 0.43  # whoever asks for more gets this; with what the loops overshoot it stays below 0.46
    wall_freedom_rad: float = 1.3  # the wall follower's direction may be changed as the obstacles ask
    path_freedom_rad: float = 0.25  # a planned path is free already; only small corrections are taken
    hand_turn_per_s: float = 2.5  # by hand: so many radians a second of turning for each of steering
    memory: ObstacleMemoryConfig = field(default_factory=ObstacleMemoryConfig)
    wall: OmniWallConfig = field(default_factory=OmniWallConfig)
    path: OmniPathConfig = field(default_factory=OmniPathConfig)
    homing: HomingConfig = field(default_factory=HomingConfig)
    avoidance: OmniAvoidanceConfig = field(default_factory=OmniAvoidanceConfig)
    speed: OmniSpeedConfig = field(default_factory=OmniSpeedConfig)

    def __post_init__(self) -> None:
        _check_speed(self.max_speed_mps)


@dataclass(frozen=True, slots=True, kw_only=True)
class CommonConfig:
    """Of every kind of robot."""

    name: str
    camera: CameraMount
    link: LinkConfig = field(default_factory=LinkConfig)
    radio: RadioConfig = field(default_factory=RadioConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    scan_filter: ScanFilterConfig = field(default_factory=ScanFilterConfig)
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)
    mission: MissionConfig = field(default_factory=MissionConfig)
    safety: SafetyConfig = field(default_factory=SafetyConfig)
    devices: DeviceConfig = field(default_factory=DeviceConfig)

    def __post_init__(self) -> None:
        for key in (key for name in _UNSIGNED for key in _below_zero(getattr(self, name), name)):
            raise ValueError(f"{key} must not be negative")
        if self.link.use == "tcp":
            return
        needs = f"link.use is {self.link.use!r}:"
        if not self.radio.ports:
            raise ValueError(f"{needs} radio.ports must name the modules' ports; `radio-config list` shows them")
        if not self.link.pairing:
            raise ValueError(f"{needs} link.pairing must name a pairing file; make one with `robot-app --new-pairing`")
        word_s = longest_word_s(self.radio.settings(0))
        if self.safety.command_silence_radio_s < word_s:
            raise ValueError(
                f"safety.command_silence_radio_s is {self.safety.command_silence_radio_s:g}, and as [radio] is set the "
                f"station is heard every {word_s:.1f} s at worst: raise it, or take a faster setting of the radios"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotConfig(CommonConfig):
    """The car-like robot, whose file has a table `[car]`."""

    car: CarGeometry
    control: ControlConfig = field(default_factory=ControlConfig)

    @property
    def body(self) -> CarGeometry:
        return self.car


@dataclass(frozen=True, slots=True, kw_only=True)
class OmniRobotConfig(CommonConfig):
    """The omnidirectional robot, whose file has a table `[omni]`."""

    omni: OmniGeometry
    control: OmniControlConfig = field(default_factory=OmniControlConfig)

    def __post_init__(self) -> None:
        CommonConfig.__post_init__(self)
        if self.devices.omni is None:
            raise ValueError("the table devices.omni must tell where the three wheels are connected")

    @property
    def body(self) -> OmniGeometry:
        return self.omni


AnyRobotConfig = RobotConfig | OmniRobotConfig


def load_config(path: Path | None) -> RobotConfig:
    """Of a car: the file at `path`, or the one that comes with the app. Raises `ConfigError`."""
    return load(path or DEFAULT_PATH, RobotConfig)


def load_any_config(path: Path | None) -> AnyRobotConfig:
    """Of whatever robot the file is for."""
    path = path or DEFAULT_PATH
    return load(path, OmniRobotConfig) if "omni" in read_table(path) else load(path, RobotConfig)
