"""Levels with hysteresis: a value that hovers at a limit does not switch to and fro."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Band:
    """Entered at `enter`, left at `leave`; enter > leave means that high values are bad, enter < leave low ones."""

    enter: float
    leave: float

    def __post_init__(self) -> None:
        if self.enter == self.leave:
            raise ValueError("enter and leave must differ, or the band switches with every sample")


class BandWatch:
    """Remembers whether a value is in its band. A value that is not known leaves it as it is."""

    def __init__(self, band: Band) -> None:
        self._band = band
        self.inside = False

    def update(self, value: float) -> bool:
        if math.isnan(value):
            return self.inside
        sign = 1.0 if self._band.enter > self._band.leave else -1.0
        limit = self._band.leave if self.inside else self._band.enter
        self.inside = sign * value >= sign * limit
        return self.inside


@dataclass(frozen=True, slots=True)
class SafetyConfig:
    """A Pi throttles from 80 °C on (paper 1, section 4.3); two LiFe cells are empty at about 5.8 V under load."""

    over_temperature_c: Band = Band(85.0, 75.0)
    low_battery_v: Band = Band(5.6, 6.2)
    scan_max_age_s: float = 0.20
    odometry_max_age_s: float = 0.10
    command_silence_s: float = 1.0  # without a word from the station for so long the car stands
    resume_within_s: float = 15.0  # a longer silence ends the mission

    def __post_init__(self) -> None:
        for name in ("scan_max_age_s", "odometry_max_age_s", "command_silence_s", "resume_within_s"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} must be positive")
