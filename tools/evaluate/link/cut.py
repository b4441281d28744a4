"""Cuts of Wi-Fi at random moments: what is lost, and for how long nothing comes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from shared.link.base import Lane, LinkPath
from tools.simulator.radio.failover_rig import FailoverRig

_PERIOD_S = 0.2  # of observations, and of commands: 5 Hz
_CUT_S = (0.1, 4.0)
_BETWEEN_S = (0.3, 3.0)
_LONGEST_S = 30.0
_CUTS_A_RIG = 25


@dataclass(frozen=True, slots=True)
class CutFigures:
    """Commands five times a second, and observations too as long as the link has room.

    `failover_ms`: the longest delivery of an observation around each cut, from `send` to `receive`; `gap_ms_max` the
    longest time between two that came, their period of 200 ms included. `return_ms`: from the end of the cut until
    the observations are on Wi-Fi again, the second that it has to be steady included.
    """

    scenario: str
    observations: str
    cuts: int
    bytes_per_observation: float
    wifi_bytes_per_observation: float
    refresh_hz: float
    latency_ms_p50: float
    latency_ms_p99: float
    failover_ms_p50: float
    failover_ms_max: float
    command_failover_ms_p50: float
    command_failover_ms_max: float
    gap_ms_max: float
    return_ms_p50: float
    sent: int
    lost: int
    duplicated: int
    out_of_order: int


@dataclass(slots=True)
class _Lane:
    sent_s: list[float] = field(default_factory=list)
    came_s: list[float] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)

    def take(self, datagram: bytes, now_s: float) -> None:
        self.numbers.append(int.from_bytes(datagram[:4], "little"))
        self.came_s.append(now_s)

    @property
    def waits_s(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.array([came - self.sent_s[n] for n, came in zip(self.numbers, self.came_s, strict=True)])


class _Mission:
    def __init__(self, rig: FailoverRig, size: int, wifi_size: int) -> None:
        self.observations, self.commands = _Lane(), _Lane()
        self.ends = self._waits = False
        self._rig = rig
        self._sizes = size, wifi_size
        self._next_s = rig.clock.now_s()
        rig.at_each_event = self._step

    def done(self) -> bool:
        self.ends = True
        return all(len(set(lane.numbers)) == len(lane.sent_s) for lane in (self.observations, self.commands))

    def _step(self) -> None:
        now_s = self._rig.clock.now_s()
        if now_s >= self._next_s and not self.ends:
            self._next_s += _PERIOD_S
            self._command(now_s)
            self._waits = True
        if self._waits and not self.ends and self._rig.robot.has_room:  # as the uplink does: the newest, when it can
            self._waits = False
            self._observe(now_s)
        while (datagram := self._rig.station.receive(0.0)) is not None:
            self.observations.take(datagram, now_s)
        while (datagram := self._rig.robot.receive(0.0)) is not None:
            self.commands.take(datagram, now_s)

    def _observe(self, now_s: float) -> None:
        number = len(self.observations.sent_s).to_bytes(4, "little")
        size, wifi_size = self._sizes
        if self._rig.robot.send(number + bytes(wifi_size - 4), for_radio=lambda: number + bytes(size - 4)):
            self.observations.sent_s.append(now_s)

    def _command(self, now_s: float) -> None:
        if self._rig.station.send(len(self.commands.sent_s).to_bytes(4, "little") + bytes(14), Lane.COMMAND):
            self.commands.sent_s.append(now_s)


@dataclass(slots=True)
class _Sums:
    failovers_s: list[float] = field(default_factory=list)
    command_failovers_s: list[float] = field(default_factory=list)
    gaps_s: list[float] = field(default_factory=list)
    returns_s: list[float] = field(default_factory=list)
    waits_s: list[float] = field(default_factory=list)
    seconds: float = 0.0
    sent: int = 0
    lost: int = 0
    duplicated: int = 0
    out_of_order: int = 0


def measure_cuts(cuts: int, seed: int, size: int, wifi_size: int) -> CutFigures:
    sums = _Sums()
    for first in range(0, cuts, _CUTS_A_RIG):
        _one_mission(min(_CUTS_A_RIG, cuts - first), seed + first, (size, wifi_size), sums)
    waits_s = np.array(sums.waits_s)
    return CutFigures(
        scenario="Wi-Fi is cut and comes back; LoRa at 500 kHz and SF7",
        observations="synthetic",
        cuts=cuts,
        bytes_per_observation=size,
        wifi_bytes_per_observation=wifi_size,
        refresh_hz=len(sums.waits_s) / sums.seconds,
        latency_ms_p50=1e3 * float(np.percentile(waits_s, 50)),
        latency_ms_p99=1e3 * float(np.percentile(waits_s, 99)),
        failover_ms_p50=1e3 * float(np.median(sums.failovers_s)),
        failover_ms_max=1e3 * max(sums.failovers_s),
        command_failover_ms_p50=1e3 * float(np.median(sums.command_failovers_s)),
        command_failover_ms_max=1e3 * max(sums.command_failovers_s),
        gap_ms_max=1e3 * max(sums.gaps_s),
        return_ms_p50=1e3 * float(np.median(sums.returns_s)),
        sent=sums.sent,
        lost=sums.lost,
        duplicated=sums.duplicated,
        out_of_order=sums.out_of_order,
    )


def _one_mission(cuts: int, seed: int, sizes: tuple[int, int], sums: _Sums) -> None:
    rig, rng = FailoverRig(seed), np.random.default_rng(seed + 1_000)

    def both_ways() -> bool:
        on_wifi = rig.robot.path is rig.station.path is LinkPath.WIFI
        return on_wifi and rig.radios.robot.connected and rig.radios.station.connected

    rig.run(_LONGEST_S, both_ways)
    rig.run(2.0)
    mission = _Mission(rig, *sizes)
    windows: list[tuple[float, float]] = []
    began_s = rig.clock.now_s()
    for _ in range(cuts):
        rig.run(float(rng.uniform(*_BETWEEN_S)))
        cut_s = rig.clock.now_s()
        rig.wifi.cut()
        rig.run(float(rng.uniform(*_CUT_S)))
        rig.wifi.restore()
        back_s = rig.clock.now_s()
        if rig.run(_LONGEST_S, lambda: rig.robot.path is LinkPath.WIFI):
            sums.returns_s.append(rig.clock.now_s() - back_s)
        windows.append((cut_s, rig.clock.now_s()))
    rig.run(_LONGEST_S, mission.done)
    sums.seconds += rig.clock.now_s() - began_s
    _count(mission, windows, sums)


def _count(mission: _Mission, windows: list[tuple[float, float]], sums: _Sums) -> None:
    for lane, failovers_s in (
        (mission.observations, sums.failovers_s),
        (mission.commands, sums.command_failovers_s),
    ):
        sent_s, waits_s = np.array(lane.sent_s)[lane.numbers], lane.waits_s
        for begin_s, end_s in windows:
            near = (sent_s > begin_s - _PERIOD_S) & (sent_s < end_s)
            failovers_s.append(float(waits_s[near].max()))
        sums.sent += len(lane.sent_s)
        sums.lost += len(lane.sent_s) - len(set(lane.numbers))
        sums.duplicated += len(lane.numbers) - len(set(lane.numbers))
        sums.out_of_order += int(np.sum(np.diff(lane.numbers) < 1))
    sums.waits_s += mission.observations.waits_s.tolist()
    sums.gaps_s.append(float(np.diff(mission.observations.came_s).max()))
