"""What there is to know about the goal that the operator asked for last."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum


class GoalState(Enum):
    GOING = "going"
    REACHED = "reached"
    REFUSED = "refused"
    GIVEN_UP = "given up"
    FORGOTTEN = "forgotten"  # another order came


@dataclass(frozen=True, slots=True)
class GoalFigures:
    """How it stands with the goal that was asked for last; `number` counts them.

    `length_m`, `clearance_m` and `planning_s` are those of the newest plan, NaN without one; `slowest_s` is the longest
    that any plan to this goal took. `reason`: why it was refused or given up.
    """

    number: int
    goal_m: tuple[float, float]
    state: GoalState
    length_m: float = math.nan
    clearance_m: float = math.nan
    planning_s: float = math.nan
    slowest_s: float = 0.0
    plans: int = 0
    reason: str = ""
