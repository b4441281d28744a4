"""All devices of the car, each on its emulated wire, under the names of the libraries that the drivers load."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.config import (
    DepthCameraConfig,
    DeviceConfig,
    DriveConfig,
    ScannerConfig,
    ThermometerConfig,
)
from tools.simulator.devices.gpio import GpioChip
from tools.simulator.devices.pty_server import PtyServer
from tools.simulator.devices.pwm import PwmFolder
from tools.simulator.devices.realsense import Camera
from tools.simulator.devices.registers import Ads1115Chip, I2cBus, Lsm9ds1Chip, MagnetometerChip
from tools.simulator.devices.scip_sensor import Mode, ScipSensor

_BEAMS = 682
_PERIOD_S = 0.02
_JOIN_TIMEOUT_S = 3.0


class EmulatedRobot:
    """`keeps_measuring`: scanner, IMU and camera send by themselves, the room stays as it is."""

    def __init__(self, folder: Path) -> None:
        self.sensor = ScipSensor(np.full(_BEAMS, 2000))
        self.scanner = PtyServer(self.sensor.receive)
        self.imu = Lsm9ds1Chip()
        self.magnetometer = MagnetometerChip()
        self.i2c = I2cBus({0x6B: self.imu, 0x1E: self.magnetometer, 0x48: Ads1115Chip([2.4, 1.65, 0.0, 0.0])})
        self.gpio = GpioChip()
        self.camera = Camera()
        self.pwm = PwmFolder(folder, channels=3)  # a car has two motors, an omnidirectional robot three
        self._zone = folder / "temp"
        self._zone.write_text("48700\n", "ascii")
        self.keeps_measuring = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="emulated robot", daemon=True)
        self._thread.start()

    @property
    def libraries(self) -> dict[str, SimpleNamespace]:
        gpiod = self.gpio.library()
        return {
            "smbus2": self.i2c.library(),
            "gpiod": gpiod,
            "gpiod.line": gpiod.line,
            "pyrealsense2": self.camera.library(),
        }

    @property
    def config(self) -> DeviceConfig:
        return DeviceConfig(
            scanner=ScannerConfig(self.scanner.port, answer_timeout_s=0.2),
            drive=DriveConfig(pwm_chip=str(self.pwm.path)),
            thermometer=ThermometerConfig(
                str(self._zone), str(self._zone.parent), str(self._zone.with_name("get_throttled"))
            ),
            camera=DepthCameraConfig(start_up_s=2.0),
        )

    @property
    def is_released(self) -> bool:
        """Nothing is open any more, and the motor gets nothing."""
        quiet = not self.pwm.path.is_dir() or (self.pwm.value(1, "duty_cycle"), self.pwm.value(1, "enable")) == (0, 0)
        return (
            quiet and self.i2c.open_handles == 0 and not self.gpio.requests and self.camera.starts == self.camera.stops
        )

    def send_scan(self, values_mm: NDArray[np.int_]) -> None:
        self.scanner.send(self.sensor.scan(values_mm))

    def remove(self, name: str) -> None:
        """Take a device away before the app starts."""
        away: dict[str, Callable[[], object]] = {
            "drive": lambda: self.pwm.path.rename(self.pwm.path.with_name("gone")),
            "thermometer": self._zone.unlink,
            "power": lambda: self.i2c.chips.pop(0x48),
            "imu": lambda: self.i2c.chips.pop(0x6B),
            "magnetometer": lambda: self.i2c.chips.pop(0x1E),
            "encoders": lambda: self.gpio.used.add(5),
            "scanner": self.scanner.unplug,
            "camera": lambda: setattr(self.camera, "fault", "No device connected"),
        }
        away[name]()

    def close(self) -> None:
        self._stop.set()
        self._thread.join(_JOIN_TIMEOUT_S)
        self.scanner.close()

    def _run(self) -> None:
        room_mm, depth, ticks = np.full(_BEAMS, 2000), np.full((480, 640), 8000, np.uint16), 0
        while not self._stop.wait(_PERIOD_S):
            if self.keeps_measuring:
                ticks += 1
                if self.sensor.mode is Mode.STREAMING:
                    self.send_scan(room_mm)
                self.imu.sample((0, 0, 0), (0, 0, 16_393))
                self.magnetometer.sample((-2143, 0, -2500))  # 30 µT to the north, which is ahead, and 35 down
                self.camera.send(depth, ticks * _PERIOD_S * 1000)
