"""What the Japanese 920 MHz band allows (ARIB STD-T108; MIC notice H31 No. 123 has the same figures).

Who listens long before a packet may send long; who listens only briefly has 360 s of air an hour. The module
listens for 5 to 8 ms before each packet and pauses 50 ms after it, and so is under the first rule.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from shared.link.es920lr.airtime import (
    MAX_PAYLOAD_BYTES,
    PAUSE_S,
    airtime_s,
    carrier_sense_s,
)
from shared.link.es920lr.settings import RadioSettings, SettingsError

_HOUR_S = 3_600.0
_LEDGER_S = 10.0  # airtime is summed over stretches this long


class BandError(SettingsError):
    """The band forbids it; the text says which rule."""


@dataclass(frozen=True, slots=True)
class BandRule:
    """One way of sharing the band; an hour of airtime an hour is no limit."""

    min_carrier_sense_s: float
    max_airtime_s: float
    min_pause_s: float
    max_airtime_per_hour_s: float
    max_power_dbm: int = 13  # 20 mW at the antenna connector, up to 3 dBi of antenna

    def __post_init__(self) -> None:
        if min(self.max_airtime_s, self.max_airtime_per_hour_s) <= 0:
            raise ValueError("max_airtime_s and max_airtime_per_hour_s must be positive")


LONG_CARRIER_SENSE = BandRule(0.005, 4.0, 0.050, _HOUR_S)
SHORT_CARRIER_SENSE = BandRule(128e-6, 0.4, 0.002, 360.0)


def check(settings: RadioSettings, rule: BandRule, payload_bytes: int = MAX_PAYLOAD_BYTES) -> None:
    """Raises `BandError` for settings with which a packet of `payload_bytes` may not be sent."""
    for problem in problems(settings, rule, payload_bytes):
        raise BandError(problem)


def problems(settings: RadioSettings, rule: BandRule, payload_bytes: int = MAX_PAYLOAD_BYTES) -> list[str]:
    """All that the band has against it, each as one sentence."""
    found: list[str] = []
    took_s = airtime_s(settings.modulation, payload_bytes)
    if took_s > rule.max_airtime_s:
        longest = longest_payload(settings, rule)
        remedy = f"send at most {longest} bytes at a time" if longest else "take a lower spreading factor"
        found.append(
            f"{payload_bytes} bytes at SF{settings.spreading_factor} and {settings.bandwidth_hz / 1e3:g} kHz are "
            f"{took_s:.2f} s in the air; the band allows {rule.max_airtime_s:g} s. Use a lower spreading factor or a "
            f"wider band, or {remedy}"
        )
    if settings.power_dbm > rule.max_power_dbm:
        found.append(f"{settings.power_dbm} dBm are over the {rule.max_power_dbm} dBm that the band allows")
    if carrier_sense_s(settings.bandwidth_hz) < rule.min_carrier_sense_s - 1e-9:
        found.append(
            f"the module listens for less than the {rule.min_carrier_sense_s * 1e3:g} ms that the rule asks for"
        )
    if rule.min_pause_s > PAUSE_S:
        found.append(f"the module pauses for less than the {rule.min_pause_s * 1e3:g} ms that the rule asks for")
    return found + _auto_send_problems(settings, rule)


def _auto_send_problems(settings: RadioSettings, rule: BandRule) -> list[str]:
    if not settings.auto_send_interval_s:
        return []
    took_s = airtime_s(settings.modulation, len(settings.auto_send_text))
    an_hour_s = took_s * _HOUR_S / (settings.auto_send_interval_s + took_s + PAUSE_S)
    if an_hour_s <= rule.max_airtime_per_hour_s:
        return []
    return [
        f"auto_send every {settings.auto_send_interval_s} s is {an_hour_s:.0f} s of air an hour; "
        f"the band allows {rule.max_airtime_per_hour_s:g} s"
    ]


def longest_payload(settings: RadioSettings, rule: BandRule) -> int:
    """Bytes of the longest packet that the rule allows; 0 when it allows none."""
    lengths = range(MAX_PAYLOAD_BYTES, 0, -1)
    return next((n for n in lengths if airtime_s(settings.modulation, n) <= rule.max_airtime_s), 0)


class AirtimeLedger:
    """Airtime of the last hour, at most 10 s too much, never too little."""

    def __init__(self, rule: BandRule) -> None:
        self._rule = rule
        self._entries: deque[tuple[float, float]] = deque()  # end of a stretch, airtime in it
        self.last_hour_s = 0.0
        self.total_s = 0.0

    def add(self, now_s: float, took_s: float) -> None:
        """A packet of `took_s` begins now."""
        self._forget(now_s)
        self.total_s += took_s
        self.last_hour_s += took_s
        if self._entries and now_s < self._entries[-1][0]:
            end_s, sum_s = self._entries.pop()
            self._entries.append((end_s, sum_s + took_s))
        else:
            self._entries.append((now_s + _LEDGER_S, took_s))

    def allowed_at_s(self, now_s: float, took_s: float) -> float:
        """The earliest time at which a packet of `took_s` may begin; infinite when never."""
        if took_s > min(self._rule.max_airtime_s, self._rule.max_airtime_per_hour_s):
            return math.inf
        self._forget(now_s)
        over_s = self.last_hour_s + took_s - self._rule.max_airtime_per_hour_s
        for end_s, sum_s in self._entries:
            if over_s <= 1e-9:
                break
            over_s -= sum_s
            now_s = end_s + _HOUR_S
        return now_s

    def _forget(self, now_s: float) -> None:
        while self._entries and self._entries[0][0] + _HOUR_S <= now_s:
            self.last_hour_s -= self._entries.popleft()[1]
        if not self._entries:
            self.last_hour_s = 0.0
