"""What joins a robot and a station in lock-step: nothing at all, two emulated LoRa pairs, or Wi-Fi with cuts and LoRa.

All of it runs on the manual clock of the mission: `advance_to` moves that clock, event by event.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np

from shared.link.base import ForRadio, Lane, Link, LinkError, LinkHealth, LinkPath, PathChanged
from shared.link.loopback import LoopbackLink, loopback_pair
from shared.link.radio_config import alone, beside_wifi
from shared.runtime.clock import ManualClock
from tools.simulator.radio.failover_rig import FailoverRig
from tools.simulator.radio.loss import Independent
from tools.simulator.radio.pair_rig import PairRig, link_settings
from tools.simulator.witness import Side, Witness

LinkName = Literal["tcp", "lora", "switch"]
LINK_NAMES: tuple[LinkName, ...] = get_args(LinkName)
PAPER_BANDWIDTH_HZ = 250_000  # at SF7 two modules carry 6.02 kbps then, the paper's rate
FASTEST_BANDWIDTH_HZ = 500_000


@dataclass(frozen=True, slots=True)
class Cut:
    """Of Wi-Fi."""

    from_s: float
    to_s: float


class Joint(Protocol):
    @property
    def cuts(self) -> tuple[Cut, ...]:
        """That have come about by themselves."""
        ...

    @property
    def robot(self) -> Link:
        """The robot's end, the same for the whole mission."""
        ...

    def make_station(self, host: str, port: int) -> Link:
        """The station's end; the last one is over. Raises `LinkError`."""
        ...

    def advance_to(self, time_s: float) -> None: ...

    def cut(self) -> None:
        """Nothing gets through until `mend`."""
        ...

    def mend(self) -> None: ...


def open_links(name: LinkName, clock: ManualClock, seed: int, bandwidth_hz: int | None = None) -> Joint:
    """`bandwidth_hz`: of the LoRa modules, at SF7; by default the paper's for LoRa alone, beside Wi-Fi the fastest."""
    match name:
        case "tcp":
            return LoopbackJoint(clock)
        case "lora":
            return RadioJoint(clock, seed, bandwidth_hz or PAPER_BANDWIDTH_HZ)
        case "switch":
            return SwitchJoint(clock, seed, bandwidth_hz or FASTEST_BANDWIDTH_HZ)


class LoopbackJoint:
    """As Wi-Fi that is always there: nothing takes any time."""

    cuts: tuple[Cut, ...] = ()

    def __init__(self, clock: ManualClock) -> None:
        self._clock = clock
        self.robot = _Switchboard()

    def make_station(self, host: str, port: int) -> Link:
        return self.robot.make(host, port)

    def advance_to(self, time_s: float) -> None:
        self._clock.advance_to(time_s)

    def cut(self) -> None:
        self.robot.whole = False
        self.robot.close()

    def mend(self) -> None:
        self.robot.whole = True


class RadioJoint:
    """LoRa alone, through emulated modules."""

    cuts: tuple[Cut, ...] = ()

    def __init__(self, clock: ManualClock, seed: int, bandwidth_hz: int) -> None:
        self._clock = clock
        settings = link_settings(bandwidth_hz)
        self.rig = PairRig(seed, settings, alone(settings), clock=clock)
        self._made = False

    @property
    def robot(self) -> Link:
        return self.rig.robot

    def make_station(self, host: str, port: int) -> Link:
        del host, port
        station = self.rig.make_station() if self._made else self.rig.station
        self._made = True
        return station

    def advance_to(self, time_s: float) -> None:
        self.rig.run(time_s - self._clock.now_s())

    def cut(self) -> None:
        self.rig.channel.use_loss(lambda: Independent(1.0))

    def mend(self) -> None:
        self.rig.channel.use_loss(Independent)


@dataclass(frozen=True, slots=True)
class CutTimes:
    """Uniformly drawn, s. `used_s`: how long Wi-Fi carries the observations again before it is cut again."""

    first_s: float = 5.0
    used_s: tuple[float, float] = (0.1, 2.5)
    away_s: tuple[float, float] = (0.1, 4.0)


class SwitchJoint:
    """Wi-Fi with LoRa beside it. The failover takes its steps when robot and station ask for what has come."""

    def __init__(self, clock: ManualClock, seed: int, bandwidth_hz: int, times: CutTimes | None = None) -> None:
        self._clock = clock
        self._times = times or CutTimes()
        self._rng = np.random.default_rng(seed + 1_000)
        settings = link_settings(bandwidth_hz)
        self.rig = FailoverRig(seed, beside_wifi(settings), settings=settings, clock=clock, steps=False)
        self.cuts: tuple[Cut, ...] = ()
        self._next_s: float | None = clock.now_s() + self._times.first_s
        self._made = False

    @property
    def robot(self) -> Link:
        return self.rig.robot

    def make_station(self, host: str, port: int) -> Link:
        del host, port
        if self._made:
            self.rig.restart_station()
        self._made = True
        return self.rig.station

    def advance_to(self, time_s: float) -> None:
        if self._next_s is None and self.rig.robot.path is LinkPath.WIFI:
            self._next_s = self._clock.now_s() + float(self._rng.uniform(*self._times.used_s))
        while self._next_s is not None and self._next_s <= time_s:
            self.rig.run(self._next_s - self._clock.now_s())
            self._switch(self._next_s)
        self.rig.run(time_s - self._clock.now_s())

    def cut(self) -> None:
        self._next_s = math.inf
        self.rig.wifi.cut()
        self.rig.radios.channel.use_loss(lambda: Independent(1.0))

    def mend(self) -> None:
        self.rig.wifi.restore()
        self.rig.radios.channel.use_loss(Independent)
        self._next_s = self._clock.now_s() + self._times.first_s

    def _switch(self, now_s: float) -> None:
        wifi = self.rig.wifi
        if wifi.whole:
            wifi.cut()
            self._next_s = now_s + float(self._rng.uniform(*self._times.away_s))
            self.cuts += (Cut(now_s, self._next_s),)
        else:
            wifi.restore()
            self._next_s = None


class WatchedJoint:
    """With a witness at both ends."""

    def __init__(self, inner: Joint, witness: Witness, clock: ManualClock) -> None:
        self._inner = inner
        self._witness = witness
        self._clock = clock
        self.robot = witness.watch(inner.robot, Side.ROBOT, clock)

    @property
    def cuts(self) -> tuple[Cut, ...]:
        return self._inner.cuts

    def make_station(self, host: str, port: int) -> Link:
        return self._witness.watch(self._inner.make_station(host, port), Side.STATION, self._clock)

    def advance_to(self, time_s: float) -> None:
        self._inner.advance_to(time_s)

    def cut(self) -> None:
        self._inner.cut()

    def mend(self) -> None:
        self._inner.mend()


class _Switchboard:
    """The robot's end of whatever loopback stands now."""

    path = LinkPath.WIFI
    mends_itself = False

    def __init__(self) -> None:
        self.whole = True
        self.resets = 0
        self.events: deque[PathChanged] = deque(maxlen=1)
        self._robot: LoopbackLink | None = None
        self.statistics = loopback_pair()[0].statistics

    def make(self, host: str, port: int) -> Link:
        if not self.whole:
            raise LinkError(f"cannot connect to {host}:{port}: no answer in time")
        self._robot, station = loopback_pair()
        self.resets += 1
        self.statistics = self._robot.statistics
        return station

    @property
    def connected(self) -> bool:
        return self._robot is not None and self._robot.connected

    @property
    def has_room(self) -> bool:
        return self._robot is not None and self._robot.has_room

    @property
    def health(self) -> LinkHealth:
        return LinkHealth(wifi=self.connected)

    def send(self, datagram: bytes, lane: Lane = Lane.BULK, slot: int = 0, for_radio: ForRadio | None = None) -> bool:
        del slot, for_radio
        return self._robot is not None and self._robot.connected and self._robot.send(datagram, lane)

    def receive(self, timeout_s: float) -> bytes | None:
        return self._robot.receive(timeout_s) if self._robot is not None and self._robot.connected else None

    def close(self) -> None:
        if self._robot is not None:
            self._robot.close()
