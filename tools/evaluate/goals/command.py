"""`evaluate goals`: random goals; are those that can be reached planned and reached, and all others refused?

The demo's robot observes the room, then it is sent to one random place after the other. What can be reached is found
by an exhaustive search in the true room (`reachable`). A goal counts as reachable where the car gets to it with 7 cm
to spare on all sides (the planner keeps 5 cm, a cell of its map has 2), and as unreachable where it does not even when
it may graze; what lies between is `tight`: there both a refusal and a visit are right, a contact is not.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_app.config import load_config as load_robot
from shared.command_line import EXIT_FAILED, EXIT_OK, seed, whole_number_in
from station_gui.config import load_config as load_station
from station_gui.model.goal_figures import GoalState
from tools.evaluate.goals.reachable import Reachable
from tools.evaluate.goals.tour import Tour, Visit
from tools.simulator.scenario import Scenario, find_scenario

_REACHED_M = 0.10
_PLANNED_S = 0.5
_BEYOND_M = 0.3  # goals are drawn so far outside of the room too
_MARGIN_M = 0.07


@dataclass(frozen=True, slots=True)
class Row:
    """One goal. `kind`: reachable, tight, unreachable."""

    goal_m: tuple[float, float]
    kind: str
    visit: Visit

    @property
    def reached(self) -> bool:
        return self.visit.figures.state is GoalState.REACHED and self.visit.error_m <= _REACHED_M

    @property
    def right(self) -> bool:
        if self.visit.contacts:
            return False
        refused = not self.visit.planned
        went = self.reached and self.visit.planning_s <= _PLANNED_S
        return {"reachable": went, "tight": refused or went, "unreachable": refused}[self.kind]


@dataclass(frozen=True, slots=True)
class GoalsSummary:
    """What `evaluate goals` prints; lengths, clearances and times are those of the goals that were planned."""

    scenario: str
    seed: int
    method: str
    goals: int
    reachable: int
    reachable_planned: int
    reachable_reached: int
    tight: int
    tight_planned: int
    tight_reached: int
    unreachable: int
    unreachable_refused: int
    contacts: int
    right: int
    error_m_p50: float | None
    error_m_max: float | None
    planning_s_p50: float | None
    planning_s_max: float | None
    length_m_mean: float | None
    clearance_m_min: float | None
    plans_max: int
    simulated_s: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenario", default="lab", help="a scenario's name or TOML file (default: lab)")
    parser.add_argument("--goals", type=whole_number_in(1, 1000), default=34, help="how many (default: 34)")
    parser.add_argument("--seed", type=seed, default=1, help="of everything (default: 1)")
    parser.add_argument("--method", choices=("rrt_star", "rrt"), help="of planning, instead of what the station says")
    parser.add_argument("--robot", metavar="FILE", type=Path, help="robot.toml instead of the one that comes along")
    parser.add_argument("--station", metavar="FILE", type=Path, help="station.toml instead of the one that comes along")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")


def run(args: argparse.Namespace) -> int:
    logging.getLogger("station").setLevel(logging.ERROR)
    logging.getLogger("robot_app").setLevel(logging.ERROR)
    station = load_station(args.station)
    if args.method is not None:
        station = replace(station, planning=replace(station.planning, method=args.method))
    scenario = find_scenario(args.scenario)
    tour = Tour(scenario, args.seed, load_robot(args.robot), station)
    try:
        tour.observe(_progress)
        rows = _visit_all(tour, scenario, args.seed, args.goals)
        simulated_s = tour.system.clock.now_s()
    finally:
        tour.close()
    summary = summarise(rows, scenario.name, args.seed, station.planning.method, simulated_s)
    if args.json:
        print(json.dumps(asdict(summary) | {"rows": [as_json(row) for row in rows]}))
    else:
        for key, value in asdict(summary).items():
            print(f"{key:24} {value}")
    return EXIT_OK if summary.right == args.goals else EXIT_FAILED


def random_places(scenario: Scenario, number: int, count: int, bare: Reachable) -> list[tuple[float, float]]:
    """Room frame: one anywhere in the room and a little beyond its walls, one where the car can be, and so on."""
    rng = np.random.default_rng([number, 5])
    high = (scenario.room.length_x_m + _BEYOND_M, scenario.room.width_y_m + _BEYOND_M)
    places: list[tuple[float, float]] = []
    while len(places) < count:
        x, y = rng.uniform(-_BEYOND_M, high).round(3).tolist()
        if len(places) % 2 == 0 or (x, y) in bare:
            places.append((x, y))
    return places


def _visit_all(tour: Tour, scenario: Scenario, number: int, count: int) -> list[Row]:
    """Until the robot takes no more goals."""
    here = tour.system.world.room_from_robot()
    wide, bare = (Reachable(scenario, tour.car, here, margin_m) for margin_m in (_MARGIN_M, 0.0))
    rows: list[Row] = []
    for place in random_places(scenario, number, count, bare):
        if not tour.commands:
            print(f"the robot takes no more goals after {len(rows)}", file=sys.stderr)
            break
        kind = "reachable" if place in wide else "tight" if place in bare else "unreachable"
        row = Row(place, kind, tour.visit(place))
        rows.append(row)
        print(_line(len(rows), row), file=sys.stderr, flush=True)
    return rows


def summarise(rows: Sequence[Row], scenario: str, number: int, method: str, simulated_s: float) -> GoalsSummary:
    def count(kind: str, which: str = "all") -> int:
        of_kind = [row for row in rows if row.kind == kind]
        if which == "planned":
            return sum(row.visit.planned for row in of_kind)
        return sum(row.reached for row in of_kind) if which == "reached" else len(of_kind)

    planned = [row for row in rows if row.visit.planned]
    errors = [row.visit.error_m for row in planned if row.visit.figures.state is GoalState.REACHED]
    times = [row.visit.planning_s for row in planned]
    return GoalsSummary(
        scenario=scenario,
        seed=number,
        method=method,
        goals=len(rows),
        reachable=count("reachable"),
        reachable_planned=count("reachable", "planned"),
        reachable_reached=count("reachable", "reached"),
        tight=count("tight"),
        tight_planned=count("tight", "planned"),
        tight_reached=count("tight", "reached"),
        unreachable=count("unreachable"),
        unreachable_refused=count("unreachable") - count("unreachable", "planned"),
        contacts=sum(row.visit.contacts for row in rows),
        right=sum(row.right for row in rows),
        error_m_p50=_percentile(errors, 50),
        error_m_max=_percentile(errors, 100),
        planning_s_p50=_percentile(times, 50),
        planning_s_max=_percentile(times, 100),
        length_m_mean=round(float(np.mean([row.visit.figures.length_m for row in planned])), 3) if planned else None,
        clearance_m_min=_percentile([row.visit.figures.clearance_m for row in planned], 0),
        plans_max=max((row.visit.figures.plans for row in rows), default=0),
        simulated_s=round(simulated_s, 1),
    )


def as_json(row: Row) -> dict[str, Any]:
    figures = row.visit.figures
    return {
        "goal_m": row.goal_m,
        "kind": row.kind,
        "right": row.right,
        "state": figures.state.value,
        "reason": figures.reason,
        "error_m": round(row.visit.error_m, 4),
        "contacts": row.visit.contacts,
        "seconds": round(row.visit.seconds, 1),
        "plans": figures.plans,
        "planning_s": round(row.visit.planning_s, 4) if row.visit.planned else None,
        "length_m": round(figures.length_m, 3) if math.isfinite(figures.length_m) else None,
        "clearance_m": round(figures.clearance_m, 4) if math.isfinite(figures.clearance_m) else None,
    }


def _percentile(values: Sequence[float], share: float) -> float | None:
    return round(float(np.percentile(values, share)), 4) if values else None


def _line(number: int, row: Row) -> str:
    figures = row.visit.figures
    told = f"{figures.state.value}{': ' + figures.reason if figures.reason else ''}"
    wrong = "" if row.right else "  <- not right"
    return (
        f"{number:3} ({row.goal_m[0]:5.2f}, {row.goal_m[1]:5.2f}) {row.kind:11} {told}, "
        f"{100 * row.visit.error_m:.1f} cm off, {figures.plans} plans, {1000 * row.visit.planning_s:.0f} ms{wrong}"
    )


def _progress(simulated_s: float) -> None:
    if sys.stderr.isatty():
        print(f"\robserving, {simulated_s:6.0f} s simulated ", end="", file=sys.stderr, flush=True)
