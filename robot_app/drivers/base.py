"""What the robot app asks of its devices.

A driver opens its device in its constructor or raises `DeviceError`; it owns no thread and does not retry:
rates and retries belong to the runtime. `read(timeout_s)` returns the newest sample that was not returned
before, or None when none came in time. `close()` may be called twice.
All stamps are of the clock that the driver was given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from shared.geometry.camera import Intrinsics
from shared.messages import ScanGeometry


class DeviceError(Exception):
    """A device could not be opened, did not answer or was lost; the text names it."""


class DeviceBusyError(DeviceError):
    """Another program has the device."""


@dataclass(frozen=True, slots=True, eq=False)
class RawScan:
    """`ranges_m`: (B,) float32, NaN where nothing was measured; `stamp_s` is that of beam 0."""

    stamp_s: float
    ranges_m: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class DepthImage:
    """`depth`: (H, W) uint16 in units of `unit_m`, the distance along the optical axis; 0 means none."""

    stamp_s: float
    depth: NDArray[np.uint16]
    unit_m: float


@dataclass(frozen=True, slots=True)
class ImuSample:
    """Robot axes: x forward, y left, z up."""

    stamp_s: float
    gyro_radps: tuple[float, float, float]
    acceleration_mps2: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class EncoderCount:
    """Ticks of both rear wheels since the driver was opened; forward counts up."""

    stamp_s: float
    left: int
    right: int


@dataclass(frozen=True, slots=True)
class OmniCount:
    """Ticks of the three wheels of an omnidirectional robot, in the order and direction of `OmniGeometry`."""

    stamp_s: float
    wheels: tuple[int, int, int]


Count = EncoderCount | OmniCount


@dataclass(frozen=True, slots=True)
class PowerSample:
    stamp_s: float
    battery_v: float
    motor_current_a: float


@dataclass(frozen=True, slots=True)
class TemperatureSample:
    """`throttling`: what holds the processor back now, in words; `fan`: whether it turns, None where nobody knows."""

    stamp_s: float
    cpu_c: float
    throttling: tuple[str, ...] = ()
    fan: bool | None = None


@dataclass(frozen=True, slots=True)
class DriveSetting:
    """`duty` in [-1, 1] of the H-bridge, positive forward; `steering_rad` positive to the left."""

    duty: float
    steering_rad: float

    @property
    def is_finite(self) -> bool:
        return math.isfinite(self.duty) and math.isfinite(self.steering_rad)

    def without_power(self) -> DriveSetting:
        return DriveSetting(0.0, self.steering_rad)


@dataclass(frozen=True, slots=True)
class OmniSetting:
    """`duties` in [-1, 1] of the three H-bridges, in the order and direction of `OmniGeometry`."""

    duties: tuple[float, float, float]

    @property
    def duty(self) -> float:
        """The largest of them."""
        return max(self.duties, key=abs)

    @property
    def is_finite(self) -> bool:
        return all(map(math.isfinite, self.duties))

    def without_power(self) -> OmniSetting:
        return OmniSetting((0.0, 0.0, 0.0))


Setting = DriveSetting | OmniSetting


class Scanner(Protocol):
    @property
    def geometry(self) -> ScanGeometry: ...
    def read(self, timeout_s: float) -> RawScan | None: ...
    def close(self) -> None: ...


class DepthCamera(Protocol):
    @property
    def intrinsics(self) -> Intrinsics: ...
    def read(self, timeout_s: float) -> DepthImage | None: ...
    def close(self) -> None: ...


class Imu(Protocol):
    def read(self, timeout_s: float) -> ImuSample | None: ...
    def close(self) -> None: ...


class Encoders(Protocol):
    def read(self, timeout_s: float) -> Count | None: ...
    def close(self) -> None: ...


class PowerMonitor(Protocol):
    def read(self, timeout_s: float) -> PowerSample | None: ...
    def close(self) -> None: ...


class Thermometer(Protocol):
    def read(self, timeout_s: float) -> TemperatureSample | None: ...
    def close(self) -> None: ...


class Drive(Protocol):
    def set(self, setting: Setting) -> Setting:
        """Apply `setting`; returns what was applied after limits. One of another kind of robot is a `DeviceError`."""
        ...

    def stop(self) -> None:
        """Cut the motor. Never raises."""
        ...

    def close(self) -> None: ...


@runtime_checkable
class Counting(Protocol):
    """A device that loses something now and then without failing."""

    @property
    def losses(self) -> dict[str, int]:
        """Since it was opened, by their names."""
        ...


@dataclass(frozen=True, slots=True)
class Hardware:
    """All devices of a robot."""

    scanner: Scanner
    camera: DepthCamera
    imu: Imu
    encoders: Encoders
    power: PowerMonitor
    thermometer: Thermometer
    drive: Drive

    @property
    def losses(self) -> tuple[tuple[str, int], ...]:
        """Of those devices that count them; names and numbers."""
        devices = (self.scanner, self.camera, self.imu, self.encoders, self.power, self.thermometer)
        return tuple(item for device in devices if isinstance(device, Counting) for item in device.losses.items())

    def close(self) -> None:
        self.drive.stop()
        for device in (
            self.drive,
            self.scanner,
            self.camera,
            self.imu,
            self.encoders,
            self.power,
            self.thermometer,
        ):
            device.close()
