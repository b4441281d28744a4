"""What the turns of a radio pair depend on."""

from __future__ import annotations

from dataclasses import dataclass

from shared.link.es920lr.airtime import MAX_PAYLOAD_BYTES, PAUSE_S, airtime_s, carrier_sense_s
from shared.link.es920lr.settings import RadioSettings

_HEARD_PREFIX_BYTES = 13  # length, RSSI, PAN and sender before each packet on the serial line
_BITS_A_BYTE = 10
_LATE_S = 0.020  # USB, the transceiver, a busy computer: an answer may be heard so much later than it could be


@dataclass(frozen=True, slots=True)
class PairConfig:
    """The defaults are those of docs/link.md, where the table says what a shorter or longer turn costs."""

    turn_s: float = 1.0  # while data flow, the station is asked so often: what a command waits at most, without losses
    idle_turn_s: float = 0.25  # while there is nothing to send
    tail_turn_s: float = 0.12  # when all is sent and not all is acknowledged
    retry_turn_s: float = 0.05  # after a turn that was lost
    most_answers: int = 4  # packets of the station's in one turn
    bulk_limit_bytes: int = 2_048  # what may wait in a lane; a single datagram may be longer
    ahead_bytes: int = 100  # handed over ahead of time: what follows is the newest there is
    suspect_losses: int = 8  # one after the other on one radio: then the other carries all
    probe_s: float = 1.0  # and this one is tried again so often
    call_after_turns: int = 4  # without any answer: greet again
    call_every_s: float = 0.4
    lost_after_s: float = 3.0  # without a word of the other side

    def __post_init__(self) -> None:
        if min(self.turn_s, self.idle_turn_s, self.tail_turn_s, self.probe_s, self.call_every_s) <= 0:
            raise ValueError("turn_s, idle_turn_s, tail_turn_s, probe_s and call_every_s must be positive")
        if self.most_answers < 1:
            raise ValueError("most_answers is 1 or more")


@dataclass(frozen=True, slots=True)
class Timing:
    """Of the modules as they are set."""

    packet_s: float  # the longest packet in the air
    sense_s: float
    byte_s: float  # on the serial line
    pause_s: float = PAUSE_S

    @property
    def slot_s(self) -> float:
        """Of a packet that follows another at once."""
        return self.sense_s + self.packet_s + self.pause_s

    @property
    def answer_timeout_s(self) -> float:
        """From the OK of a packet until the answer to it must have been heard."""
        line_s = (_HEARD_PREFIX_BYTES + 2 * MAX_PAYLOAD_BYTES) * self.byte_s
        return self.sense_s + self.packet_s + line_s + _LATE_S

    def answer_delay_s(self, heard_bytes: int) -> float:
        """From when a packet was heard until one may be handed over that finds its sender listening: carrier sense
        takes the last of the sender's pause. The serial line to the module is left as a reserve."""
        line_s = (_HEARD_PREFIX_BYTES + heard_bytes) * self.byte_s
        return max(0.0, self.pause_s + 0.001 - self.sense_s - line_s)


def timing_of(settings: RadioSettings) -> Timing:
    packet_s = airtime_s(settings.modulation, MAX_PAYLOAD_BYTES)
    return Timing(packet_s, carrier_sense_s(settings.bandwidth_hz), _BITS_A_BYTE / settings.baud_rate)
