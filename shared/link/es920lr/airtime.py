"""How long the module occupies the air and itself (firmware 1.12; SX1276 datasheet, section 4.1.1.7).

LoRa as the module sets it: explicit header, payload CRC, 8 preamble symbols, coding rate 4/5, and low data rate
optimisation at every spreading factor. Each payload carries 10 bytes of header and 2 of checksum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

MAX_PAYLOAD_BYTES = 50
MAC_BYTES = 12  # header and checksum
ACK_BYTES = 10  # an acknowledgement is a header alone
PAUSE_S = 0.050  # after each packet, before the module says OK
CARRIER_SENSE_TRIES = 3
_SENSE_S = 0.001  # one look at a quarter of a megahertz


@dataclass(frozen=True, slots=True)
class Modulation:
    """Two modules hear each other when this and the frequency are the same."""

    bandwidth_hz: int
    spreading_factor: int
    coding_rate: int = 5  # 4/5
    preamble_symbols: int = 8

    @property
    def symbol_s(self) -> float:
        return (1 << self.spreading_factor) / self.bandwidth_hz

    @property
    def bit_rate_bps(self) -> float:
        """The rate that `show` calls effective."""
        return self.spreading_factor * 4.0 / (self.coding_rate * self.symbol_s)


def frame_airtime_s(modulation: Modulation, frame_bytes: int) -> float:
    """Time in the air of `frame_bytes`, the module's own bytes included."""
    sf = modulation.spreading_factor
    bits = 8 * frame_bytes - 4 * sf + 28 + 16  # header and CRC
    symbols = 8 + max(math.ceil(bits / (4 * (sf - 2))), 0) * modulation.coding_rate
    return (modulation.preamble_symbols + 4.25 + symbols) * modulation.symbol_s


def airtime_s(modulation: Modulation, payload_bytes: int) -> float:
    """Time in the air of a packet with `payload_bytes` of ours."""
    return frame_airtime_s(modulation, payload_bytes + MAC_BYTES)


def ack_airtime_s(modulation: Modulation) -> float:
    return frame_airtime_s(modulation, ACK_BYTES)


def ack_timeout_s(modulation: Modulation) -> float:
    """How long the module waits for an acknowledgement after its packet; whole milliseconds."""
    symbols_s = 2 * modulation.symbol_s + ack_airtime_s(modulation)
    return 0.050 + math.ceil(symbols_s * 1e3) / 1e3


def sense_s(bandwidth_hz: int) -> float:
    """One reading of the carrier: 2, 3 or 4 looks side by side, as many as the bandwidth needs."""
    return {250_000: 3, 500_000: 4}.get(bandwidth_hz, 2) * _SENSE_S


def sense_wait_s(bandwidth_hz: int) -> float:
    """The wait before each further reading."""
    return 0.0 if bandwidth_hz >= 250_000 else _SENSE_S


def carrier_sense_s(bandwidth_hz: int) -> float:
    """Two good readings, before every packet on a free channel: 5, 6 or 8 ms."""
    return 2 * sense_s(bandwidth_hz) + sense_wait_s(bandwidth_hz)


def longest_carrier_sense_s(bandwidth_hz: int) -> float:
    """Until the module gives up: each of the tries may have had one good reading before."""
    return 2 * CARRIER_SENSE_TRIES * (sense_s(bandwidth_hz) + sense_wait_s(bandwidth_hz))


def packets_per_s(modulation: Modulation, payload_bytes: int) -> float:
    """Packets that one module can send back to back without acknowledgements, carrier sense left out (as the
    table of the data collected for it does)."""
    return 1.0 / (airtime_s(modulation, payload_bytes) + PAUSE_S)


def send_s(modulation: Modulation, payload_bytes: int, uart_baud: int) -> float:
    """From the first byte on the serial line to the module's OK, on a free channel, without acknowledgement."""
    line_s = 10.0 * (1 + payload_bytes + 3) / uart_baud  # length byte, payload; length byte and OK
    return line_s + carrier_sense_s(modulation.bandwidth_hz) + airtime_s(modulation, payload_bytes) + PAUSE_S
