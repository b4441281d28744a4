"""Levels with hysteresis: a value that hovers at a limit does not switch to and fro."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from robot_app.safety.gyro_jump import GyroJumpConfig
from robot_app.safety.losses import LossConfig
from robot_app.safety.omni_wheels import OmniWheelWatchConfig
from robot_app.safety.stall import StallConfig
from robot_app.safety.tilt import TiltConfig
from robot_app.safety.wheels import WheelWatchConfig

_LONGEST_SILENCE_S = 5.0
_LONGEST_ABSENCE_S = 120.0
_HOTTEST_C = 90.0  # the Pi's processor is made for 85 and slows itself down there
_LOWEST_V = 3.3  # below it no converter feeds a Pi


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
    """A Pi throttles from 80 °C on (paper 1, section 4.3); two LiFe cells are empty at about 5.8 V under load.

    How old a scan and the odometry may be is written in the schedule.
    """

    warm_c: Band = Band(78.0, 73.0)  # the kernel's fan is on since 60 °C: fewer depth images
    over_temperature_c: Band = Band(85.0, 75.0)  # stop
    weak_battery_v: Band = Band(6.2, 6.35)  # a tenth of the charge is left: warn
    home_battery_v: Band = Band(6.0, 6.35)  # drive to the start
    low_battery_v: Band = Band(5.6, 6.2)  # stop
    stall: StallConfig = field(default_factory=StallConfig)
    tilt: TiltConfig = field(default_factory=TiltConfig)
    wheels: WheelWatchConfig = field(default_factory=WheelWatchConfig)
    gyro_jump: GyroJumpConfig = field(default_factory=GyroJumpConfig)
    omni_wheels: OmniWheelWatchConfig = field(default_factory=OmniWheelWatchConfig)
    losses: LossConfig = field(default_factory=LossConfig)
    min_beams: int = 12  # a scan with fewer echoes is that of a covered scanner
    command_silence_s: float = 1.0  # without a word from the station for so long the car stands …
    command_silence_radio_s: float = 2.0  # … and while LoRa alone carries words, which come turn by turn
    resume_within_s: float = 15.0  # a longer silence ends the mission

    def __post_init__(self) -> None:
        self._check_bands()
        if self.min_beams < 1:
            raise ValueError("min_beams must be at least 1")
        if not 0 < self.command_silence_s <= _LONGEST_SILENCE_S:
            raise ValueError(f"command_silence_s must be above 0 and at most {_LONGEST_SILENCE_S}")
        if not self.command_silence_s <= self.command_silence_radio_s <= _LONGEST_SILENCE_S:
            raise ValueError(
                f"command_silence_radio_s must be from command_silence_s, {self.command_silence_s}, "
                f"to {_LONGEST_SILENCE_S}"
            )
        if not 0 < self.resume_within_s <= _LONGEST_ABSENCE_S:
            raise ValueError(f"resume_within_s must be above 0 and at most {_LONGEST_ABSENCE_S}")

    def _check_bands(self) -> None:
        for name, band in (("warm_c", self.warm_c), ("over_temperature_c", self.over_temperature_c)):
            if band.enter < band.leave:
                raise ValueError(f"{name}.enter must be above leave")
        batteries = ("weak_battery_v", self.weak_battery_v), ("home_battery_v", self.home_battery_v)
        for name, band in (*batteries, ("low_battery_v", self.low_battery_v)):
            if band.enter > band.leave:
                raise ValueError(f"{name}.enter must be below leave")
        if not self.warm_c.enter <= self.over_temperature_c.enter <= _HOTTEST_C:
            raise ValueError(
                f"over_temperature_c.enter must be from warm_c.enter, {self.warm_c.enter}, to {_HOTTEST_C}: "
                "the robot would never stop by itself"
            )
        if not _LOWEST_V <= self.low_battery_v.enter <= self.home_battery_v.enter <= self.weak_battery_v.enter:
            raise ValueError(
                f"low_battery_v.enter must be at least {_LOWEST_V}, and weak_battery_v, home_battery_v and "
                "low_battery_v must be entered in this order while the battery falls"
            )
