"""What the 920 MHz band allows."""

from __future__ import annotations

import math

import pytest

from shared.link.es920lr.airtime import airtime_s
from shared.link.es920lr.band import (
    LONG_CARRIER_SENSE,
    SHORT_CARRIER_SENSE,
    AirtimeLedger,
    BandError,
    BandRule,
    check,
    longest_payload,
    problems,
)
from shared.link.es920lr.settings import RadioSettings

SLOWEST = RadioSettings(bandwidth_hz=62_500, spreading_factor=12)


def test_four_seconds_is_the_longest_packet() -> None:
    with pytest.raises(BandError, match=r"5\.59 s in the air; the band allows 4 s.*at most 2\d bytes"):
        check(SLOWEST, LONG_CARRIER_SENSE)
    longest = longest_payload(SLOWEST, LONG_CARRIER_SENSE)
    check(SLOWEST, LONG_CARRIER_SENSE, longest)
    assert airtime_s(SLOWEST.modulation, longest) <= 4.0 < airtime_s(SLOWEST.modulation, longest + 4)


def test_every_other_setting_may_send_fifty_bytes() -> None:
    for bandwidth_hz in (62_500, 125_000, 250_000, 500_000):
        for spreading_factor in range(7, 13):
            settings = RadioSettings(bandwidth_hz=bandwidth_hz, spreading_factor=spreading_factor)
            allowed = airtime_s(settings.modulation, 50) <= 4.0
            assert (problems(settings, LONG_CARRIER_SENSE) == []) is allowed


def test_who_listens_briefly_may_send_four_tenths_of_a_second() -> None:
    check(RadioSettings(), SHORT_CARRIER_SENSE)
    with pytest.raises(BandError, match=r"0\.45 s in the air; the band allows 0\.4 s"):
        check(RadioSettings(spreading_factor=9), SHORT_CARRIER_SENSE)


def test_nothing_at_all_can_be_too_long() -> None:
    assert longest_payload(RadioSettings(spreading_factor=12), SHORT_CARRIER_SENSE) == 0
    with pytest.raises(BandError, match="take a lower spreading factor"):
        check(RadioSettings(spreading_factor=12), SHORT_CARRIER_SENSE)


def test_sending_by_itself_counts_by_the_hour() -> None:
    often = RadioSettings(auto_send_interval_s=1, auto_send_text="x" * 50)
    assert problems(often, LONG_CARRIER_SENSE) == []
    assert "an hour" in problems(often, SHORT_CARRIER_SENSE)[0]


def test_a_stricter_rule_refuses_what_the_module_does() -> None:
    rule = BandRule(0.010, 4.0, 0.060, 3_600.0, max_power_dbm=10)
    assert len(problems(RadioSettings(), rule)) == 3
    with pytest.raises(ValueError, match="positive"):
        BandRule(0.0, 0.0, 0.0, 360.0)


def test_an_hour_has_360_seconds_of_air() -> None:
    ledger, now_s = AirtimeLedger(SHORT_CARRIER_SENSE), 0.0
    sent_at_s = []
    for _ in range(2_000):
        now_s = ledger.allowed_at_s(now_s, 0.4)
        ledger.add(now_s, 0.4)
        sent_at_s.append(now_s)
        now_s += 0.5
    for first, at_s in enumerate(sent_at_s[:1_000]):
        within = sum(at_s <= other_s < at_s + 3_600.0 for other_s in sent_at_s[first:])
        assert within * 0.4 <= 360.0 + 1e-6
    assert sent_at_s[899] < 900 * 0.5
    assert 3_600.0 <= sent_at_s[900] <= 3_620.0
    assert ledger.total_s == pytest.approx(800.0)


def test_a_packet_that_is_too_long_is_never_allowed() -> None:
    assert AirtimeLedger(SHORT_CARRIER_SENSE).allowed_at_s(0.0, 0.41) == math.inf


def test_who_listens_long_may_send_all_the_time() -> None:
    ledger = AirtimeLedger(LONG_CARRIER_SENSE)
    for packet in range(40_000):
        assert ledger.allowed_at_s(packet * 0.09, 0.0385) == packet * 0.09
        ledger.add(packet * 0.09, 0.0385)
    assert len(ledger._entries) <= 361
