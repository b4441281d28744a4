"""`[radio]` of robot.toml and station.toml: which ports, and how the modules are set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from shared.link.es920lr import band
from shared.link.es920lr.settings import BootMode, Format, RadioSettings
from shared.link.radio_pair.config import PairConfig, timing_of

LinkUse = Literal["tcp", "radio", "both"]
_MOST_RADIOS = 2
_SECOND = 2  # the second pair's identifiers are so much higher, as `radio-config copy` sets them
_RULES = {"long": band.LONG_CARRIER_SENSE, "short": band.SHORT_CARRIER_SENSE}
_TURN_SLOTS = 4.0  # a turn more seldom than that is wanted costs little of what two modules carry
_WORD_SLOTS, _LOST_TURN_SLOTS = 3.0, 3.0  # docs/link.md: the packet on its way, the answer; the same for a lost turn


@dataclass(frozen=True, slots=True)
class RadioConfig:
    """A port is a serial port (`/dev/ttyUSB0`) or one of a transceiver's radios (`/dev/ttyACM0:A`, `:B`)."""

    ports: tuple[str, ...] = ()
    channels: tuple[int, ...] = (1, 5)  # of the first pair, of the second
    pan_id: int = 0x0001
    own_id: int = 0x0001  # of the first radio; the second has both two higher
    destination_id: int = 0x0002
    bandwidth_hz: int = 500_000
    spreading_factor: int = 7
    baud_rate: int = 115_200  # between program and module
    carrier_sense: Literal["long", "short"] = "long"  # the rule of the band

    def __post_init__(self) -> None:
        if len(self.ports) > _MOST_RADIOS or len(set(self.ports)) < len(self.ports):
            raise ValueError(f"ports are one or two different ones, not {', '.join(self.ports)}")
        for port in self.ports:
            path, colon, letter = port.rpartition(":")
            if colon and len(letter) == 1 and letter not in "AB":
                raise ValueError(f"ports: {port}: a transceiver has two radios, {path}:A and {path}:B")
        if len(self.channels) != _MOST_RADIOS or self.channels[0] == self.channels[1]:
            raise ValueError("channels are two different ones, of the first pair and of the second")
        if self.own_id == self.destination_id:
            raise ValueError("own_id and destination_id must differ: the other side has them the other way round")
        for radio in range(_MOST_RADIOS):
            band.check(self.settings(radio), self.rule)

    @property
    def rule(self) -> band.BandRule:
        return _RULES[self.carrier_sense]

    def settings(self, radio: int) -> RadioSettings:
        """What the module of a radio has to be set to."""
        return RadioSettings(
            bandwidth_hz=self.bandwidth_hz,
            spreading_factor=self.spreading_factor,
            channel=self.channels[radio],
            pan_id=self.pan_id,
            own_id=self.own_id + _SECOND * radio,
            destination_id=self.destination_id + _SECOND * radio,
            acknowledge=False,
            show_rssi=True,
            show_sender=True,
            format=Format.BINARY,
            boot_mode=BootMode.OPERATION,
            baud_rate=self.baud_rate,
        )


def alone(settings: RadioSettings) -> PairConfig:
    """Turns where LoRa carries everything: a stop waits half a second, and 97 % of what could be are carried."""
    return PairConfig(turn_s=max(0.4, _TURN_SLOTS * timing_of(settings).slot_s))


def beside_wifi(settings: RadioSettings) -> PairConfig:
    """… and where it is there for when Wi-Fi fails: a command shall not wait long for its turn then."""
    slot_s = timing_of(settings).slot_s
    return PairConfig(turn_s=max(0.18, 2 * slot_s), idle_turn_s=max(0.15, 1.5 * slot_s))


def longest_word_s(settings: RadioSettings) -> float:
    """From one heartbeat to the next, at the robot, when LoRa is alone and one turn is lost (docs/link.md)."""
    return alone(settings).turn_s + (_WORD_SLOTS + _LOST_TURN_SLOTS) * timing_of(settings).slot_s
