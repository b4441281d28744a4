"""What the fuzzy wall follower goes by: the words for what it sees and does, and its rules (paper 1, section 2.2).

All of it can be set in `robot.toml`; a peak that is out of its bounds, and a rule with a word that there is not, are
refused by the name of their key. `fuzzy.RuleTable` tells how a table is read.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot_app.control.fuzzy import RuleTable, Variable, Words, rules

_ANGLE = Words("angle of the way ahead, rad", ("right", "bit_right", "ahead", "bit_left", "left"), -math.pi, math.pi)
_OFFSET = Words("offset from the way, m", ("right", "bit_right", "on_it", "bit_left", "left"), -1.0, 1.0)
_STEER = Words("steering, of the sharpest", ("RR", "R", "r", "o", "l", "L", "LL"), -1.0, 1.0)
_CLEARANCE = Words("clearance ahead, m", ("none", "little", "some", "much"), 0.0, 2.0)
_TURN = Words("steering, of the sharpest, either side", ("straight", "bend", "sharp"), 0.0, 1.0)
_NEED = Words("curvature to turn away, of the sharpest possible", ("none", "soon", "now"), 0.0, 3.0)
_AWAY = Words("turn away, of the sharpest", ("none", "half", "full"), 0.0, 1.0)
_SPEED = Variable.partition("speed", stop=0.0, slow=1.0, medium=2.0, fast=3.0)


@dataclass(frozen=True, slots=True)
class WallRulesConfig:
    """Peaks of the sets, each a triangle that reaches to its neighbours' peaks, and the tables of the rules."""

    angle_rad: tuple[float, ...] = (-0.8, -0.32, 0.0, 0.32, 0.8)  # right, bit_right, ahead, bit_left, left
    offset_m: tuple[float, ...] = (-0.25, -0.08, 0.0, 0.08, 0.25)  # right, bit_right, on_it, bit_left, left
    steer: tuple[float, ...] = (-1.0, -0.55, -0.25, 0.0, 0.25, 0.55, 1.0)  # RR, R, r, o, l, L, LL
    clearance_m: tuple[float, ...] = (0.06, 0.18, 0.42, 0.8)  # none, little, some, much
    turn: tuple[float, ...] = (0.1, 0.5, 1.0)  # straight, bend, sharp
    need: tuple[float, ...] = (0.7, 0.9, 1.1)  # none, soon, now
    away: tuple[float, ...] = (0.0, 0.5, 1.0)  # none, half, full
    # offset:   right  bit_right on_it bit_left left
    steering_rules: str = """
    right       R      RR        RR    RR       RR
    bit_right   o      r         R     R        RR
    ahead       L      l         o     r        R
    bit_left    LL     L         L     l        o
    left        LL     LL        LL    LL       L
    """
    # offset: nearer to the wall ... farther off
    away_rules: str = """
    none     none none none none none
    soon     full full half none none
    now      full full full half none
    """
    # turn:  straight bend   sharp
    speed_rules: str = """
    none     slow     slow   slow
    little   slow     slow   slow
    some     medium   medium medium
    much     fast     medium medium
    """

    def __post_init__(self) -> None:
        _ = self.steering, self.turn_away, self.speed

    @property
    def steering(self) -> RuleTable:
        angle, offset = _ANGLE.variable("angle_rad", self.angle_rad), _OFFSET.variable("offset_m", self.offset_m)
        return rules("steering_rules", angle, offset, _STEER.variable("steer", self.steer), self.steering_rules)

    @property
    def turn_away(self) -> RuleTable:
        need, offset = _NEED.variable("need", self.need), _OFFSET.variable("offset_m", self.offset_m)
        return rules("away_rules", need, offset, _AWAY.variable("away", self.away), self.away_rules)

    @property
    def speed(self) -> RuleTable:
        """Its output is a level: 0 stop, 1 slow, 2 medium, 3 fast."""
        clearance, turn = _CLEARANCE.variable("clearance_m", self.clearance_m), _TURN.variable("turn", self.turn)
        return rules("speed_rules", clearance, turn, _SPEED, self.speed_rules)
