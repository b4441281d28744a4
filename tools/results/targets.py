"""What 2D SLAM is to reach, and whether it does: a row for each figure, measured or not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

Figures = dict[str, dict[str, dict[str, Any]]]  # by log, then by method
Read = Callable[[dict[str, Any]], float | None]  # from the figures of one log and method

METHODS = ("graph", "particle")
# How the robot is kidnapped, in words, and which method mapped before.
KIDNAPS = (
    ("put_down", "put down", "graph"), ("put_down", "put down", "particle"),
    ("localise", "put down in a fixed map", "graph"), ("carried", "carried off", "graph"),
)  # fmt: skip
_STRAIGHT_M = 0.05  # nobody set a figure for "straight"; this is what a revisit may be off by


@dataclass(frozen=True, slots=True)
class Target:
    """`by_cpu`: the same figure by what was computed, where it is one of time."""

    what: str
    log: str
    method: str
    wanted: float
    unit: str
    digits: int
    read: Read
    at_most: bool = True
    by_cpu: Read | None = None

    def is_met(self, value: float) -> bool:
        return value <= self.wanted if self.at_most else value >= self.wanted

    def shown(self, value: float) -> str:
        return f"{value:.{self.digits}f}{self.unit}"


def rows(figures: Figures) -> Iterator[tuple[str, ...]]:
    """What, method, wanted, measured, met."""
    for target in TARGETS:
        sign = "≤" if target.at_most else "≥"
        yield (target.what, target.method, f"{sign} {target.shown(target.wanted)}", *_judged(target, figures))


def _judged(target: Target, figures: Figures) -> tuple[str, str]:
    found = figures.get(target.log, {}).get(target.method)
    if found is None:
        return "not measured", ""
    value = target.read(found)
    if value is None:
        return "cannot be told", "**no**"
    by_cpu = target.by_cpu(found) if target.by_cpu is not None else None
    told, met = target.shown(value), "yes" if target.is_met(value) else "**no**"
    if by_cpu is None:
        return told, met
    if target.is_met(by_cpu) != target.is_met(value):
        met += f", by CPU time {'yes' if target.is_met(by_cpu) else 'no'}"
    return f"{told}, by CPU time {target.shown(by_cpu)}", met


def _of(*keys: str) -> Read:
    def read(found: dict[str, Any]) -> float | None:
        value: Any = found
        for key in keys:
            value = value.get(key) if value is not None else None
        return None if value is None else float(value)

    return read


def _ratio(above: str, below: str) -> Read:
    def read(found: dict[str, Any]) -> float | None:
        return found[above] / found[below] if above in found and below in found else None

    return read


def _share(above: str, below: str, kind: str) -> Read:
    def read(found: dict[str, Any]) -> float | None:
        part = found.get(kind)
        return None if part is None or not part[below] else 100 * part[above] / part[below]

    return read


def _claimed_wrongly(kind: str) -> Read:
    def read(found: dict[str, Any]) -> float | None:
        part = found.get(kind)
        return None if part is None else float(part["wrong"] + part["elsewhere_wrong"])

    return read


def _accuracy() -> Iterator[Target]:
    for title, log, method, shift_m, turn_deg in (
        ("Intel", "intel", "graph", 0.0203, 0.35), ("FR079", "fr079", "graph", 0.0372, 0.54),
        ("MIT Killian", "killian", "graph", 0.050, 0.5), ("Intel", "intel", "particle", 0.025, None),
        ("FR079", "fr079", "particle", 0.045, None), ("MIT Killian", "killian", "particle", 0.122, None),
    ):  # fmt: skip
        yield Target(f"{title}: relations, shift", log, method, shift_m, " m", 4, _of("translation_mean_m"))
        if turn_deg is not None:
            yield Target(f"{title}: relations, turn", log, method, turn_deg, "°", 3, _of("rotation_mean_deg"))


def _speed() -> Iterator[Target]:
    logs = (("Intel", "intel"), ("FR079", "fr079"), ("MIT Killian", "killian"))
    factor, cpu_factor = _of("realtime_factor"), _of("cpu_realtime_factor")
    yield Target("Intel: × real time", "intel", "graph", 250, "", 0, factor, at_most=False, by_cpu=cpu_factor)
    for title, log in logs:
        yield Target(f"{title}: × real time", log, "particle", 10, "", 0, factor, at_most=False, by_cpu=cpu_factor)
    for title, log in logs:
        yield Target(
            f"{title}: p99 of the last 1000 steps, of the first", log, "graph", 2, " ×", 2,
            _ratio("step_ms_p99_last_1000", "step_ms_p99_first_1000"),
            by_cpu=_ratio("step_cpu_ms_p99_last_1000", "step_cpu_ms_p99_first_1000"),
        )  # fmt: skip


def _walls() -> Iterator[Target]:
    for log in ("exp1", "exp2", "test_lab2"):
        for method in METHODS:
            yield Target(f"{log}: revisit, offset", log, method, 0.05, " m", 3, _of("revisit_offset_m"))
            yield Target(f"{log}: walls that are there twice", log, method, 0, " m", 1, _of("double_length_m"))
            yield Target(f"{log}: bend of the worst wall", log, method, _STRAIGHT_M, " m", 3, _of("wall_bend_worst_m"))


def _lab() -> Iterator[Target]:
    for method in METHODS:
        for key, wanted in (("pose_rmse_m", 0.01), ("map_rmse_m", 0.012)):
            yield Target(
                f"lab with slip, worst of the seeds: `{key}`", "lab", method, wanted, " m", 4, _of("worst", key)
            )
    for kind, title, method in KIDNAPS:
        found = _share("found", "trials", kind)
        yield Target(f"kidnapped, {title}: found", "kidnap", method, 95, " %", 0, found, at_most=False)
        yield Target(f"kidnapped, {title}: claimed wrongly", "kidnap", method, 0, "", 0, _claimed_wrongly(kind))
    for method in METHODS:
        yield Target(
            "FR079 played twice: runs whose poses differ in any bit",
            "repeat",
            method,
            0,
            " runs",
            0,
            _of("different_runs"),
        )


TARGETS = (*_accuracy(), *_speed(), *_walls(), *_lab())
