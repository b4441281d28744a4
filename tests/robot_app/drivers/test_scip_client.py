"""hokuyolx behind its transport: the faults that it has by itself, and what real scanners answered."""

from __future__ import annotations

from collections import deque
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from hokuyolx.exceptions import HokuyoException, HokuyoStatusException
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from robot_app.drivers.base import DeviceError
from robot_app.drivers.scip_client import ScipClient
from robot_app.drivers.scip_transport import ScipTransport
from shared.runtime.clock import ManualClock
from tools.simulator.devices.scip_sensor import (
    UST_10LX,
    CapturedSensor,
    ScipSensor,
    read_session,
    scan_reply,
    status_reply,
    summed,
)

CHUNK_S = 0.02
TIMEOUT_S = 0.3


class SensorLine:
    """A line without a port: what the sensor says comes in chunks, one every 20 ms, then the other side is gone."""

    name = "scanner at a desk"

    def __init__(self, clock: ManualClock, sensor: ScipSensor | None = None, chunks: tuple[bytes, ...] = ()) -> None:
        self._clock = clock
        self._sensor = sensor
        self.chunks = deque(chunks)
        self.is_gone = False

    def write(self, data: bytes) -> None:
        if self._sensor is not None:
            self.chunks.append(self._sensor.receive(data))

    def read(self, timeout_s: float) -> bytes:
        if self.is_gone:
            raise DeviceError(f"{self.name}: closed the connection")
        self._clock.advance(min(CHUNK_S, timeout_s) if self.chunks else timeout_s)
        return self.chunks.popleft() if self.chunks else b""

    def close(self) -> None:
        self.is_gone = True


def client_of(line: SensorLine, clock: ManualClock) -> ScipClient:
    return ScipClient(ScipTransport(line, clock), TIMEOUT_S)


def opened(sensor: ScipSensor) -> tuple[ScipClient, SensorLine]:
    clock = ManualClock()
    line = SensorLine(clock, sensor)
    client = client_of(line, clock)
    client.parameters()
    return client, line


def answer_to(request: bytes, *chunks: bytes) -> tuple[bytes, float]:
    """What `recv` gives, and how long it took."""
    clock = ManualClock()
    transport = ScipTransport(SensorLine(clock, chunks=chunks), clock)
    transport.settimeout(TIMEOUT_S)
    transport.send(request + b"\n")
    return transport.recv(512), clock.now_s()


GOOD = status_reply(b"BM", b"00")


@pytest.mark.parametrize(
    "chunks",
    [
        (GOOD,),
        (GOOD[:4], GOOD[4:]),
        tuple(GOOD[i : i + 1] for i in range(len(GOOD))),
        (GOOD + status_reply(b"VV", b"00"),),
        (b"\xff\x00\n\n\n\nBM\n" + GOOD,),
        (b"0068\n\n", status_reply(b"QT", b"00"), GOOD),
        (GOOD[:5] + b"\n\n" + GOOD,),
        (status_reply(b"BM", b"00", b"\xff\xfe\n") + GOOD,),
        (GOOD.replace(b"00P", b"00Q") + GOOD,),
    ],
)
def test_one_whole_answer_is_handed_over(chunks: tuple[bytes, ...]) -> None:
    assert answer_to(b"BM", *chunks)[0] == GOOD


@pytest.mark.parametrize("chunks", [(), (GOOD[:6],), (status_reply(b"QT", b"00"),) * 100, (b"\x55" * 900,) * 100])
def test_silence_half_an_answer_and_babble_end_with_the_time_out(chunks: tuple[bytes, ...]) -> None:
    clock = ManualClock()
    transport = ScipTransport(SensorLine(clock, chunks=chunks), clock)
    transport.settimeout(TIMEOUT_S)
    transport.send(b"BM\n")
    with pytest.raises(TimeoutError):
        transport.recv(512)
    assert clock.now_s() == pytest.approx(TIMEOUT_S)


@given(st.lists(st.binary(max_size=80), max_size=12))
def test_foreign_bytes_give_the_library_nothing_to_fall_over(chunks: list[bytes]) -> None:
    clock = ManualClock()
    client = client_of(SensorLine(clock, chunks=(b"VV\n00P\n", *(chunk + b"\n\n" for chunk in chunks))), clock)
    with pytest.raises(DeviceError, match=r"VV|II"):
        client.identity()


def test_who_hangs_up_does_not_keep_the_library_waiting(values_mm: NDArray[np.int_]) -> None:
    client, line = opened(ScipSensor(values_mm))
    line.is_gone = True
    with pytest.raises(DeviceError, match="closed the connection"):
        client.standby()


def test_making_a_client_asks_nothing() -> None:
    sensor = ScipSensor(None)
    clock = ManualClock()
    client_of(SensorLine(clock, sensor), clock)
    assert sensor.requests == []


@pytest.mark.parametrize(
    ("parameters", "beams", "ends_deg"), [(None, 682, (-119.53, 119.88)), (UST_10LX, 1081, (-135, 135))]
)
def test_there_are_as_many_angles_as_ranges(
    parameters: tuple[tuple[str, str], ...] | None, beams: int, ends_deg: tuple[float, float]
) -> None:
    values_mm = np.arange(beams) + 1000
    client, _ = opened(ScipSensor(values_mm, parameters) if parameters else ScipSensor(values_mm))
    client.laser_on()
    _, table = client.get_filtered_dist()
    assert table.shape == (beams, 2)
    np.testing.assert_array_equal(table[:, 1], values_mm)
    np.testing.assert_allclose(np.degrees(table[[0, -1], 0]), ends_deg, atol=0.01)


def test_scans_that_a_slow_reader_finds_glued_are_all_read(values_mm: NDArray[np.int_]) -> None:
    sensor, clock = ScipSensor(values_mm), ManualClock()
    line = SensorLine(clock, sensor)
    client = client_of(line, clock)
    client.parameters()
    scans = client.iter_dist()
    next(scans)
    line.chunks.append(b"".join(sensor.scan(np.full(682, 100 + i)) for i in range(20)))
    clock.advance(10 * TIMEOUT_S)
    assert [scan[0] for scan, _, _ in islice(scans, 20)] == list(range(100, 120))
    with pytest.raises(HokuyoException, match="timeout"):
        next(scans)


def test_a_damaged_scan_is_an_exception_of_the_library(values_mm: NDArray[np.int_]) -> None:
    sensor = ScipSensor(values_mm)
    client, line = opened(sensor)
    scans = client.iter_dist()
    next(scans)
    good = sensor.scan(values_mm)
    line.chunks.append(good[:900] + bytes([good[900] ^ 1]) + good[901:])
    with pytest.raises(HokuyoException, match="data of a scan"):
        next(scans)


def test_what_scip_2_does_not_have_is_refused_and_no_more(values_mm: NDArray[np.int_]) -> None:
    client, _ = opened(ScipSensor(values_mm))
    for ask in (client.get_intens, client.laser_state):
        with pytest.raises(HokuyoStatusException, match="0E"):
            ask()
    client.laser_on()
    assert len(client.get_dist()[1]) == 682


def test_without_the_laser_there_is_no_single_scan(values_mm: NDArray[np.int_]) -> None:
    client, _ = opened(ScipSensor(values_mm))
    with pytest.raises(HokuyoStatusException, match="10"):
        client.get_dist()


def test_a_value_may_hold_a_colon() -> None:
    line = summed(b"STAT:Stopped: too hot")
    answer = status_reply(b"II", b"00", line[:-1] + b";" + line[-1:] + b"\n")
    clock = ManualClock()
    client = client_of(SensorLine(clock, chunks=(answer,)), clock)
    assert client.sensor_state() == {"STAT": "Stopped: too hot"}


@pytest.mark.parametrize("spoilt", [b"VEND:Hokuyo;[", b"VEND", b";", b"VEND:Hokuyo;"])
def test_a_damaged_line_of_information_is_told(spoilt: bytes) -> None:
    clock = ManualClock()
    client = client_of(SensorLine(clock, chunks=(status_reply(b"VV", b"00", spoilt + b"\n"),)), clock)
    with pytest.raises(DeviceError, match="VV"):
        client.identity()


@pytest.mark.parametrize(
    ("name", "product", "serial", "steps"),
    [
        ("example_urg_04lx", "SOKUIKI Sensor URG-04LX", "H0706400", (44, 725, 384, 1024, 600)),
        ("example_utm_30lx", "SOKUIKI Sensor TOP-URG UTM-30LX", "00903971", (0, 1080, 540, 1440, 2400)),
        ("example_uxm_30lx_e", "SOKUIKI Sensor Tough-URG UXM-30LX-E", "H0909106", (0, 760, 380, 1440, 1200)),
    ],
)
def test_what_real_scanners_say_about_themselves(
    scip_data: Path, name: str, product: str, serial: str, steps: tuple[int, ...]
) -> None:
    client, _ = opened(CapturedSensor(read_session(scip_data, name), None))
    identity, p = client.identity(), client.parameters()
    assert (identity.product, identity.serial, identity.state) == (product, serial, "Sensor works well.")
    assert (p.first_step, p.last_step, p.front_step, p.steps_per_turn, p.turns_per_minute) == steps
    client.laser_on()


def test_captured_scans_through_the_library(scip_data: Path) -> None:
    client, _ = opened(CapturedSensor(read_session(scip_data, "example_urg_04lx"), None))
    _, values_mm = client.get_dist(grouping=1)
    assert (len(values_mm), int((values_mm >= 20).sum())) == (682, 581)
    client, _ = opened(CapturedSensor(read_session(scip_data, "example_uxm_30lx_e"), None))
    assert len(client.get_dist(grouping=1)[1]) == 761


def test_a_captured_scan_with_intensities_through_the_library(scip_data: Path) -> None:
    client, _ = opened(CapturedSensor(read_session(scip_data, "example_utm_30lx"), None))
    ((values, _, pending),) = client.iter_intens(scans=1, grouping=1, skips=1)
    assert values.shape == (1081, 2)
    assert pending == 0
    assert int(values[:, 0].max()) <= 60_000


def test_the_stream_is_left_to_the_driver(values_mm: NDArray[np.int_]) -> None:
    clock = ManualClock()
    sensor = ScipSensor(None)
    line = SensorLine(clock, sensor)
    transport = ScipTransport(line, clock)
    client = ScipClient(transport, TIMEOUT_S)
    client.begin_stream("MS0044072501000")
    scan = sensor.scan(values_mm)
    line.chunks.extend((scan[:700], scan[700:] + scan[:100]))
    assert transport.receive(0.1) == []
    assert transport.receive(0.1) == [scan[:-2]]
    assert transport.receive(0.1) is None
    assert scan == scan_reply(b"MS0044072501000", sensor.time_ms, values_mm)
