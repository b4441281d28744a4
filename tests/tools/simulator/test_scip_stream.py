"""The simulated scanner behind the real one's wire."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from robot_app.drivers.config import ScannerConfig
from robot_app.drivers.hokuyo import HokuyoScanner
from shared.runtime.clock import MonotonicClock
from tools.simulator.devices.pty_server import PtyServer
from tools.simulator.devices.scip_sensor import ScipSensor
from tools.simulator.devices.tcp_server import TcpServer
from tools.simulator.lidar import RollingScanner
from tools.simulator.scenario import Scenario
from tools.simulator.world import World


@pytest.mark.parametrize("wire", [PtyServer, TcpServer])
def test_a_simulated_scan_is_the_same_behind_the_wire(
    room: Callable[..., Scenario], wire: type[PtyServer | TcpServer]
) -> None:
    world = World(room(), 1)
    simulated = RollingScanner(world)
    world.add_observer(simulated)
    sensor = ScipSensor(np.full(682, 1000))
    server = wire(sensor.receive)
    where = {"port": server.port} if isinstance(server, PtyServer) else {"address": server.address}
    scanner = HokuyoScanner(ScannerConfig(**where), MonotonicClock())
    try:
        np.testing.assert_allclose(scanner.geometry.angles_rad(682), simulated.geometry.angles_rad(682), atol=1e-6)
        for _ in range(5):
            world.advance_to(world.time_s + 0.1)
            cast = simulated.scans.take(0.0)
            assert cast is not None
            server.send(sensor.simulated_scan(cast.ranges_m))
            read = scanner.read(5.0)
            assert read is not None
            np.testing.assert_array_equal(read.ranges_m, cast.ranges_m)
    finally:
        scanner.close()
        server.close()
