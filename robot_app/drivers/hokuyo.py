"""Hokuyo's scanners, UBG-04LX-F01 over USB or RS-232 and UST over TCP: scans as they are measured, by MS or MD."""

from __future__ import annotations

import contextlib
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.arrival import ArrivalFilter, WrappingCounter
from robot_app.drivers.base import DeviceError, RawScan
from robot_app.drivers.config import ScannerConfig
from robot_app.drivers.library import load_library
from robot_app.drivers.lost import Reopening
from robot_app.drivers.scip import (
    OK,
    RESUMED,
    STREAMED,
    UNSTABLE,
    ScanDecoder,
    ScannerIdentity,
    ScannerParameters,
    parse_reply,
    status_name,
)
from robot_app.drivers.scip_transport import ScipTransport
from robot_app.drivers.serial_line import SerialLine
from robot_app.drivers.tcp_line import TcpLine
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry
from shared.runtime.clock import Clock

if TYPE_CHECKING:
    from robot_app.drivers.scip_client import ScipClient

_log = logging.getLogger(__name__)
_SHORT_MAX_MM = 4095  # of a value of two characters: all that a 4 m scanner needs, and two thirds of the bytes
# After power-up the scanner has the rate it was delivered with, which is not the same for all of them.
_RS232_RATES = (115_200, 19_200, 38_400, 57_600, 250_000, 500_000, 750_000)
_COUNTER_BITS, _COUNTER_TICK_S = 24, 0.001
_BITS_PER_BYTE = 10  # on an RS-232 line
_USB_TRANSFER_S = 0.0015  # of 1435 bytes at full speed, with its 1 ms frames
_TCP_TRANSFER_S = 0.0005  # of 3381 bytes at 100 Mbit/s, and the way through the kernel
_RESTART_S = 1.0  # the task that reads must be able to end; the next read tries again
_HARDWARE_TROUBLE = range(50, 98)
_LATE_S, _LATE_SCANS = 0.1, 25  # so many scans in a row did not wait in a buffer: a wrong time passed its check sum


@dataclass(slots=True)
class ScanCounters:
    """`skipped`: good scans that a newer one overtook before anybody read them."""

    read: int = 0
    skipped: int = 0
    corrupt: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class _Scan:
    arrived_s: float
    values_mm: NDArray[np.int32]


class HokuyoScanner:
    """The newest scan only.

    The scanner sends a scan when its last beam is measured. The stamp, that of beam 0, is the arrival less the
    transfer and the time the mirror takes from the first beam to the last; the arrival is freed of the host's
    delays by the scanner's own millisecond counter.
    """

    def __init__(self, config: ScannerConfig, clock: Clock) -> None:
        self._config = config
        self._clock = clock
        self._reopening = Reopening(clock, config.reopen_every_s)
        self._closed = False
        self._client: ScipClient | None = None
        has_no_rate = config.address or "ACM" in Path(config.port).resolve().name
        self._transfer_known_s = (_TCP_TRANSFER_S if config.address else _USB_TRANSFER_S) if has_no_rate else None
        self._rates: tuple[int, ...] = (config.baud_rate, *(() if has_no_rate else _RS232_RATES))
        self.counters = ScanCounters()
        self._start(config.start_up_s)
        self._rates = (config.baud_rate, self._baud_rates.found)  # it has the second again after a loss of power
        self._geometry = _geometry(self._parameters, config)

    @property
    def _name(self) -> str:
        return f"scanner at {self._config.address or self._config.port}"

    @property
    def geometry(self) -> ScanGeometry:
        return self._geometry

    @property
    def parameters(self) -> ScannerParameters:
        return self._parameters

    @property
    def identity(self) -> ScannerIdentity:
        return self._identity

    def read(self, timeout_s: float) -> RawScan | None:
        """After a loss the read raises `DeviceError`, and a later one opens the port again."""
        if self._closed:
            raise DeviceError(f"{self._name}: is closed")
        self._reopening.check_due()
        try:
            if self._client is None:
                self._restart()
            scan = self._newest(timeout_s)
        except DeviceError as error:
            self._drop()
            self._reopening.lost(error)
            raise
        return None if scan is None else self._raw(scan)

    def close(self) -> None:
        self._closed = True
        self._drop()

    def _start(self, first_scan_within_s: float) -> None:
        c = self._config
        protocol = load_library("robot_app.drivers.scip_client", "scanner")
        if c.address:
            line: SerialLine | TcpLine = TcpLine("scanner", c.address, first_scan_within_s)
        else:
            line = SerialLine("scanner", c.port, c.baud_rate)
        self._transport = ScipTransport(line, self._clock)
        client: ScipClient = protocol.ScipClient(self._transport, c.answer_timeout_s)
        self._client = client
        try:
            self._baud_rates = client.find(self._rates, line.set_baud_rate)
            self._begin_streaming(client)
            self._last_read_s = self._clock.now_s()
            self._good_s = self._last_read_s + first_scan_within_s
            if self._newest(first_scan_within_s) is None:
                raise DeviceError(f"{line.name}: sends no scans; does its mirror turn?")
        except DeviceError:
            self._drop()
            raise

    def _begin_streaming(self, client: ScipClient) -> None:
        self._identity = client.identity()
        self._parameters = p = client.parameters()
        characters = 2 if min(p.range_max_mm, self._config.range_max_m * 1e3) <= _SHORT_MAX_MM else 3
        self._decoder = ScanDecoder(p.beams, characters)
        self._arrival, self._late_scans = ArrivalFilter(), 0
        self._told_status = b""
        self._counter = WrappingCounter(_COUNTER_BITS, _COUNTER_TICK_S)
        client.laser_on()
        request = f"{'MS' if characters == 2 else 'MD'}{p.first_step:04d}{p.last_step:04d}010"  # every step, every scan
        self._request = request.encode("ascii")
        client.begin_stream(request + "00")  # until QT

    def _restart(self) -> None:
        before = self._parameters
        self._start(min(self._config.start_up_s, _RESTART_S))
        if self._parameters != before:
            self._parameters = before
            raise DeviceError(f"{self._name}: another scanner is connected; start the app again")
        self._reopening.found()

    def _drop(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            with contextlib.suppress(DeviceError):
                client.send_quit()
            client.close()

    def _newest(self, timeout_s: float) -> _Scan | None:
        now_s = self._clock.now_s()
        due_s = now_s + timeout_s
        if now_s - self._last_read_s > self._config.silence_s / 2:
            self._good_s = now_s  # nobody has listened meanwhile; that is not the scanner's silence
        while True:
            blocks = self._transport.receive(due_s - now_s)
            scan = self._newest_of(blocks or [])
            self._last_read_s = now_s = self._clock.now_s()
            if scan is not None:
                self._good_s = now_s
                return scan
            if blocks is None or now_s >= due_s:
                self._check_silence(now_s)
                return None

    @property
    def losses(self) -> dict[str, int]:
        return {"damaged scans": self.counters.corrupt, "scans left out": self.counters.skipped}

    def _check_silence(self, now_s: float) -> None:
        if now_s - self._good_s > self._config.silence_s:
            raise DeviceError(f"{self._name}: no good scan any more; are cable and supply in order?")

    def _newest_of(self, blocks: list[bytes]) -> _Scan | None:
        arrived_s = self._clock.now_s()
        newest: _Scan | None = None
        for block in reversed(blocks):  # only the newest good one is decoded
            reply = parse_reply(block, self._request)
            if reply is None:
                self.counters.corrupt += 1
            elif reply.status != STREAMED:
                self._judge(reply.status)
            elif newest is not None:
                self.counters.skipped += 1
            else:
                newest = self._decoded(reply.body, arrived_s)
        return newest

    def _decoded(self, body: bytes, arrived_s: float) -> _Scan | None:
        block = self._decoder.decode(body)
        if block is None:
            self.counters.corrupt += 1
            return None
        self.counters.read += 1
        return _Scan(self._arrival_s(self._counter.seconds(block.time_ms), arrived_s), block.values)

    def _arrival_s(self, device_s: float, arrived_s: float) -> float:
        """Believes the scanner's counter, unless it stays behind what the host sees."""
        found_s = self._arrival.arrival_s(device_s, arrived_s)
        self._late_scans = self._late_scans + 1 if arrived_s - found_s > _LATE_S else 0
        if self._late_scans <= _LATE_SCANS:
            return found_s
        _log.warning("%s: its clock has jumped", self._name)
        self._arrival, self._late_scans = ArrivalFilter(), 0
        return self._arrival.arrival_s(device_s, arrived_s)

    def _judge(self, status: bytes) -> None:
        if status in {OK, RESUMED, UNSTABLE} or status == self._told_status:
            return
        text = f"{self._name}: {status_name('MS', status)}"
        if status.isdigit() and int(status) in _HARDWARE_TROUBLE:
            raise DeviceError(text)
        self._told_status = status
        _log.warning("%s", text)

    def _raw(self, scan: _Scan) -> RawScan:
        ranges_m = (scan.values_mm / 1000).astype(np.float32)
        p = self._parameters  # outside of its range there are codes: errors below, "nothing there" above
        ranges_m[(scan.values_mm < p.range_min_mm) | (scan.values_mm > p.range_max_mm)] = np.nan
        sweep_s = (self._parameters.beams - 1) * self._geometry.beam_interval_s
        return RawScan(scan.arrived_s - self._transfer_s() - sweep_s, ranges_m)

    def _transfer_s(self) -> float:
        if self._transfer_known_s is not None:
            return self._transfer_known_s
        return self._decoder.reply_bytes * _BITS_PER_BYTE / self._baud_rates.now


def _geometry(p: ScannerParameters, config: ScannerConfig) -> ScanGeometry:
    period_s = 60.0 / p.turns_per_minute if p.turns_per_minute > 0 else config.period_s
    return ScanGeometry(
        first_angle_rad=(p.first_step - p.front_step) * p.step_rad,
        step_rad=p.step_rad,
        beam_interval_s=period_s / p.steps_per_turn,
        range_min_m=max(config.range_min_m, p.range_min_mm * 1e-3),
        range_max_m=min(config.range_max_m, p.range_max_mm * 1e-3),
        robot_from_scanner=Pose2(config.x_m, config.y_m, config.theta_rad),
    )
