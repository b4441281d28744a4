"""The simulator in a process of its own, and drivers that talk to it: what the app takes is then the app's alone."""

from __future__ import annotations

import math
import multiprocessing
import os
import threading
import time
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

from robot_app.drivers.base import (
    DepthImage,
    DeviceError,
    DriveSetting,
    EncoderCount,
    Hardware,
    ImuSample,
    PowerSample,
    RawScan,
    Setting,
    TemperatureSample,
)
from shared.geometry.camera import Intrinsics
from shared.messages import ScanGeometry
from tools.simulator.drivers import RealTimePump, SimulatedHardware
from tools.simulator.scenario import find_scenario
from tools.simulator.world import World

_READERS = ("scanner", "camera", "imu", "encoders", "power", "thermometer")
_WAIT_S = 0.1
_STARTS_WITHIN_S = 60.0
_ENDS_WITHIN_S = 10.0
_NICE = 5  # the robot's processor has no simulator beside it

T = TypeVar("T")


class SharedClock:
    """Seconds since `start_s` of the system's monotonic clock, the same in every process."""

    def __init__(self, start_s: float) -> None:
        self._start_s = start_s

    def now_s(self) -> float:
        return time.monotonic() - self._start_s

    def wait(self, stop: threading.Event, until_s: float) -> bool:
        return stop.wait(max(0.0, until_s - self.now_s()))


@dataclass(frozen=True, slots=True)
class _Ends:
    """Of the pipes, one for each device."""

    readers: dict[str, Connection]
    drive: Connection
    control: Connection  # geometry and lens at the beginning; its end is the simulator's


class _RemoteReader(Generic[T]):
    def __init__(self, name: str, pipe: Connection) -> None:
        self._name = name
        self._pipe = pipe

    def read(self, timeout_s: float) -> T | None:
        try:
            if not self._pipe.poll(timeout_s):
                return None
            sample: T = self._pipe.recv()
            while self._pipe.poll(0.0):
                sample = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise DeviceError(f"{self._name}: the simulator has ended") from error
        return sample

    def close(self) -> None:
        self._pipe.close()


class _RemoteScanner(_RemoteReader[RawScan]):
    def __init__(self, pipe: Connection, geometry: ScanGeometry) -> None:
        super().__init__("scanner", pipe)
        self.geometry = geometry


class _RemoteCamera(_RemoteReader[DepthImage]):
    def __init__(self, pipe: Connection, intrinsics: Intrinsics) -> None:
        super().__init__("camera", pipe)
        self.intrinsics = intrinsics


class _RemoteDrive:
    def __init__(self, pipe: Connection, max_steering_rad: float) -> None:
        self._pipe = pipe
        self._max_steering_rad = max_steering_rad

    def set(self, setting: Setting) -> Setting:
        if not isinstance(setting, DriveSetting):
            raise DeviceError(f"drive: cannot apply {setting}")
        limit = self._max_steering_rad
        duty = max(-1.0, min(1.0, setting.duty))
        applied = DriveSetting(duty, max(-limit, min(limit, setting.steering_rad)))
        self._send(applied)
        return applied

    def stop(self) -> None:
        try:
            self._send(None)
        except DeviceError:
            return

    def close(self) -> None:
        self.stop()
        self._pipe.close()

    def _send(self, order: DriveSetting | None) -> None:
        try:
            self._pipe.send(order)
        except OSError as error:
            raise DeviceError("drive: the simulator has ended") from error


class RemoteSimulator:
    """Starts it; `hardware` is that of the robot in it. `close` ends it, and so does the end of this process."""

    def __init__(self, scenario: str, seed: int, start_s: float) -> None:
        context = multiprocessing.get_context("spawn")
        pipes = {name: context.Pipe(duplex=False) for name in _READERS}
        drive_there, drive_here = context.Pipe(duplex=False)
        self._control, control_there = context.Pipe()
        there = _Ends({name: pipe[1] for name, pipe in pipes.items()}, drive_there, control_there)
        self._process = context.Process(
            target=_serve, args=(scenario, seed, start_s, there), name="simulator", daemon=True
        )
        self._process.start()
        for end in (*there.readers.values(), drive_there, control_there):
            end.close()
        if not self._control.poll(_STARTS_WITHIN_S):
            raise DeviceError("the simulator does not start")
        geometry, intrinsics = self._control.recv()
        here = {name: pipe[0] for name, pipe in pipes.items()}
        imu: _RemoteReader[ImuSample] = _RemoteReader("imu", here["imu"])
        encoders: _RemoteReader[EncoderCount] = _RemoteReader("encoders", here["encoders"])
        power: _RemoteReader[PowerSample] = _RemoteReader("power", here["power"])
        thermometer: _RemoteReader[TemperatureSample] = _RemoteReader("thermometer", here["thermometer"])
        self.hardware = Hardware(
            scanner=_RemoteScanner(here["scanner"], geometry),
            camera=_RemoteCamera(here["camera"], intrinsics),
            imu=imu,
            encoders=encoders,
            power=power,
            thermometer=thermometer,
            drive=_RemoteDrive(drive_here, find_scenario(scenario).car.max_steering_rad),
        )

    @property
    def process_id(self) -> int:
        assert self._process.pid is not None
        return self._process.pid

    def start(self) -> None:
        """Let the world move."""
        self._control.send("start")

    def close(self) -> dict[str, float]:
        """What it says of itself at its end."""
        try:
            self._control.send("end")
            said: dict[str, float] = self._control.recv() if self._control.poll(_ENDS_WITHIN_S) else {}
        except (OSError, EOFError):
            said = {}
        self._process.join(_ENDS_WITHIN_S)
        if self._process.is_alive():
            self._process.kill()
        return said


def _serve(scenario: str, seed: int, start_s: float, ends: _Ends) -> None:
    os.nice(_NICE)
    clock = SharedClock(start_s)
    world = World(find_scenario(scenario), seed, start_s=clock.now_s())
    hardware = SimulatedHardware(world, waits=True).hardware
    ends.control.send((hardware.scanner.geometry, hardware.camera.intrinsics))
    try:
        ends.control.recv()
    except EOFError:
        return
    pump, stop = RealTimePump(world, clock), threading.Event()
    pump.start()
    threads = [
        threading.Thread(target=_forward, args=(hardware, ends, name, stop), name=name, daemon=True)
        for name in ("scanner", "camera", "imu", "power", "thermometer")
    ]
    threads.append(threading.Thread(target=_obey, args=(hardware, ends.drive, stop), name="drive", daemon=True))
    for thread in threads:
        thread.start()
    ended_by_word = _wait_for_end(ends.control)
    stop.set()
    pump.stop()
    for thread in threads:
        thread.join(_ENDS_WITHIN_S)
    if ended_by_word:
        stood = {"world_stood_still_s": world.slipped_s, "collisions": float(world.collisions.count)}
        ends.control.send({**stood, "driven_m": world.truth.distance_m, "processor_s": time.process_time()})


def _wait_for_end(control: Connection) -> bool:
    try:
        control.recv()
    except (EOFError, OSError):
        return False
    return True


def _forward(hardware: Hardware, ends: _Ends, name: str, stop: threading.Event) -> None:
    """Encoders are counted with each sample of the IMU: asked for, they would send at the pump's rate."""
    device: Any = getattr(hardware, name)
    while not stop.is_set():
        sample = device.read(_WAIT_S)
        try:
            if sample is not None:
                ends.readers[name].send(sample)
            if name == "imu" and (count := hardware.encoders.read(0.0)) is not None:
                ends.readers["encoders"].send(replace(count))
        except OSError:
            return
        if name in {"power", "thermometer"}:
            stop.wait(_WAIT_S if name == "power" else 1.0)


def _obey(hardware: Hardware, pipe: Connection, stop: threading.Event) -> None:
    while not stop.is_set():
        try:
            if not pipe.poll(_WAIT_S):
                continue
            order: DriveSetting | None = pipe.recv()
        except (EOFError, OSError):
            hardware.drive.stop()
            return
        if order is None:
            hardware.drive.stop()
        elif math.isfinite(order.duty):
            hardware.drive.set(order)
