from __future__ import annotations

import math
from dataclasses import replace

import pytest

from station_gui.model.goal_figures import GoalFigures, GoalState
from tools.evaluate.goals.command import Row, as_json, summarise
from tools.evaluate.goals.tour import Visit

_WENT = GoalFigures(1, (1.0, 1.0), GoalState.REACHED, 2.0, 0.1, 0.05, 0.05, 1)
_REFUSED = GoalFigures(1, (1.0, 1.0), GoalState.REFUSED, reason="no way")


def _row(kind: str, figures: GoalFigures, error_m: float = 0.01, contacts: int = 0, planning_s: float = 0.1) -> Row:
    return Row((1.0, 1.0), kind, Visit(figures, error_m, contacts, 5.0, planning_s))


@pytest.mark.parametrize(
    ("row", "right"),
    [
        (_row("reachable", _WENT), True),
        (_row("reachable", _WENT, error_m=0.11), False),
        (_row("reachable", _WENT, contacts=1), False),
        (_row("reachable", _WENT, planning_s=0.6), False),
        (_row("reachable", _REFUSED), False),
        (_row("reachable", replace(_WENT, state=GoalState.GIVEN_UP)), False),
        (_row("tight", _WENT), True),
        (_row("tight", _REFUSED), True),
        (_row("tight", _REFUSED, contacts=1), False),
        (_row("unreachable", _REFUSED, planning_s=math.nan), True),
        (_row("unreachable", _WENT), False),
    ],
)
def test_a_row_is_right_when_what_can_be_reached_is_and_nothing_is_touched(row: Row, right: bool) -> None:
    assert row.right is right


def test_the_summary_counts_each_kind() -> None:
    rows = [_row("reachable", _WENT), _row("reachable", _REFUSED), _row("unreachable", _REFUSED), _row("tight", _WENT)]
    summary = summarise(rows, "lab", 1, "rrt_star", 100.0)
    assert (summary.reachable, summary.reachable_planned, summary.reachable_reached) == (2, 1, 1)
    assert (summary.unreachable, summary.unreachable_refused) == (1, 1)
    assert (summary.tight, summary.tight_planned, summary.tight_reached) == (1, 1, 1)
    assert summary.right == 3
    assert summary.planning_s_max == 0.1


def test_what_was_not_planned_has_no_figures_in_json() -> None:
    told = as_json(_row("unreachable", _REFUSED, planning_s=math.nan))
    assert told["length_m"] is None
    assert told["planning_s"] is None
    assert told["reason"] == "no way"
