"""The contract of the scanner's driver, against a scanner at a serial port and one at the network."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.drivers.base import DeviceError, RawScan
from robot_app.drivers.config import ScannerConfig
from robot_app.drivers.hokuyo import HokuyoScanner
from shared.runtime.clock import ManualClock, MonotonicClock
from tools.simulator.devices.pty_server import PtyServer
from tools.simulator.devices.scip_sensor import (
    UBG_04LX,
    UST_10LX,
    CapturedSensor,
    Mode,
    ScipSensor,
    read_session,
    scan_reply,
    status_reply,
)
from tools.simulator.devices.tcp_server import TcpServer

PATIENCE_S = 5.0
Values = NDArray[np.int_]


def config(server: PtyServer | TcpServer, **changes: float) -> ScannerConfig:
    where = {"port": server.port} if isinstance(server, PtyServer) else {"address": server.address}
    return ScannerConfig(**where, **{"silence_s": 0.2, "reopen_every_s": 0.001, "start_up_s": 3.0} | changes)


def read(scanner: HokuyoScanner) -> RawScan:
    scan = scanner.read(PATIENCE_S)
    assert scan is not None
    return scan


def expected_m(values_mm: Values) -> Values:
    return np.where(values_mm < 20, np.nan, values_mm / 1000).astype(np.float32)


def test_scans_arrive_as_they_were_measured(attach, clock: MonotonicClock, values_mm: Values) -> None:
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server), clock)
    server.send(sensor.scan(values_mm[::-1]))
    scan = read(scanner)
    assert scan.ranges_m.dtype == np.float32
    np.testing.assert_array_equal(scan.ranges_m, expected_m(values_mm[::-1]))
    assert np.isnan(scan.ranges_m).sum() == 20
    assert scanner.read(0.0) is None
    scanner.close()


def test_the_geometry_is_what_the_scanner_says(attach, clock: MonotonicClock, values_mm: Values) -> None:
    scanner = HokuyoScanner(config(attach(ScipSensor(values_mm)), x_m=0.2), clock)
    geometry = scanner.geometry
    assert math.degrees(geometry.first_angle_rad) == pytest.approx(-119.53, abs=0.01)
    assert math.degrees(geometry.angles_rad(682)[-1]) == pytest.approx(119.88, abs=0.01)
    assert geometry.beam_interval_s * 1024 == pytest.approx(0.028, abs=1e-4)
    assert (geometry.range_min_m, geometry.range_max_m) == (0.06, 4.0)
    assert geometry.robot_from_scanner.x_m == 0.2
    scanner.close()


def test_a_scan_that_was_read_late_keeps_its_stamp(attach, values_mm: Values) -> None:
    clock = ManualClock(100.0)
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server), clock)
    clock.advance(0.028)
    server.send(sensor.scan(values_mm))
    first = read(scanner)
    clock.advance(0.078)
    server.send(sensor.scan(values_mm))  # measured 28 ms after the other one
    assert read(scanner).stamp_s - first.stamp_s == pytest.approx(0.028, abs=1e-3)
    scanner.close()


def test_a_wrong_time_that_passed_its_check_sum_does_not_make_all_later_scans_old(attach, values_mm: Values) -> None:
    clock = ManualClock(100.0)
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server), clock)
    ages_s = []
    for i in range(40):
        clock.advance(0.028)
        sensor.time_ms += {5: 60_000, 6: -60_000}.get(i, 0)
        server.send(sensor.scan(values_mm))
        ages_s.append(clock.now_s() - read(scanner).stamp_s)
    usual_s = ages_s[0]
    assert max(ages_s[6:30]) > 50.0  # not believed at once: it might have waited in a buffer
    assert ages_s[-5:] == pytest.approx([usual_s] * 5, abs=2e-3)
    scanner.close()


@pytest.mark.parametrize(
    ("name", "product", "beams", "turn_s", "ends_deg", "request_sent"),
    [
        ("example_urg_04lx", "URG-04LX", 682, 0.1, (-119.53, 119.88), b"MS0044072501000"),
        ("example_utm_30lx", "TOP-URG UTM-30LX", 1081, 0.025, (-135, 135), b"MS0000108001000"),
        ("example_uxm_30lx_e", "Tough-URG UXM-30LX-E", 761, 0.05, (-95, 95), b"MS0000076001000"),
    ],
)
def test_a_real_scanner_is_opened_by_its_captured_bytes(
    attach,
    clock: MonotonicClock,
    scip_data: Path,
    name: str,
    product: str,
    beams: int,
    turn_s: float,
    ends_deg: tuple[float, float],
    request_sent: bytes,
) -> None:
    room_mm = np.arange(beams) + 1000
    sensor = CapturedSensor(read_session(scip_data, name), room_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server), clock)
    assert (scanner.identity.product, scanner.identity.state) == (f"SOKUIKI Sensor {product}", "Sensor works well.")
    assert sensor.requests[-1] == request_sent
    geometry = scanner.geometry
    assert geometry.beam_interval_s * scanner.parameters.steps_per_turn == pytest.approx(turn_s)
    np.testing.assert_allclose(np.degrees(geometry.angles_rad(beams)[[0, -1]]), ends_deg, atol=0.01)
    server.send(sensor.scan(room_mm[::-1]))
    np.testing.assert_array_equal(read(scanner).ranges_m, expected_m(room_mm[::-1]))
    scanner.close()


def test_only_the_newest_of_several_scans_is_returned(attach, clock: MonotonicClock, values_mm: Values) -> None:
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server), clock)
    server.send(sensor.scan(values_mm) + sensor.scan(np.full(682, 1234)))  # both fit into the line's buffer
    assert np.all(read_until(scanner, 1.234))
    assert scanner.counters.corrupt == 0
    scanner.close()


def read_until(scanner: HokuyoScanner, range_m: float) -> NDArray[np.bool_]:
    for _ in range(10):
        scan = read(scanner)
        if scan.ranges_m[100] == np.float32(range_m):
            return scan.ranges_m == np.float32(range_m)
    raise AssertionError("the newest scan never came")


def test_a_scan_that_dribbles_in_is_put_together(attach, clock: MonotonicClock, values_mm: Values) -> None:
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server, silence_s=5.0), clock)
    data = sensor.scan(np.full(682, 999))
    for i in range(len(data) - 1):
        server.send(data[i : i + 1])
        assert scanner.read(0.0) is None
    server.send(data[-1:])
    assert np.all(read(scanner).ranges_m == np.float32(0.999))
    assert scanner.counters.corrupt == 0
    scanner.close()


@pytest.mark.parametrize("spoil", ["cut", "garbage before", "wrong sum", "lost line feeds", "cut and glued"])
def test_a_spoilt_scan_is_dropped_and_the_next_one_read(
    attach, clock: MonotonicClock, values_mm: Values, spoil: str
) -> None:
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server, silence_s=5.0), clock)
    bad = sensor.scan(values_mm)
    spoilt = {
        "cut": bad[:700] + b"\n\n",
        "garbage before": b"\x00\xff\x13\n\xfe" * 20 + b"\n\n",
        "wrong sum": bad[:400] + bytes([bad[400] ^ 1]) + bad[401:],
        "lost line feeds": bad.replace(b"\n", b"") + b"\n\n",
        "cut and glued": bad[:700],
    }[spoil]
    server.send(spoilt + sensor.scan(np.full(682, 777)))
    assert np.all(read(scanner).ranges_m == np.float32(0.777))
    scanner.close()


@pytest.mark.parametrize("mode", list(Mode))
def test_a_scanner_in_any_state_is_brought_to_stream(
    attach, clock: MonotonicClock, values_mm: Values, mode: Mode
) -> None:
    sensor = ScipSensor(values_mm, mode=mode)
    server = attach(sensor)
    if mode is Mode.STREAMING:
        server.send(sensor.scan(values_mm)[300:] + sensor.scan(values_mm))
    scanner = HokuyoScanner(config(server), clock)
    assert sensor.mode is Mode.STREAMING
    scanner.close()


def test_a_half_written_command_of_an_earlier_program_does_no_harm(
    attach, clock: MonotonicClock, values_mm: Values
) -> None:
    sensor = ScipSensor(values_mm)
    sensor.receive(b"MD0044")
    scanner = HokuyoScanner(config(attach(sensor)), clock)
    assert sensor.mode is Mode.STREAMING
    scanner.close()


def test_closing_switches_the_laser_off(attach, clock: MonotonicClock, values_mm: Values) -> None:
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server), clock)
    scanner.close()
    scanner.close()
    with pytest.raises(DeviceError, match="closed"):
        scanner.read(0.0)
    again = HokuyoScanner(config(server), clock)  # the lock of the port is gone as well
    assert sensor.requests.count(b"BM") == 2
    again.close()


def test_a_silent_scanner_is_lost_and_opened_again(attach, values_mm: Values) -> None:
    clock = ManualClock()
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server, reopen_every_s=1.0), clock)
    for _ in range(2):
        assert scanner.read(0.0) is None
        clock.advance(0.09)
    clock.advance(0.01)
    assert scanner.read(0.0) is None
    clock.advance(0.09)
    with pytest.raises(DeviceError, match="no good scan"):
        scanner.read(0.0)
    with pytest.raises(DeviceError, match="no good scan"):  # too early for another try
        scanner.read(0.0)
    clock.advance(1.1)
    assert scanner.read(0.0) is None
    server.send(sensor.scan(np.full(682, 555)))
    assert np.all(read(scanner).ranges_m == np.float32(0.555))
    scanner.close()


def test_garbage_for_ever_is_a_lost_scanner(attach, values_mm: Values) -> None:
    clock = ManualClock()
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server), clock)
    with pytest.raises(DeviceError, match="no good scan"):
        for _ in range(10):
            server.send(b"\xa5" * 900)
            scanner.read(0.0)
            clock.advance(0.05)
    assert clock.now_s() < 0.35
    scanner.close()


def test_unplugging_is_an_error_that_says_where(attach, clock: MonotonicClock, values_mm: Values) -> None:
    server = attach(ScipSensor(values_mm))
    scanner = HokuyoScanner(config(server), clock)
    server.unplug()
    for _ in range(3):
        with pytest.raises(DeviceError, match=r"scanner at (/dev/pts/|127\.0\.0\.1:)\d+"):
            scanner.read(0.01)
    scanner.close()


def test_another_scanner_at_the_port_is_refused_for_ever(attach, values_mm: Values) -> None:
    clock = ManualClock()
    sensor = ScipSensor(values_mm)
    scanner = HokuyoScanner(config(attach(sensor)), clock)
    sensor.become((*UBG_04LX[:5], ("AMAX", "700"), *UBG_04LX[6:]), values_mm[:657])
    clock.advance(0.09)
    scanner.read(0.0)
    clock.advance(0.09)
    scanner.read(0.0)
    clock.advance(0.09)
    with pytest.raises(DeviceError, match="no good scan"):
        scanner.read(0.0)
    for _ in range(3):
        clock.advance(1.0)
        with pytest.raises(DeviceError, match="another scanner"):
            scanner.read(0.0)
    scanner.close()


def test_nobody_listening_is_not_silence(attach, values_mm: Values) -> None:
    clock = ManualClock()
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server), clock)
    clock.advance(60.0)  # the kernels were compiled; meanwhile the line's buffer ran over
    server.send(sensor.scan(values_mm)[:900] + sensor.scan(values_mm)[200:700])
    assert scanner.read(0.0) is None
    clock.advance(0.02)
    server.send(sensor.scan(values_mm) + sensor.scan(np.full(682, 333)))
    assert np.all(read_until(scanner, 0.333))
    scanner.close()


def test_hardware_trouble_is_named(attach, clock: MonotonicClock, values_mm: Values) -> None:
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server), clock)
    server.send(scan_reply(b"MS0044072501000", 0, values_mm, status=b"55"))
    with pytest.raises(DeviceError, match="55: hardware trouble"):
        scanner.read(PATIENCE_S)
    scanner.close()


def test_a_scanner_that_checks_itself_is_waited_for(attach, clock: MonotonicClock, values_mm: Values) -> None:
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server, silence_s=5.0), clock)
    checking, resumed = (scan_reply(b"MS0044072501000", 0, values_mm, status=s) for s in (b"21", b"98"))
    server.send(checking[:40] + b"\n\n" + resumed[:40] + b"\n\n" + sensor.scan(np.full(682, 888)))
    assert np.all(read(scanner).ranges_m == np.float32(0.888))
    scanner.close()


def test_what_a_scanner_says_again_and_again_is_logged_once(
    attach, clock: MonotonicClock, values_mm: Values, caplog: pytest.LogCaptureFixture
) -> None:
    sensor = ScipSensor(values_mm)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server, silence_s=5.0), clock)
    server.send(20 * status_reply(b"MS0044072501000", b"0L") + sensor.scan(np.full(682, 888)))
    assert np.all(read(scanner).ranges_m == np.float32(0.888))
    assert len([r for r in caplog.records if "0L: is in trouble" in r.getMessage()]) == 1
    scanner.close()


def test_a_faulty_laser_refuses_to_open(attach, clock: MonotonicClock, values_mm: Values) -> None:
    sensor = ScipSensor(values_mm)
    sensor.refusals[b"BM"] = b"01"
    with pytest.raises(DeviceError, match="BM was refused, 01: the laser is faulty"):
        HokuyoScanner(config(attach(sensor)), clock)


def test_parameters_that_make_no_sense_are_refused(attach, clock: MonotonicClock, values_mm: Values) -> None:
    without_front = tuple(f for f in UBG_04LX if f[0] != "AFRT")
    with pytest.raises(DeviceError, match="no AFRT"):
        HokuyoScanner(config(attach(ScipSensor(values_mm, without_front))), clock)
    backwards = (*without_front, ("AFRT", "5"))
    with pytest.raises(DeviceError, match="make no sense"):
        HokuyoScanner(config(attach(ScipSensor(values_mm, backwards))), clock)


def test_nobody_at_the_port_is_an_error(attach, clock: MonotonicClock, values_mm: Values) -> None:
    server = attach(ScipSensor(values_mm))
    server.is_silent = True
    with pytest.raises(DeviceError, match="no scanner answers"):
        HokuyoScanner(config(server, answer_timeout_s=0.01), clock)


def test_a_failed_opening_leaves_nothing_open(attach, clock: MonotonicClock, values_mm: Values) -> None:
    server = attach(ScipSensor(values_mm))
    server.is_silent = True
    with pytest.raises(DeviceError, match="no scanner answers"):
        HokuyoScanner(config(server, answer_timeout_s=0.01), clock)
    server.is_silent = False
    HokuyoScanner(config(server), clock).close()  # neither the port's lock nor the only connection is taken


def test_a_missing_library_is_named(attach, clock: MonotonicClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hokuyolx", None)
    monkeypatch.delitem(sys.modules, "robot_app.drivers.scip_client", raising=False)
    with pytest.raises(DeviceError, match="package hokuyolx is not installed"):
        HokuyoScanner(config(attach(ScipSensor(None))), clock)


def test_a_scanner_without_scans_is_an_error(attach, clock: MonotonicClock) -> None:
    with pytest.raises(DeviceError, match="sends no scans"):
        HokuyoScanner(config(attach(ScipSensor(None)), start_up_s=0.05), clock)


def test_a_ust_is_read_with_all_its_beams(attach, clock: MonotonicClock) -> None:
    far_mm = np.linspace(20, 29_999, 1081).astype(np.int_)
    far_mm[:3] = 1, 19, 65_533  # two errors, and nothing in its range
    sensor = ScipSensor(far_mm, UST_10LX)
    server = attach(sensor)
    scanner = HokuyoScanner(config(server, range_max_m=10.0), clock)
    assert sensor.requests[-1] == b"MD0000108001000"  # two characters end at 4 m
    server.send(sensor.scan(far_mm))
    ranges_m = read(scanner).ranges_m
    assert np.isnan(ranges_m[:3]).all()
    np.testing.assert_array_equal(ranges_m[3:], (far_mm[3:] / 1000).astype(np.float32))
    angles_rad = scanner.geometry.angles_rad(1081)
    np.testing.assert_allclose(np.degrees(angles_rad[[0, 540, 1080]]), [-135, 0, 135], atol=1e-4)
    assert scanner.geometry.range_max_m == 10.0
    assert scanner.identity.product == "SOKUIKI Sensor UST-10LX"
    scanner.close()


@pytest.mark.parametrize(
    ("command", "status", "words"),
    [
        (b"BM", b"10", "BM was refused, 10: the laser is off"),
        (b"VV", b"0E", "VV was refused, 0E: does not know this command"),
        (b"PP", b"0L", "PP was refused, 0L: is in trouble"),
        (b"MS", b"05", "MS was refused, 05: a parameter of the scan is wrong"),
        (b"MS", b"98", "MS was refused, 98: measures again"),
    ],
)
def test_a_refusal_is_named(
    attach, clock: MonotonicClock, values_mm: Values, command: bytes, status: bytes, words: str
) -> None:
    sensor = ScipSensor(values_mm)
    sensor.refusals[command] = status
    with pytest.raises(DeviceError, match=words):
        HokuyoScanner(config(attach(sensor)), clock)


def test_half_an_answer_is_no_answer(attach, clock: MonotonicClock, values_mm: Values) -> None:
    sensor = HalfSensor(values_mm)
    with pytest.raises(DeviceError, match="no answer to PP"):
        HokuyoScanner(config(attach(sensor), answer_timeout_s=0.02), clock)
    sensor.is_half = False
    scanner = HokuyoScanner(config(attach(sensor)), clock)
    scanner.close()


class HalfSensor(ScipSensor):
    """Loses the second half of its parameters, which the next reply then follows."""

    is_half = True

    def _reply(self, line: bytes) -> bytes:
        reply = super()._reply(line)
        return reply[: len(reply) // 2] if self.is_half and line == b"PP" else reply
