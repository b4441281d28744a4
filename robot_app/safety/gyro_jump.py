"""Notices a gyro whose zero jumps: its rate changes faster than any car can begin to turn, and stays changed.

A car turns with the tangent of its steering, and its servo needs a while: at 0.32 m/s, 4 rad/s of the servo change the
turn by at most 6 rad/s in a second. What a jolt does to the gyro comes back within a few samples.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

_SAMPLES = 3  # from the first to the last the gyro's low pass has let a step through
_SPAN_S = 0.02  # that they take; where they come later, the car has had longer to begin to turn
_CONTIGUOUS_S = 0.035


@dataclass(frozen=True, slots=True)
class GyroJumpConfig:
    jump_radps: float = 0.08  # within two samples, 0.02 s: this much …
    jump_per_mps: float = 0.35  # … and this for each m/s: twice what driving does
    stays_s: float = 0.06  # more than half of it for so long

    def __post_init__(self) -> None:
        if not (0.03 <= self.jump_radps <= 1 and 0 <= self.jump_per_mps <= 2 and 0.03 <= self.stays_s <= 0.5):
            raise ValueError("jump_radps must be from 0.03 to 1, jump_per_mps up to 2, stays_s from 0.03 to 0.5")


class GyroJumpWatch:
    """One thread updates."""

    def __init__(self, config: GyroJumpConfig) -> None:
        self._config = config
        self._recent: deque[tuple[float, float]] = deque(maxlen=_SAMPLES)  # stamp, rate
        self.forget()

    def forget(self) -> None:
        self._recent.clear()
        self._jumped_s = math.nan
        self._before_radps = self._jump_radps = 0.0

    def update(self, stamp_s: float, rate_radps: float, speed_mps: float) -> bool:
        """Whether it has jumped. `rate_radps`: round the vertical, as the gyro says it."""
        if self._recent and not 0 <= stamp_s - self._recent[-1][0] <= _CONTIGUOUS_S:
            self.forget()
        self._recent.append((stamp_s, rate_radps))
        if math.isnan(self._jumped_s):
            self._look_for_jump(stamp_s, rate_radps, speed_mps)
            return False
        stays = (rate_radps - self._before_radps) * self._jump_radps > 0.5 * self._jump_radps**2
        if not stays:
            self.forget()
            return False
        return stamp_s - self._jumped_s >= self._config.stays_s

    def _look_for_jump(self, stamp_s: float, rate_radps: float, speed_mps: float) -> None:
        before_s, before_radps = self._recent[0]
        jump_radps = rate_radps - before_radps
        allowed_radps = self._config.jump_radps + self._config.jump_per_mps * abs(speed_mps)
        if abs(jump_radps) > allowed_radps * max(1.0, (stamp_s - before_s) / _SPAN_S):
            self._jumped_s, self._before_radps, self._jump_radps = stamp_s, before_radps, jump_radps
