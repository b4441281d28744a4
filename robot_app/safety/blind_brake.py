"""Brakes a car whose speed is not known any more: by the last speed that was, and for less than it takes to stand.

A motor that is only shorted lets the car roll on for a third of a second from 0.46 m/s. A push against the way that
fades in 50 ms takes most of the speed away before. A car that stops twice as fast as ours is sent back by 1 cm.
"""

from __future__ import annotations

import math

_DUTY_PER_MPS = 1.3
_FADES_S = 0.05  # the speed of the car with its motor shorted fades in 0.09 to 0.12 s
_LASTS_S = 0.18


class BlindBrake:
    def __init__(self) -> None:
        self._began_s = -math.inf
        self._speed_mps = 0.0

    def begin(self, now_s: float, speed_mps: float) -> None:
        """`speed_mps`: the last one that was known."""
        self._began_s, self._speed_mps = now_s, speed_mps

    def duty(self, now_s: float) -> float:
        """0 once it is over."""
        elapsed_s = now_s - self._began_s
        if not 0 <= elapsed_s < _LASTS_S:
            return 0.0
        duty = -_DUTY_PER_MPS * self._speed_mps * math.exp(-elapsed_s / _FADES_S)
        return max(-1.0, min(1.0, duty))
