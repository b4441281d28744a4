from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.ackermann import CarGeometry
from shared.runtime.clock import MonotonicClock
from tools.simulator.devices.pty_server import PtyServer
from tools.simulator.devices.pwm import PwmFolder
from tools.simulator.devices.realsense import Camera
from tools.simulator.devices.registers import Ads1115Chip, I2cBus, Lsm9ds1Chip, MagnetometerChip
from tools.simulator.devices.scip_sensor import ScipSensor
from tools.simulator.devices.tcp_server import TcpServer

SCIP_DATA = Path(__file__).resolve().parents[3] / ".." / "shared" / "data" / "scip"
BEAMS = 682
Plug = Callable[[ScipSensor], PtyServer]
Attach = Callable[[ScipSensor], PtyServer | TcpServer]


@pytest.fixture
def scip_data() -> Path:
    if not SCIP_DATA.is_dir():
        pytest.skip("the captured SCIP sessions are not there: ../shared/data/scip")
    return SCIP_DATA


@pytest.fixture
def values_mm() -> NDArray[np.int_]:
    """A scan with every code below 20 and every range up to the longest that two characters hold."""
    values = np.linspace(20, 4095, BEAMS).astype(np.int_)
    values[:20] = np.arange(20)
    return values


@pytest.fixture
def clock() -> MonotonicClock:
    return MonotonicClock()


@pytest.fixture
def plug() -> Iterator[Plug]:
    """Puts a sensor on a pseudo-terminal."""
    servers: list[PtyServer] = []

    def plug_in(sensor: ScipSensor, baud_rate: Callable[[], int] | None = None) -> PtyServer:
        servers.append(PtyServer(sensor.receive, baud_rate))
        return servers[-1]

    yield plug_in
    for server in servers:
        server.close()


@pytest.fixture(params=[PtyServer, TcpServer], ids=["serial port", "network"])
def attach(request: pytest.FixtureRequest) -> Iterator[Attach]:
    """Puts a sensor on a pseudo-terminal, and behind a TCP connection."""
    servers: list[PtyServer | TcpServer] = []

    def attached(sensor: ScipSensor) -> PtyServer | TcpServer:
        servers.append(request.param(sensor.receive))
        return servers[-1]

    yield attached
    for server in servers:
        server.close()


@pytest.fixture
def imu_chip() -> Lsm9ds1Chip:
    return Lsm9ds1Chip()


@pytest.fixture
def converter() -> Ads1115Chip:
    return Ads1115Chip([2.4, 1.835, 0.0, 0.0])


@pytest.fixture
def compass() -> MagnetometerChip:
    return MagnetometerChip()


@pytest.fixture
def i2c(
    monkeypatch: pytest.MonkeyPatch, imu_chip: Lsm9ds1Chip, compass: MagnetometerChip, converter: Ads1115Chip
) -> I2cBus:
    """A bus with an IMU, its magnetometer and a converter under the name of smbus2."""
    bus = I2cBus({0x6B: imu_chip, 0x1E: compass, 0x48: converter})
    monkeypatch.setitem(sys.modules, "smbus2", bus.library())
    return bus


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch) -> Camera:
    """A depth camera under the name of pyrealsense2."""
    device = Camera()
    monkeypatch.setitem(sys.modules, "pyrealsense2", device.library())
    return device


@pytest.fixture
def pwm(tmp_path: Path) -> PwmFolder:
    return PwmFolder(tmp_path)


@pytest.fixture
def car() -> CarGeometry:
    return CarGeometry(0.26, 0.17, 0.04, 0.5, 0.305, 0.045, 0.2)
