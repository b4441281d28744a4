"""What a setting carries: computed, and measured between two modules."""

from __future__ import annotations

import statistics
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

_MARK = b"range"
_PATIENCE_S = 2.0  # besides the time that a packet takes


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
    refused: int  # the channel was busy, or the module said no
    weakest_dbm: int | None
    median_dbm: float | None
    strongest_dbm: int | None

    @property
    def loss(self) -> float:
        return 1.0 - self.received / self.sent if self.sent else 1.0


def measure(sender: Es920lr, receiver: Es920lr, count: int, payload_bytes: int, clock: Clock) -> Direction:
    """Send `count` packets one way. Raises `LinkError`."""
    sent, refused, strengths = 0, 0, []
    for number in range(count):
        payload = (_MARK + number.to_bytes(2, "big")).ljust(payload_bytes, b".")
        fate = _fate(sender, payload, clock)
        sent += isinstance(fate, Sent)
        refused += not isinstance(fate, Sent)
        strengths += _strengths(receiver, payload)
    return Direction(
        sender.name,
        receiver.name,
        sent,
        len(strengths),
        refused,
        min(strengths, default=None),
        statistics.median(strengths) if strengths else None,
        max(strengths, default=None),
    )


def _fate(sender: Es920lr, payload: bytes, clock: Clock) -> Sent | SendFailed | None:
    until_s = clock.now_s() + _PATIENCE_S + 2 * airtime_s(sender.settings.modulation, len(payload))
    handle = sender.submit(payload)
    while handle is not None and clock.now_s() < until_s:
        for event in sender.poll(until_s - clock.now_s()):
            if isinstance(event, Sent | SendFailed) and event.handle == handle:
                return event
    return None


def _strengths(receiver: Es920lr, payload: bytes) -> list[int]:
    """The packet has come before its sender was told that it is out; a moment is for the serial line."""
    found: list[int] = []
    events = receiver.poll(0.05)
    while events:
        found += [e.rssi_dbm for e in events if isinstance(e, Heard) and e.payload == payload]
        events = receiver.poll(0.0)
    return found
