"""What only a scanner at the network has: an address, a connection that is refused, ends and comes back."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.drivers.base import DeviceError
from robot_app.drivers.config import ScannerConfig
from robot_app.drivers.hokuyo import HokuyoScanner
from robot_app.drivers.tcp_line import TcpLine
from shared.runtime.clock import ManualClock, MonotonicClock
from tools.simulator.devices.scip_sensor import UST_10LX, ScipSensor
from tools.simulator.devices.tcp_server import TcpServer

Values = NDArray[np.int_]
ROOM_MM = np.full(1081, 6000)


@pytest.fixture
def servers() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def served(servers: ExitStack, sensor: ScipSensor, port: int = 0) -> TcpServer:
    server = TcpServer(sensor.receive, port)
    servers.callback(server.close)
    return server


def test_a_scanner_that_starts_again_is_found_at_its_address(servers: ExitStack) -> None:
    clock = ManualClock()
    first = served(servers, ScipSensor(ROOM_MM, UST_10LX))
    scanner = HokuyoScanner(ScannerConfig(address=first.address, range_max_m=10.0), clock)
    first.unplug()
    with pytest.raises(DeviceError, match=r"closed the connection|lost while reading"):
        scanner.read(0.5)
    for _ in range(2):
        clock.advance(0.6)
        with pytest.raises(DeviceError, match="refuses the connection"):
            scanner.read(0.01)
    sensor = ScipSensor(ROOM_MM, UST_10LX)
    second = served(servers, sensor, int(first.address.rpartition(":")[2]))
    clock.advance(0.6)
    assert scanner.read(0.0) is None
    second.send(sensor.scan(ROOM_MM - 1000))
    scan = scanner.read(5.0)
    assert scan is not None
    assert np.all(scan.ranges_m == np.float32(5))
    scanner.close()


def test_the_stamp_does_not_wait_for_a_slow_line(servers: ExitStack) -> None:
    clock = ManualClock(100.0)
    sensor = ScipSensor(ROOM_MM, UST_10LX)
    server = served(servers, sensor)
    scanner = HokuyoScanner(ScannerConfig(address=server.address), clock)
    clock.advance(0.028)
    server.send(sensor.scan(ROOM_MM))
    scan = scanner.read(5.0)
    assert scan is not None
    assert scan.stamp_s == pytest.approx(100.028 - 1080 / 1440 * 0.025 - 0.0005, abs=1e-4)
    scanner.close()


def test_rates_are_not_tried(servers: ExitStack) -> None:
    sensor = ScipSensor(ROOM_MM, UST_10LX)
    server = served(servers, sensor)
    server.is_silent = True
    clock = ManualClock()
    with pytest.raises(DeviceError, match=r"127\.0\.0\.1:\d+: no scanner answers"):
        HokuyoScanner(ScannerConfig(address=server.address, answer_timeout_s=0.01), clock)
    server.is_silent = False
    HokuyoScanner(ScannerConfig(address=server.address), clock).close()
    assert not [request for request in sensor.requests if request.startswith(b"SS")]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (TimeoutError("timed out"), "does not answer; is it on"),
        (ConnectionRefusedError(111, "refused"), "10940"),
        (OSError(113, "No route to host"), "No route to host; is that its address?"),
        (socket.gaierror(-2, "Name or service not known"), "is that its address?"),
    ],
)
def test_why_nobody_is_there_is_told(monkeypatch: pytest.MonkeyPatch, error: OSError, words: str) -> None:
    def fail(*_: object) -> socket.socket:
        raise error

    monkeypatch.setattr(socket, "create_connection", fail)
    with pytest.raises(DeviceError, match=words):
        HokuyoScanner(ScannerConfig(address="192.168.0.10:10940"), MonotonicClock())


def test_a_line_that_was_closed_says_so(servers: ExitStack) -> None:
    line = TcpLine("scanner", served(servers, ScipSensor(None)).address, 1.0)
    assert line.read(0.0) == b""
    line.close()
    with pytest.raises(DeviceError, match="lost while reading"):
        line.read(0.0)
    with pytest.raises(DeviceError, match="lost while writing"):
        line.write(b"QT\n")


@pytest.mark.parametrize("address", ["192.168.0.10", ":10940", "192.168.0.10:", "192.168.0.10:http", "a:70000"])
def test_a_wrong_address_is_named(address: str) -> None:
    with pytest.raises(ValueError, match="address must be like"):
        ScannerConfig(address=address)
