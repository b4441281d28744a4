"""Brief losses are waited out, longer ones end the mission.

A scan that was damaged on its way, or a computer that was busy for a moment, is no reason to give a mission up: the car
stands at once, and goes on by itself once all has been well for a while.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from shared.messages import StopReason


@dataclass(frozen=True, slots=True)
class LossConfig:
    steady_s: float = 0.3  # without a gap for so long: eight scans, thirty samples of the motion
    gone_s: float = 2.0  # what does not come back within this time was no hiccup
    unsteady_s: float = 10.0  # what comes and goes for so long neither

    def __post_init__(self) -> None:
        if not 0.1 <= self.steady_s < self.gone_s <= self.unsteady_s <= 60:
            raise ValueError("steady_s must be from 0.1, below gone_s, and gone_s at most unsteady_s, at most 60")


class LossWatch:
    """One thread updates."""

    def __init__(self, config: LossConfig) -> None:
        self._config = config
        self._reason = StopReason.NONE
        self._began_s = self._gone_since_s = self._well_since_s = math.nan

    def update(self, now_s: float, reason: StopReason) -> StopReason:
        """What the car stands for: `reason`, the loss that is seen now, or the one that was not over for long enough.

        A loss counts from when it was noticed: a computer that stood still as a whole has lost nothing.
        """
        if reason is not StopReason.NONE:
            if self._reason is StopReason.NONE:
                self._began_s = now_s
            if math.isnan(self._gone_since_s):
                self._gone_since_s = now_s
            self._reason, self._well_since_s = reason, math.nan
            return reason
        self._gone_since_s = math.nan
        if math.isnan(self._well_since_s):
            self._well_since_s = now_s
        if now_s - self._well_since_s >= self._config.steady_s:
            self._reason = StopReason.NONE
        return self._reason

    def forgive(self, now_s: float) -> None:
        """No mission was waiting until now."""
        self._began_s = now_s
        if not math.isnan(self._gone_since_s):
            self._gone_since_s = now_s

    def ends_mission(self, now_s: float) -> bool:
        if self._reason is StopReason.NONE:
            return False
        gone = now_s - self._gone_since_s > self._config.gone_s  # False for NaN
        return gone or now_s - self._began_s > self._config.unsteady_s
