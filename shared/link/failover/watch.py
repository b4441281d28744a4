"""Is Wi-Fi there? Each side numbers its probes and echoes the last one of the other. Sans-I/O."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FailoverConfig:
    """QGroundControl notices a loss after 3.5 s, Crazyflie after 0.5 s, the paper's system after 3 s."""

    probe_s: float = 0.03
    doubt_s: float = 0.06  # and twice the usual round trip: without an echo what waits goes over LoRa as well
    stall_s: float = 0.15  # and twice the usual round trip: without an echo Wi-Fi counts as gone
    return_s: float = 1.0  # echoes must come so long, without a gap, before Wi-Fi is used again
    reconnect_s: float = 0.25  # between attempts
    give_up_s: float = 0.6  # a connection without an echo for so long is made anew
    radio_hello_s: float = 1.0
    radio_ack_s: float = 0.4

    def __post_init__(self) -> None:
        if not 0 < self.probe_s < self.doubt_s < self.stall_s < self.give_up_s:
            raise ValueError("0 < probe_s < doubt_s < stall_s < give_up_s is needed")


_SMOOTHING = 0.1
_LONGEST_USUAL_S = 0.1  # of a round trip: a network that is slower than that is no better than LoRa


class Watch:
    """Of one side."""

    def __init__(self, config: FailoverConfig) -> None:
        self._config = config
        self._sent: deque[tuple[int, float]] = deque(maxlen=128)
        self._next = 0
        self._probe_s = -math.inf
        self._echoed_s = -math.inf  # when the youngest probe that was echoed had been sent
        self._steady_since_s = math.inf
        self.last_heard = 0  # number of the other side's last probe
        self._usual_s = 0.0  # smoothed round trip

    def due(self, now_s: float) -> bool:
        return now_s >= self._probe_s + self._config.probe_s

    def probe(self, now_s: float) -> int:
        """The number of the probe that is sent now."""
        self._probe_s = now_s
        self._next = (self._next + 1) & 0xFF
        self._sent.append((self._next, now_s))
        return self._next

    def hear(self, number: int, echo: int, now_s: float) -> None:
        """The other side's probe, and which of ours it had heard."""
        self.last_heard = number
        for sent, at_s in reversed(self._sent):
            if sent == echo:
                usual_s = self._usual_s + _SMOOTHING * (now_s - at_s - self._usual_s)
                self._usual_s = min(usual_s, _LONGEST_USUAL_S)
                if not self.is_alive(now_s):
                    self._steady_since_s = now_s
                self._echoed_s = max(self._echoed_s, at_s)
                return

    def forget(self) -> None:
        """The connection is another one."""
        self._sent.clear()
        self._echoed_s = -math.inf

    def is_alive(self, now_s: float) -> bool:
        return self.silent_s(now_s) <= self._config.stall_s + 2 * self._usual_s

    def is_doubtful(self, now_s: float) -> bool:
        return self.silent_s(now_s) > self._config.doubt_s + 2 * self._usual_s

    def is_steady(self, now_s: float) -> bool:
        return self.is_alive(now_s) and now_s - self._steady_since_s >= self._config.return_s

    def silent_s(self, now_s: float) -> float:
        return now_s - self._echoed_s
