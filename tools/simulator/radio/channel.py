"""The air: who hears whom.

A packet is heard by every antenna that is tuned to it, listens from its preamble to its end, gets it strong enough,
and gets no other packet of the same channel and spreading factor meanwhile: two that overlap destroy each other.
Packets of other spreading factors or channels do not disturb, but carrier sense notices their power.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from shared.link.es920lr.airtime import Modulation
from tools.simulator.radio.loss import Independent, LossModel
from tools.simulator.radio.propagation import Propagation, sensitivity_dbm
from tools.simulator.radio.timeline import Entry, Timeline

_PREAMBLE_TO_LOCK = 5  # symbols that a receiver needs of a preamble
_KEPT_S = 10.0  # longest packet and then some: older ones overlap with nothing


@dataclass(frozen=True, slots=True)
class RadioFrame:
    """What the modules' firmware puts on air. An acknowledgement has no payload and no checksum."""

    pan_id: int
    destination_id: int
    source_id: int
    sequence: int
    is_ack: bool = False
    wants_ack: bool = False
    payload: bytes = b""


@dataclass(frozen=True, slots=True)
class Tuning:
    frequency_hz: int
    modulation: Modulation

    def overlaps(self, other: Tuning) -> bool:
        """Whether the two share any part of the band."""
        apart_hz = abs(self.frequency_hz - other.frequency_hz)
        return 2 * apart_hz < self.modulation.bandwidth_hz + other.modulation.bandwidth_hz


@dataclass(eq=False, slots=True)
class Antenna:
    """`heard` is called with each packet that comes in and its power in dBm."""

    name: str
    heard: Callable[[RadioFrame, float], None]
    position_m: tuple[float, float] = (0.0, 0.0)
    tuning: Tuning | None = None
    listening_since_s: float | None = None

    def listen(self, tuning: Tuning, now_s: float) -> None:
        self.tuning, self.listening_since_s = tuning, now_s

    def deafen(self) -> None:
        self.listening_since_s = None


@dataclass(eq=False, slots=True)
class Transmission:
    antenna: Antenna
    frame: RadioFrame
    tuning: Tuning
    power_dbm: float
    start_s: float
    end_s: float
    cut_short: bool = False
    ending: Entry | None = None

    def overlaps(self, from_s: float, to_s: float) -> bool:
        return self.start_s < to_s and from_s < self.end_s


@dataclass(slots=True)
class AirStatistics:
    """One packet and one listener make one reception or one of the losses."""

    packets: int = 0
    airtime_s: float = 0.0
    received: int = 0
    lost_to_collision: int = 0
    lost_to_range: int = 0
    lost_to_chance: int = 0
    per_antenna_s: dict[str, float] = field(default_factory=dict)


class RadioChannel:
    """`loss` makes the state of one direction between two antennas."""

    def __init__(
        self,
        timeline: Timeline,
        rng: np.random.Generator,
        propagation: Propagation | None = None,
        loss: Callable[[], LossModel] = Independent,
    ) -> None:
        self.statistics = AirStatistics()
        self.propagation = propagation or Propagation()
        self._timeline = timeline
        self._rng = rng
        self._new_loss = loss
        self._losses: dict[tuple[str, str], LossModel] = {}
        self._antennas: list[Antenna] = []
        self._recent: list[Transmission] = []

    def attach(self, antenna: Antenna) -> None:
        if any(other.name == antenna.name for other in self._antennas):
            raise ValueError(f"there is an antenna {antenna.name!r} already")
        self._antennas.append(antenna)

    def use_loss(self, loss: Callable[[], LossModel]) -> None:
        """Another kind of loss from now on."""
        self._new_loss = loss
        self._losses.clear()

    def transmit(
        self, antenna: Antenna, frame: RadioFrame, power_dbm: float, airtime_s: float, done: Callable[[], None]
    ) -> Transmission:
        """Put a packet on air; the antenna hears nothing meanwhile. `done` is called at its end."""
        assert antenna.tuning is not None
        antenna.deafen()
        start_s = self._timeline.now_s
        self._recent = [t for t in self._recent if t.end_s > start_s - _KEPT_S]
        transmission = Transmission(antenna, frame, antenna.tuning, power_dbm, start_s, start_s + airtime_s)
        self._recent.append(transmission)
        self.statistics.packets += 1

        def end() -> None:
            self._finish(transmission)
            done()

        transmission.ending = self._timeline.at(transmission.end_s, end)
        return transmission

    def cut_short(self, transmission: Transmission) -> None:
        """The sender loses its power: nobody can read what has been sent so far."""
        if transmission.ending is not None and transmission.end_s > self._timeline.now_s:
            transmission.ending.cancel()
            transmission.end_s = self._timeline.now_s
            transmission.cut_short = True
            self._count_airtime(transmission)

    def strongest_dbm(self, antenna: Antenna, tuning: Tuning, from_s: float, to_s: float) -> float:
        """The greatest power of others within a stretch of time and a channel; minus infinity when all is quiet."""
        others = (
            t
            for t in self._recent
            if t.antenna is not antenna and t.overlaps(from_s, to_s) and t.tuning.overlaps(tuning)
        )
        return max((self._mean_dbm(t, antenna) for t in others), default=-math.inf)

    def _finish(self, transmission: Transmission) -> None:
        self._count_airtime(transmission)
        for antenna in self._antennas:
            if antenna is not transmission.antenna and self._was_listening(antenna, transmission):
                self._offer(transmission, antenna)

    def _count_airtime(self, transmission: Transmission) -> None:
        took_s = transmission.end_s - transmission.start_s
        self.statistics.airtime_s += took_s
        name = transmission.antenna.name
        self.statistics.per_antenna_s[name] = self.statistics.per_antenna_s.get(name, 0.0) + took_s

    @staticmethod
    def _was_listening(antenna: Antenna, transmission: Transmission) -> bool:
        if antenna.listening_since_s is None or antenna.tuning != transmission.tuning:
            return False
        modulation = transmission.tuning.modulation
        spare_s = (modulation.preamble_symbols - _PREAMBLE_TO_LOCK) * modulation.symbol_s
        return antenna.listening_since_s <= transmission.start_s + spare_s

    def _offer(self, transmission: Transmission, antenna: Antenna) -> None:
        needed_dbm = sensitivity_dbm(transmission.tuning.modulation)
        distance_m = math.dist(transmission.antenna.position_m, antenna.position_m)
        power_dbm = self.propagation.received_dbm(transmission.power_dbm, distance_m, self._rng)
        lost = self._loss_of(transmission.antenna, antenna).lost(transmission.start_s, self._rng)
        if power_dbm < needed_dbm:
            self.statistics.lost_to_range += 1
        elif self._collided(transmission, antenna, needed_dbm):
            self.statistics.lost_to_collision += 1
        elif lost:
            self.statistics.lost_to_chance += 1
        else:
            self.statistics.received += 1
            antenna.heard(transmission.frame, power_dbm)

    def _collided(self, transmission: Transmission, antenna: Antenna, needed_dbm: float) -> bool:
        return any(
            other is not transmission
            and other.antenna is not antenna
            and other.tuning == transmission.tuning
            and other.overlaps(transmission.start_s, transmission.end_s)
            and self._mean_dbm(other, antenna) >= needed_dbm
            for other in self._recent
        )

    def _mean_dbm(self, transmission: Transmission, antenna: Antenna) -> float:
        distance_m = math.dist(transmission.antenna.position_m, antenna.position_m)
        return self.propagation.mean_dbm(transmission.power_dbm, distance_m)

    def _loss_of(self, sender: Antenna, receiver: Antenna) -> LossModel:
        direction = (sender.name, receiver.name)
        if direction not in self._losses:
            self._losses[direction] = self._new_loss()
        return self._losses[direction]
