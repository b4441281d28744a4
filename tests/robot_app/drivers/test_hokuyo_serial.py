"""What only a scanner at a serial port has: baud rates, a lock, a name that stays when the device behind it changes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.drivers.base import DeviceError, RawScan
from robot_app.drivers.config import ScannerConfig
from robot_app.drivers.hokuyo import HokuyoScanner
from shared.runtime.clock import ManualClock, MonotonicClock
from tools.simulator.devices.pty_server import PtyServer
from tools.simulator.devices.scip_sensor import Mode, ScipSensor

PATIENCE_S = 5.0
Values = NDArray[np.int_]


def config(server: PtyServer, **changes: float) -> ScannerConfig:
    return ScannerConfig(server.port, **{"silence_s": 0.2, "reopen_every_s": 0.001, "start_up_s": 3.0} | changes)


def read(scanner: HokuyoScanner) -> RawScan:
    scan = scanner.read(PATIENCE_S)
    assert scan is not None
    return scan


def test_the_stamp_is_that_of_beam_zero(plug, values_mm: Values) -> None:
    clock = ManualClock(100.0)
    sensor = ScipSensor(values_mm)
    server = plug(sensor)
    scanner = HokuyoScanner(config(server, baud_rate=500_000), clock)
    clock.advance(0.028)
    server.send(sensor.scan(values_mm))
    scan = read(scanner)
    sweep_s, transfer_s = 681 / 1024 * 60 / 2142, 1435 * 10 / 500_000
    assert scan.stamp_s == pytest.approx(100.028 - sweep_s - transfer_s, abs=1e-4)
    scanner.close()


def test_a_scanner_at_another_rate_is_found_and_set(plug, clock: MonotonicClock, values_mm: Values) -> None:
    sensor = ScipSensor(values_mm)
    server = plug(sensor, lambda: sensor.baud_rate or 19_200)
    scanner = HokuyoScanner(config(server, baud_rate=500_000, answer_timeout_s=0.1), clock)
    assert b"SS500000" in sensor.requests
    server.send(sensor.scan(values_mm))
    np.testing.assert_array_equal(read(scanner).ranges_m[20:], (values_mm[20:] / 1000).astype(np.float32))
    scanner.close()


def test_a_scanner_that_lost_its_power_is_found_at_its_old_rate(plug, values_mm: Values) -> None:
    clock = ManualClock()
    sensor = ScipSensor(values_mm)
    server = plug(sensor, lambda: sensor.baud_rate or 19_200)
    scanner = HokuyoScanner(config(server, baud_rate=500_000, answer_timeout_s=0.1), clock)
    sensor.mode, sensor.baud_rate = Mode.IDLE, None
    clock.advance(0.05)
    scanner.read(0.0)
    clock.advance(0.09)
    scanner.read(0.0)
    clock.advance(0.09)
    with pytest.raises(DeviceError, match="no good scan"):
        scanner.read(0.0)
    clock.advance(1.0)
    scanner.read(0.0)
    server.send(sensor.scan(np.full(682, 666)))
    assert np.all(read(scanner).ranges_m == np.float32(0.666))
    assert sensor.requests.count(b"SS500000") == 2
    scanner.close()


def test_a_scanner_that_is_plugged_in_again_is_found(plug, tmp_path: Path, values_mm: Values) -> None:
    """The name of the port stays, as below /dev/serial/by-id, the device behind it is a new one."""
    clock = ManualClock()
    first = plug(ScipSensor(values_mm))
    port = tmp_path / "usb-Hokuyo"
    port.symlink_to(first.port)
    scanner = HokuyoScanner(ScannerConfig(str(port), reopen_every_s=0.5), clock)
    first.unplug()
    port.unlink()
    for _ in range(3):
        with pytest.raises(DeviceError, match=r"usb-Hokuyo: .*plugged in\?"):
            scanner.read(0.01)
        clock.advance(0.6)
    sensor = ScipSensor(values_mm)
    second = plug(sensor)
    port.symlink_to(second.port)
    assert scanner.read(0.0) is None
    second.send(sensor.scan(np.full(682, 444)))
    assert np.all(read(scanner).ranges_m == np.float32(0.444))
    scanner.close()


def test_a_missing_port_is_named(clock: MonotonicClock) -> None:
    with pytest.raises(DeviceError, match="/dev/ttyACM77: there is no such port"):
        HokuyoScanner(ScannerConfig("/dev/ttyACM77"), clock)


def test_a_port_in_use_is_named(plug, clock: MonotonicClock, values_mm: Values) -> None:
    server = plug(ScipSensor(values_mm))
    scanner = HokuyoScanner(config(server), clock)
    with pytest.raises(DeviceError, match="another program uses it"):
        HokuyoScanner(config(server), clock)
    scanner.close()
