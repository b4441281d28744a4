"""What a setting carries: computed, and measured between two modules."""

from __future__ import annotations

import statistics
import struct
from collections.abc import Callable
from dataclasses import dataclass

from shared.link.es920lr.airtime import (
    PAUSE_S,
    ack_airtime_s,
    airtime_s,
    carrier_sense_s,
    packets_per_s,
    send_s,
)
from shared.link.es920lr.band import BandRule, longest_payload, problems
from shared.link.es920lr.core import SendFailed, Sent
from shared.link.es920lr.driver import Es920lr
from shared.link.es920lr.parser import Heard
from shared.link.es920lr.settings import RadioSettings
from shared.runtime.clock import Clock

_TEST = struct.Struct(">4sH")  # mark, number
_ECHO = struct.Struct(">4sHhH")  # mark, number, its strength in dBm, packets heard so far
_MARK, _ECHO_MARK = b"test", b"echo"
SHORTEST_PAYLOAD_BYTES = _ECHO.size
_PATIENCE_S = 2.0  # besides the time that a packet takes
_ANSWER_AFTER_S = 0.1  # who has sent hears nothing for 50 ms


@dataclass(frozen=True, slots=True)
class Estimate:
    """Rates are of one module that does nothing but send; two modules carry twice as much."""

    bandwidth_hz: int
    spreading_factor: int
    payload_bytes: int
    bit_rate_bps: float
    airtime_ms: float
    ack_airtime_ms: float
    carrier_sense_ms: float
    packets_per_s_at_most: float  # airtime and pause alone
    packets_per_s: float  # with carrier sense and the serial line
    packets_per_s_ahead: float  # with carrier sense, the next packet handed over ahead of time
    goodput_bps: float
    goodput_two_modules_bps: float
    longest_payload_bytes: int
    forbidden: tuple[str, ...]


def estimate(settings: RadioSettings, payload_bytes: int, rule: BandRule) -> Estimate:
    modulation = settings.modulation
    ahead_s = carrier_sense_s(settings.bandwidth_hz) + airtime_s(modulation, payload_bytes) + PAUSE_S
    goodput_bps = 8.0 * payload_bytes / ahead_s
    return Estimate(
        settings.bandwidth_hz,
        settings.spreading_factor,
        payload_bytes,
        modulation.bit_rate_bps,
        airtime_s(modulation, payload_bytes) * 1e3,
        ack_airtime_s(modulation) * 1e3,
        carrier_sense_s(settings.bandwidth_hz) * 1e3,
        packets_per_s(modulation, payload_bytes),
        1.0 / send_s(modulation, payload_bytes, settings.baud_rate),
        1.0 / ahead_s,
        goodput_bps,
        2.0 * goodput_bps,
        longest_payload(settings, rule),
        tuple(problems(settings, rule, payload_bytes)),
    )


@dataclass(frozen=True, slots=True)
class Direction:
    """Packets from one module to the other. Strengths are None when nothing came."""

    sender: str
    receiver: str
    sent: int
    received: int
    refused: int  # at its sender: the channel was busy, or the module said no
    weakest_dbm: int | None
    median_dbm: float | None
    strongest_dbm: int | None

    @property
    def loss(self) -> float:
        return 1.0 - self.received / self.sent if self.sent else 1.0


def measure(sender: Es920lr, receiver: Es920lr, count: int, payload_bytes: int, clock: Clock) -> Direction:
    """Send `count` packets one way. Raises `LinkError`."""
    sent, refused = 0, 0
    strengths: list[int] = []
    for number in range(count):
        payload = _test_packet(number, payload_bytes)
        is_out = _send(sender, payload, clock)
        sent += is_out
        refused += not is_out
        # It has come before its sender was told that it is out; a moment is for the serial line.
        strengths += [e.rssi_dbm for e in _heard(receiver, 0.05, clock) if e.payload == payload]
    return _direction(sender.name, receiver.name, sent, len(strengths), refused, strengths)


def measure_far(near: Es920lr, far_name: str, count: int, payload_bytes: int, clock: Clock) -> list[Direction]:
    """There and back, with `echo` running at the far end. Raises `LinkError`.

    What has arrived there is known from the echoes: packets after the last echo that came back count as lost.
    """
    sent, refused, arrived = 0, 0, 0
    there: list[int] = []
    back: list[int] = []
    for number in range(count):
        is_out = _send(near, _test_packet(number, payload_bytes), clock)
        sent += is_out
        refused += not is_out
        wait_s = _ANSWER_AFTER_S + airtime_s(near.settings.modulation, payload_bytes) + 0.2
        for event in _heard(near, wait_s, clock, enough=_ECHO_MARK + number.to_bytes(2, "big")):
            if event.payload.startswith(_ECHO_MARK) and len(event.payload) >= _ECHO.size:
                _, _, strength_dbm, arrived = _ECHO.unpack_from(event.payload)
                there.append(strength_dbm)
                back.append(event.rssi_dbm)
        _heard(near, _ANSWER_AFTER_S, clock)  # the far end is in its pause now
    return [
        _direction(near.name, far_name, sent, arrived, refused, there),
        _direction(far_name, near.name, arrived, len(back), 0, back),
    ]


def echo(radio: Es920lr, clock: Clock, until_s: float, tell: Callable[[int, int], None]) -> int:
    """Answer every test packet with its strength until then; `tell` gets number and strength. Returns how many."""
    heard = 0
    while clock.now_s() < until_s:
        for event in radio.poll(min(0.5, until_s - clock.now_s())):
            if not isinstance(event, Heard) or len(event.payload) < _ECHO.size or event.payload[:4] != _MARK:
                continue
            _, number = _TEST.unpack_from(event.payload)
            heard = 1 if number == 0 else heard + 1  # a test begins anew
            tell(number, event.rssi_dbm)
            _heard(radio, _ANSWER_AFTER_S, clock)
            answer = _ECHO.pack(_ECHO_MARK, number, event.rssi_dbm, heard)
            _send(radio, answer.ljust(len(event.payload), b"."), clock)
    return heard


def _test_packet(number: int, payload_bytes: int) -> bytes:
    return _TEST.pack(_MARK, number).ljust(payload_bytes, b".")


def _direction(sender: str, receiver: str, sent: int, received: int, refused: int, strengths: list[int]) -> Direction:
    return Direction(
        sender,
        receiver,
        sent,
        received,
        refused,
        min(strengths, default=None),
        statistics.median(strengths) if strengths else None,
        max(strengths, default=None),
    )


def _send(sender: Es920lr, payload: bytes, clock: Clock) -> bool:
    """Whether it went out."""
    until_s = clock.now_s() + _PATIENCE_S + 2 * airtime_s(sender.settings.modulation, len(payload))
    handle = sender.submit(payload)
    while handle is not None and clock.now_s() < until_s:
        for event in sender.poll(until_s - clock.now_s()):
            if isinstance(event, Sent | SendFailed) and event.handle == handle:
                return isinstance(event, Sent)
    return False


def _heard(radio: Es920lr, wait_s: float, clock: Clock, enough: bytes | None = None) -> list[Heard]:
    """What comes within a stretch of time, which ends early with a packet that begins with `enough`."""
    until_s = clock.now_s() + wait_s
    found: list[Heard] = []
    while (left_s := until_s - clock.now_s()) > 0:
        found += [event for event in radio.poll(left_s) if isinstance(event, Heard)]
        if enough is not None and any(e.payload.startswith(enough) for e in found):
            break
    return found
