"""What the link did for a mission: from the account of a witness at both of its ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.link.base import Lane, LinkPath
from shared.messages import Observation
from shared.protocol.observations import MessageDecoder
from tools.simulator.links import Cut
from tools.simulator.witness import Sent, Side, Witness

_ENDS_S = 5.0  # what was sent in the last moments of a mission may be on its way
_SETTLED_S = 1.5  # of a cut: then it is over


@dataclass(frozen=True, slots=True)
class MissionLink:
    """Bytes are those of what LoRa carried of an observation; the errors are against what the robot had.

    `gap_ms_max`: the longest time between two observations that came, `cut_gap_ms_max` round a cut of Wi-Fi.
    `lost`, `duplicated`, `out_of_order`: observations, commands and their answers; all of them have to come.
    """

    observations: int
    observations_hz: float
    over_lora: int
    lora_bytes_mean: float
    lora_bytes_p99: float
    latency_ms_p50: float
    latency_ms_p99: float
    command_latency_ms_p50: float
    command_latency_ms_max: float
    gap_ms_p50: float
    gap_ms_p99: float
    gap_ms_max: float
    cuts: int
    cut_gap_ms_max: float
    range_error_m: float
    node_error_m: float
    beyond_1_cm: int  # observations with a range that is off by more
    beams_left_out: float  # of an observation, mean
    nodes_left_out: float
    lost: int
    duplicated: int
    out_of_order: int


def link_figures(witness: Witness, cuts: tuple[Cut, ...], end_s: float) -> MissionLink:
    robot, station = witness.accounts[Side.ROBOT], witness.accounts[Side.STATION]
    observed = [sent for sent in robot.of(Lane.BULK) if sent.came]
    came_s = np.array([sent.came_s for sent in observed])
    waits_s = np.array([sent.took_s for sent in observed])
    gaps_s = np.diff(came_s)
    orders_s = np.array([s.took_s for lane in (Lane.COMMAND, Lane.NOW) for s in station.of(lane) if s.came])
    sizes = np.array([len(sent.arrived) for sent in observed if sent.over is LinkPath.RADIO])
    errors = _Errors(observed)
    return MissionLink(
        observations=len(observed),
        observations_hz=len(gaps_s) / float(np.ptp(came_s)) if len(gaps_s) else 0.0,
        over_lora=len(sizes),
        lora_bytes_mean=float(np.mean(sizes)) if len(sizes) else 0.0,
        lora_bytes_p99=_percentile(sizes, 99),
        latency_ms_p50=1e3 * _percentile(waits_s, 50),
        latency_ms_p99=1e3 * _percentile(waits_s, 99),
        command_latency_ms_p50=1e3 * _percentile(orders_s, 50),
        command_latency_ms_max=1e3 * _percentile(orders_s, 100),
        gap_ms_p50=1e3 * _percentile(gaps_s, 50),
        gap_ms_p99=1e3 * _percentile(gaps_s, 99),
        gap_ms_max=1e3 * _percentile(gaps_s, 100),
        cuts=len(cuts),
        cut_gap_ms_max=1e3 * _percentile(_near_cuts(came_s, gaps_s, cuts), 100),
        range_error_m=errors.range_m,
        node_error_m=errors.node_m,
        beyond_1_cm=errors.beyond,
        beams_left_out=errors.beams / max(1, len(observed)),
        nodes_left_out=errors.nodes / max(1, len(observed)),
        lost=sum(account.lost(end_s - _ENDS_S) for account in (robot, station)),
        duplicated=robot.duplicated + station.duplicated,
        out_of_order=robot.out_of_order + station.out_of_order,
    )


def _near_cuts(came_s: NDArray[np.float64], gaps_s: NDArray[np.float64], cuts: tuple[Cut, ...]) -> NDArray[np.float64]:
    """Gaps that touch a cut."""
    near = np.zeros(len(gaps_s), np.bool_)
    for cut in cuts:
        near |= (came_s[1:] > cut.from_s) & (came_s[:-1] < cut.to_s + _SETTLED_S)
    return gaps_s[near]


def _percentile(values: NDArray[np.float64], percent: float) -> float:
    return float(np.percentile(values, percent)) if len(values) else 0.0


class _Errors:
    """Of what was decoded, against what had been encoded."""

    _BOUND_M = 0.0100005  # the last digit of a 32-bit float

    def __init__(self, observed: list[Sent]) -> None:
        self.range_m = self.node_m = 0.0
        self.beyond = self.beams = self.nodes = 0
        there, here = MessageDecoder(compact=True), MessageDecoder(compact=True)
        for sent in observed:
            original, received = there.decode(sent.datagram), here.decode(sent.arrived)
            if original is None or received is None:
                continue
            if isinstance(original.message, Observation) and isinstance(received.message, Observation):
                self._compare(original.message, received.message)

    def _compare(self, original: Observation, received: Observation) -> None:
        both = np.isfinite(original.ranges_m) & np.isfinite(received.ranges_m)
        self.beams += int(np.isfinite(original.ranges_m).sum() - both.sum())
        if both.any():
            off_m = float(np.abs(original.ranges_m.astype(np.float64) - received.ranges_m)[both].max())
            self.range_m = max(self.range_m, off_m)
            self.beyond += off_m > self._BOUND_M
        nodes, got = original.objects.nodes_m, received.objects.nodes_m
        self.nodes += max(0, len(nodes) - len(got))
        if len(nodes) and len(got) >= len(nodes):
            off = np.linalg.norm(nodes[:, None, :] - got[None, :, :], axis=2).min(axis=1)
            self.node_m = max(self.node_m, float(off.max()))
