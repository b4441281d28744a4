"""What differs between the kinds of robots: their odometry, who drives them, and what their motors tell of a stall."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from robot_app.config import AnyRobotConfig, RobotConfig
from robot_app.drivers.base import DriveSetting, RawScan, Setting
from robot_app.mission import Mission
from robot_app.omni_pilot import OmniPilot, warm_up_omni
from robot_app.pilot import Pilot, PilotState, warm_up
from robot_app.safety.motors import Brake
from robot_app.safety.stall import StallConfig, StallWatch
from robot_app.sensing.odometry import Odometry, OdometryState
from shared.messages import Hello, ScanGeometry

_MOST_MOTORS = 3
_ROLLS_MPS = 0.03
_LONE_MPS = 0.02  # of a wheel that is silent while another rolls: the gyro tells a dead encoder sooner than a stall


class AnyPilot(Protocol):
    """Step it at 50 Hz."""

    @property
    def state(self) -> PilotState: ...
    def take_scan(self, scan: RawScan, geometry: ScanGeometry) -> None: ...

    def explore(self, now_s: float) -> None:
        """Note what was seen, and plan; a few times a second, in a thread of its own."""
        ...

    def step(self, now_s: float, may_move: bool) -> Setting:
        """What the motors are to do now."""
        ...

    @property
    def rolling_mps(self) -> float:
        """How fast the fastest wheel rolls, as measured; negative where that is against the last way."""
        ...

    @property
    def brake(self) -> Brake:
        """What stops it hard."""
        ...

    def cut(self) -> None:
        """The motors were cut from outside."""
        ...


@dataclass(frozen=True, slots=True)
class Platform:
    odometry: Odometry
    pilot: AnyPilot


def make_platform(config: AnyRobotConfig, mission: Mission) -> Platform:
    odometry = Odometry(config.odometry, config.body)
    if isinstance(config, RobotConfig):
        return Platform(odometry, Pilot(config.car, config.control, mission, odometry))
    return Platform(odometry, OmniPilot(config.omni, config.control, mission, odometry))


def warm_up_control(config: AnyRobotConfig, geometry: ScanGeometry) -> None:
    if isinstance(config, RobotConfig):
        warm_up(config.car, config.control, geometry)
    else:
        warm_up_omni(config.omni, config.control, geometry)


def hello_of(config: AnyRobotConfig, software_version: str) -> Hello:
    return Hello(config.name, software_version, config.body.footprint_m(), config.body.min_turning_radius_m)


class StallWatches:
    """One for each motor."""

    def __init__(self, config: StallConfig) -> None:
        self._watches = [StallWatch(config) for _ in range(_MOST_MOTORS)]

    def update(self, now_s: float, applied: Setting | None, state: OdometryState) -> bool:
        """Whether a motor is stalled. `applied`: as it was last set, None while it is cut; `state`: by the encoders."""
        if applied is None:
            for watch in self._watches:
                watch.forget()
            return False
        if isinstance(applied, DriveSetting):
            return self._watches[0].update(now_s, applied.duty, state.speed_mps)
        wheels_mps = state.wheels_mps or (0.0,) * len(applied.duties)
        least_mps = _LONE_MPS if max(map(abs, wheels_mps)) > _ROLLS_MPS else 0.0
        motors = zip(self._watches, applied.duties, wheels_mps, strict=True)
        stalled = [watch.update(now_s, duty, max(abs(speed), least_mps)) for watch, duty, speed in motors]
        return any(stalled)

    @property
    def free_mps(self) -> float:
        """How fast the wheels turn that may turn unseen; along the last way for more than one."""
        first, *others = (watch.free_mps for watch in self._watches)
        return max(map(abs, (first, *others))) if any(others) else first
