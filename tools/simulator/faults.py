"""Devices that fail on demand, for the tests of everything that must survive it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Generic, Protocol, TypeVar, cast

import numpy as np

from robot_app.drivers.base import (
    Count,
    DepthCamera,
    DepthImage,
    DeviceError,
    Drive,
    Hardware,
    ImuSample,
    PowerSample,
    RawScan,
    Scanner,
    Setting,
    TemperatureSample,
)
from shared.geometry.camera import Intrinsics
from shared.messages import ScanGeometry

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class FaultKind(Enum):
    NONE = "none"
    SILENT = "silent"  # the device sends nothing
    UNPLUGGED = "unplugged"  # the device is gone
    FROZEN = "frozen"  # the device sends its last sample again and again, with new stamps
    BLIND = "blind"  # the scanner is covered: scans without an echo


@dataclass(slots=True)
class Fault:
    """The fault of one device; may be changed at any time, from any thread."""

    kind: FaultKind = FaultKind.NONE
    change: Callable[[Any], Any] | None = None  # what it makes of each sample

    def check(self, name: str) -> bool:
        """Whether the device answers; raises when it is gone."""
        if self.kind is FaultKind.UNPLUGGED:
            raise DeviceError(f"{name}: is unplugged")
        return self.kind is not FaultKind.SILENT


@dataclass(frozen=True, slots=True)
class Faults:
    """The fault of each device."""

    scanner: Fault = field(default_factory=Fault)
    camera: Fault = field(default_factory=Fault)
    imu: Fault = field(default_factory=Fault)
    encoders: Fault = field(default_factory=Fault)
    power: Fault = field(default_factory=Fault)
    thermometer: Fault = field(default_factory=Fault)
    drive: Fault = field(default_factory=Fault)


class _Reader(Protocol[T_co]):
    def read(self, timeout_s: float) -> T_co | None: ...
    def close(self) -> None: ...


def _with_stamp_of(old: T, new: T) -> T:
    """Every sample is a dataclass with a stamp."""
    stamped: T = cast("Any", replace)(old, stamp_s=cast("Any", new).stamp_s)
    return stamped


class _FaultyReader(Generic[T]):
    def __init__(self, name: str, inner: _Reader[T], fault: Fault) -> None:
        self._name = name
        self._inner = inner
        self._fault = fault
        self._last: T | None = None

    def read(self, timeout_s: float) -> T | None:
        """A silent device uses up the time as a real one does; what it would have sent is lost."""
        answers = self._fault.check(self._name)
        sample = self._inner.read(timeout_s)
        if not answers or sample is None:
            return None
        if self._fault.kind is FaultKind.FROZEN and self._last is not None:
            return _with_stamp_of(self._last, sample)
        self._last = sample
        return sample if self._fault.change is None else cast("T", self._fault.change(sample))

    def close(self) -> None:
        self._inner.close()


class FaultyScanner(_FaultyReader[RawScan]):
    def __init__(self, inner: Scanner, fault: Fault) -> None:
        super().__init__("scanner", inner, fault)
        self._geometry = inner.geometry

    @property
    def geometry(self) -> ScanGeometry:
        return self._geometry

    def read(self, timeout_s: float) -> RawScan | None:
        scan = super().read(timeout_s)
        if scan is not None and self._fault.kind is FaultKind.BLIND:
            return replace(scan, ranges_m=np.full_like(scan.ranges_m, np.nan))
        return scan


class FaultyCamera(_FaultyReader[DepthImage]):
    def __init__(self, inner: DepthCamera, fault: Fault) -> None:
        super().__init__("depth camera", inner, fault)
        self._intrinsics = inner.intrinsics

    @property
    def intrinsics(self) -> Intrinsics:
        return self._intrinsics


class FaultyDrive:
    """An unplugged bridge lets no current through: the motor stops."""

    def __init__(self, inner: Drive, fault: Fault) -> None:
        self._inner = inner
        self._fault = fault

    def set(self, setting: Setting) -> Setting:
        if self._fault.kind is not FaultKind.NONE:
            self._inner.stop()
        self._fault.check("drive")
        if self._fault.kind is FaultKind.SILENT:
            return setting.without_power()
        return self._inner.set(setting)

    def stop(self) -> None:
        self._inner.stop()

    def close(self) -> None:
        self._inner.close()


def with_faults(hardware: Hardware) -> tuple[Hardware, Faults]:
    """The same devices with a switch for the fault of each."""
    faults = Faults()
    imu: _FaultyReader[ImuSample] = _FaultyReader("imu", hardware.imu, faults.imu)
    encoders: _FaultyReader[Count] = _FaultyReader("encoders", hardware.encoders, faults.encoders)
    power: _FaultyReader[PowerSample] = _FaultyReader("power", hardware.power, faults.power)
    thermometer: _FaultyReader[TemperatureSample] = _FaultyReader(
        "thermometer", hardware.thermometer, faults.thermometer
    )
    faulty = replace(
        hardware,
        scanner=FaultyScanner(hardware.scanner, faults.scanner),
        camera=FaultyCamera(hardware.camera, faults.camera),
        imu=imu,
        encoders=encoders,
        power=power,
        thermometer=thermometer,
        drive=FaultyDrive(hardware.drive, faults.drive),
    )
    return faulty, faults
