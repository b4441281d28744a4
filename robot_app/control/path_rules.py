"""What the fuzzy path follower goes by: its words and its rules (paper 1, section 2.2), as `wall_rules` has its own."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot_app.control.fuzzy import RuleTable, Variable, Words, rules

_OFFSET = Words("offset from the path, m", ("right", "bit_right", "on_it", "bit_left", "left"), -1.0, 1.0)
_HEADING = Words("heading off the path, rad", ("right", "bit_right", "along", "bit_left", "left"), -math.pi, math.pi)
_CORRECTION = Words("correction, of full steering", ("RR", "R", "r", "o", "l", "L", "LL"), -1.0, 1.0)
_WORRY = Words("correction in use, of full steering", ("none", "some", "much"), 0.0, 1.0)
_BEND = Words("bend of the path, of the sharpest", ("straight", "bend", "sharp"), 0.0, 1.0)
_SPEED = Variable.partition("speed", slow=1.0, medium=2.0, fast=3.0)


@dataclass(frozen=True, slots=True)
class PathRulesConfig:
    """Peaks of the sets, each a triangle that reaches to its neighbours' peaks, and the tables of the rules."""

    offset_m: tuple[float, ...] = (-0.12, -0.03, 0.0, 0.03, 0.12)  # right, bit_right, on_it, bit_left, left
    heading_rad: tuple[float, ...] = (-0.6, -0.15, 0.0, 0.15, 0.6)  # right, bit_right, along, bit_left, left
    correction: tuple[float, ...] = (-1.0, -0.5, -0.22, 0.0, 0.22, 0.5, 1.0)  # RR, R, r, o, l, L, LL
    worry: tuple[float, ...] = (0.05, 0.3, 0.7)  # none, some, much
    bend: tuple[float, ...] = (0.2, 0.6, 0.95)  # straight, bend, sharp
    # offset:   right bit_right on_it bit_left left
    correction_rules: str = """
    right       LL    LL        LL    L        o
    bit_right   LL    L         l     o        R
    along       L     l         o     r        R
    bit_left    L     o         r     R        RR
    left        o     R         RR    RR       RR
    """
    # bend:  straight bend   sharp
    speed_rules: str = """
    none     fast     medium medium
    some     medium   medium slow
    much     slow     slow   slow
    """

    def __post_init__(self) -> None:
        _ = self.steering, self.speed

    @property
    def steering(self) -> RuleTable:
        heading = _HEADING.variable("heading_rad", self.heading_rad)
        offset = _OFFSET.variable("offset_m", self.offset_m)
        correction = _CORRECTION.variable("correction", self.correction)
        return rules("correction_rules", heading, offset, correction, self.correction_rules)

    @property
    def speed(self) -> RuleTable:
        """Its output is a level: 1 slow, 2 medium, 3 fast."""
        worry, bend = _WORRY.variable("worry", self.worry), _BEND.variable("bend", self.bend)
        return rules("speed_rules", worry, bend, _SPEED, self.speed_rules)
