"""Airtime, against the table computed from the firmware's own formula, and against figures of Semtech's calculator."""

from __future__ import annotations

import pytest

from shared.link.es920lr.airtime import (
    Modulation,
    ack_airtime_s,
    airtime_s,
    carrier_sense_s,
    frame_airtime_s,
    packets_per_s,
    send_s,
)

# bandwidth_hz, spreading factor, bits/s, airtime of 20 and of 50 bytes in ms, packets/s, bytes/s
TABLE = [
    (62_500, 7, 2735, 185, 308, 2.8, 140),
    (62_500, 10, 489, 1069, 1643, 0.59, 30),
    (125_000, 7, 5469, 92, 154, 4.9, 245),
    (125_000, 8, 3125, 164, 267, 3.2, 158),
    (125_000, 9, 1758, 288, 452, 2.0, 100),
    (125_000, 10, 977, 535, 821, 1.15, 57),
    (125_000, 11, 538, 987, 1479, 0.65, 33),
    (125_000, 12, 293, 1810, 2794, 0.35, 18),
    (250_000, 7, 10938, 46, 77, 7.9, 394),
    (250_000, 9, 3516, 144, 226, 3.6, 181),
    (250_000, 12, 586, 905, 1397, 0.69, 35),
    (500_000, 7, 21875, 23, 38.5, 11.3, 565),
    (500_000, 8, 12500, 41, 67, 8.6, 429),
    (500_000, 9, 7032, 72, 113, 6.1, 307),
    (500_000, 12, 1172, 453, 698, 1.3, 67),
]


@pytest.mark.parametrize(("bandwidth_hz", "sf", "bps", "short_ms", "long_ms", "rate", "goodput"), TABLE)
def test_the_table_of_the_module_comes_out(
    bandwidth_hz: int, sf: int, bps: int, short_ms: float, long_ms: float, rate: float, goodput: float
) -> None:
    modulation = Modulation(bandwidth_hz, sf)
    assert modulation.bit_rate_bps == pytest.approx(bps, abs=1)
    assert airtime_s(modulation, 20) * 1e3 == pytest.approx(short_ms, abs=0.6)
    assert airtime_s(modulation, 50) * 1e3 == pytest.approx(long_ms, abs=0.6)
    assert packets_per_s(modulation, 50) == pytest.approx(rate, rel=0.03)
    assert packets_per_s(modulation, 50) * 50 == pytest.approx(goodput, rel=0.03)


def test_the_longest_packet_takes_longer_than_the_band_allows() -> None:
    assert airtime_s(Modulation(62_500, 12), 50) == pytest.approx(5.587, abs=1e-3)


def test_acknowledgements_take_what_the_firmware_waits_for() -> None:
    assert ack_airtime_s(Modulation(500_000, 7)) == pytest.approx(11.6e-3, abs=1e-4)
    assert ack_airtime_s(Modulation(125_000, 7)) == pytest.approx(46.3e-3, abs=1e-4)
    assert ack_airtime_s(Modulation(125_000, 12)) == pytest.approx(0.991, abs=1e-3)


def test_a_packet_of_nothing_is_its_preamble_and_eight_symbols() -> None:
    modulation = Modulation(125_000, 12)
    assert frame_airtime_s(modulation, 0) == pytest.approx(20.25 * modulation.symbol_s)


def test_a_stronger_code_and_a_longer_preamble_take_longer() -> None:
    plain, safe = Modulation(125_000, 9), Modulation(125_000, 9, coding_rate=8, preamble_symbols=16)
    assert airtime_s(safe, 30) > airtime_s(plain, 30)
    assert safe.bit_rate_bps == pytest.approx(plain.bit_rate_bps * 5 / 8)


def test_listening_and_the_serial_line_come_on_top() -> None:
    """What a module does at best is less than the table: it listens for 8 ms, and 51 bytes come over the line."""
    assert [carrier_sense_s(hz) for hz in (62_500, 125_000, 250_000, 500_000)] == pytest.approx(
        [0.005, 0.005, 0.006, 0.008]
    )
    assert 1 / send_s(Modulation(500_000, 7), 50, 115_200) == pytest.approx(9.9, abs=0.05)
