"""The simulated devices behind the robot's driver protocols.

Two ways to run: lock-step, where somebody else advances the world and a read answers at once, and real time,
where a pump advances it and a read waits.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

import numpy as np

from robot_app.drivers.base import (
    Count,
    DepthImage,
    DeviceError,
    Hardware,
    ImuSample,
    PowerSample,
    RawScan,
    Setting,
    TemperatureSample,
)
from shared.geometry.camera import Intrinsics
from shared.messages import ScanGeometry
from shared.runtime.clock import Clock
from tools.simulator.depth_camera import DepthRenderer, DepthSensor, ExposureClock
from tools.simulator.gauges import SimulatedEncoders, SimulatedPowerMonitor, SimulatedThermometer
from tools.simulator.imu import SimulatedImu
from tools.simulator.lidar import RollingScanner
from tools.simulator.mailbox import Mailbox
from tools.simulator.slip import WheelSlip
from tools.simulator.world import World

_PUMP_PERIOD_S = 0.004
_MAX_CATCH_UP_S = 0.1  # after a longer pause of the machine the world stands still for the rest of it
_JOIN_TIMEOUT_S = 3.0

T = TypeVar("T")


class _Stamped(Protocol):
    @property
    def stamp_s(self) -> float: ...


StampedT = TypeVar("StampedT", bound=_Stamped)


class _MailboxDriver(Generic[T]):
    """A device that sends samples by itself."""

    def __init__(self, name: str, mailbox: Mailbox[T], waits: bool) -> None:
        self._name = name
        self._mailbox = mailbox
        self._waits = waits
        self._open = True

    def read(self, timeout_s: float) -> T | None:
        if not self._open:
            raise DeviceError(f"{self._name}: is closed")
        return self._mailbox.take(timeout_s if self._waits else 0.0)

    def close(self) -> None:
        self._open = False


class ScannerDriver(_MailboxDriver[RawScan]):
    def __init__(self, scanner: RollingScanner, waits: bool) -> None:
        super().__init__("scanner", scanner.scans, waits)
        self._geometry = scanner.geometry

    @property
    def geometry(self) -> ScanGeometry:
        return self._geometry


class CameraDriver:
    """Renders the newest frame in the thread that reads."""

    def __init__(self, world: World, exposures: ExposureClock, waits: bool) -> None:
        self._exposures = exposures.exposures
        self._waits = waits
        parameters = world.scenario.camera
        self._renderer: DepthRenderer | None = DepthRenderer(world.model, parameters)
        self._sensor = DepthSensor(parameters, world.seed)
        self._inverse_per_m = np.empty((parameters.height, parameters.width), np.float32)
        self._lock = threading.Lock()

    @property
    def intrinsics(self) -> Intrinsics:
        return self._sensor.intrinsics

    def read(self, timeout_s: float) -> DepthImage | None:
        exposure = self._exposures.take(timeout_s if self._waits else 0.0)
        with self._lock:
            if self._renderer is None:
                raise DeviceError("depth camera: is closed")
            if exposure is None:
                return None
            self._renderer.render(exposure.state, self._inverse_per_m)
            return self._sensor.image(self._inverse_per_m, exposure.index, exposure.stamp_s)

    def close(self) -> None:
        with self._lock:
            if self._renderer is not None:
                self._renderer.close()
                self._renderer = None


class _AskedDriver(Generic[StampedT]):
    """A device that is sampled when it is read; one moment gives one sample."""

    def __init__(self, name: str, world: World, sample: Callable[[], StampedT], waits: bool) -> None:
        self._name = name
        self._world = world
        self._sample = sample
        self._waits = waits
        self._open = True
        self._last_s = float("-inf")

    def read(self, timeout_s: float) -> StampedT | None:
        if not self._open:
            raise DeviceError(f"{self._name}: is closed")
        with self._world.moved:
            if self._waits and timeout_s > 0:
                self._world.moved.wait_for(self._has_moved, timeout_s)
            if not self._has_moved():
                return None
            sample = self._sample()
            self._last_s = sample.stamp_s
            return sample

    def close(self) -> None:
        self._open = False

    def _has_moved(self) -> bool:
        return self._world.time_s > self._last_s


class DriveDriver:
    def __init__(self, world: World) -> None:
        self._world = world
        self._open = True

    def set(self, setting: Setting) -> Setting:
        if not self._open:
            raise DeviceError("drive: is closed")
        if not setting.is_finite:
            raise DeviceError(f"drive: cannot apply {setting}")
        return self._world.set_drive(setting)

    def stop(self) -> None:
        self._world.cut_motor()

    def close(self) -> None:
        self.stop()
        self._open = False


class SimulatedHardware:
    """All devices of one world. `waits`: whether a read waits for its sample, which needs a `RealTimePump`."""

    def __init__(self, world: World, waits: bool) -> None:
        self.world = world
        scanner, exposures = RollingScanner(world), ExposureClock(world)
        self.imu = imu = SimulatedImu(world)
        self.slip = WheelSlip(world)
        for observer in (scanner, imu, exposures, self.slip):
            world.add_observer(observer)
        encoders: _AskedDriver[Count] = _AskedDriver(
            "encoders", world, SimulatedEncoders(world, self.slip).sample, waits
        )
        power: _AskedDriver[PowerSample] = _AskedDriver("power", world, SimulatedPowerMonitor(world).sample, waits)
        thermometer: _AskedDriver[TemperatureSample] = _AskedDriver(
            "thermometer", world, SimulatedThermometer(world).sample, waits
        )
        imu_driver: _MailboxDriver[ImuSample] = _MailboxDriver("imu", imu.samples, waits)
        self.hardware = Hardware(
            scanner=ScannerDriver(scanner, waits),
            camera=CameraDriver(world, exposures, waits),
            imu=imu_driver,
            encoders=encoders,
            power=power,
            thermometer=thermometer,
            drive=DriveDriver(world),
        )


class RealTimePump:
    """A thread that moves the world with the robot's clock."""

    def __init__(self, world: World, clock: Clock) -> None:
        self._world = world
        self._clock = clock
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="simulator", daemon=True)

    def start(self) -> None:
        self._world.set_clock(self._clock.now_s())
        self._thread.start()

    def stop(self) -> bool:
        """End the thread; False when it did not end in time."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(_JOIN_TIMEOUT_S)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._stop.is_set():
            now_s = self._clock.now_s()
            behind_s = now_s - self._world.time_s
            if behind_s > _MAX_CATCH_UP_S:
                self._world.stand_still(behind_s - _MAX_CATCH_UP_S)
            self._world.advance_to(now_s)
            self._clock.wait(self._stop, now_s + _PUMP_PERIOD_S)
