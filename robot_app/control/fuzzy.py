"""Fuzzy logic control (paper 1, section 2.2): readable sets and rule tables, Mamdani rules.

The firing strength of a rule is the smaller of its two memberships; a table's output is the mean of the centres
of its output sets, weighted by how strongly their rules fire (centre-average defuzzification).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise


@dataclass(frozen=True, slots=True)
class FuzzySet:
    """A trapezoid: membership rises from `feet[0]` to 1 at `shoulders[0]`, falls from `shoulders[1]` to `feet[1]`."""

    name: str
    feet: tuple[float, float]
    shoulders: tuple[float, float]

    def __post_init__(self) -> None:
        if not self.feet[0] <= self.shoulders[0] <= self.shoulders[1] <= self.feet[1]:
            raise ValueError(f"the corners of {self.name} are not in order")

    def membership(self, value: float) -> float:
        low, high = self.shoulders
        if value < low:
            return max(0.0, (value - self.feet[0]) / (low - self.feet[0])) if value > self.feet[0] else 0.0
        if value > high:
            return max(0.0, (self.feet[1] - value) / (self.feet[1] - high)) if value < self.feet[1] else 0.0
        return 1.0

    @property
    def centre(self) -> float:
        return (self.shoulders[0] + self.shoulders[1]) / 2


@dataclass(frozen=True, slots=True)
class Variable:
    """A quantity in words."""

    name: str
    sets: tuple[FuzzySet, ...]

    @staticmethod
    def partition(name: str, **peaks: float) -> Variable:
        """Triangles with these peaks, each reaching to its neighbours' peaks; values beyond the ends are clamped."""
        names, centres = tuple(peaks), tuple(peaks.values())
        last = len(centres) - 1
        return Variable(
            name,
            tuple(
                FuzzySet(label, (centres[max(i - 1, 0)], centres[min(i + 1, last)]), (centres[i], centres[i]))
                for i, label in enumerate(names)
            ),
        )

    def memberships(self, value: float) -> tuple[float, ...]:
        """One for each set; a value outside all sets belongs to the nearest end."""
        low, high = self.sets[0].shoulders[0], self.sets[-1].shoulders[1]
        clamped = min(max(value, low), high)
        return tuple(s.membership(clamped) for s in self.sets)

    def centre_of(self, name: str) -> float:
        for s in self.sets:
            if s.name == name:
                return s.centre
        raise ValueError(f"{self.name} has no set {name}")


@dataclass(frozen=True, slots=True)
class Words:
    """The words for a quantity, smallest first, and between what bounds their peaks may be set."""

    name: str
    labels: tuple[str, ...]
    low: float
    high: float

    def variable(self, key: str, peaks: tuple[float, ...]) -> Variable:
        """With these peaks, as the configuration's `key` has them; raises `ValueError` that names it."""
        if len(peaks) != len(self.labels):
            raise ValueError(f"{key} needs {len(self.labels)} peaks, of {', '.join(self.labels)}, not {len(peaks)}")
        if any(not b > a for a, b in pairwise(peaks)):
            raise ValueError(f"{key} must rise from each peak to the next, and is {list(peaks)}")
        if not all(math.isfinite(peak) and self.low <= peak <= self.high for peak in peaks):
            raise ValueError(f"{key} must lie from {self.low:g} to {self.high:g}, and is {list(peaks)}")
        return Variable.partition(self.name, **dict(zip(self.labels, peaks, strict=True)))


def rules(key: str, rows: Variable, columns: Variable, output: Variable, table: str) -> RuleTable:
    """A rule table as the configuration's `key` has it; raises `ValueError` that names it."""
    try:
        return RuleTable(rows, columns, output, table)
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from error


class RuleTable:
    """If the row variable is <row> and the column variable is <column> then the output is <cell>."""

    def __init__(self, rows: Variable, columns: Variable, output: Variable, table: str) -> None:
        """`table`: one line for each set of `rows`, one word for each set of `columns`, words name `output`'s sets."""
        lines = [line.split() for line in table.strip().splitlines()]
        if [line[0] for line in lines if line] != [s.name for s in rows.sets]:
            raise ValueError(f"the lines of the table must be named as the sets of {rows.name}")
        if any(len(line) != len(columns.sets) + 1 for line in lines):
            raise ValueError(f"each line of the table needs a word for each set of {columns.name}")
        self.rows = rows
        self.columns = columns
        self.output = output
        self._centres = tuple(tuple(output.centre_of(word) for word in line[1:]) for line in lines)

    def __call__(self, row_value: float, column_value: float) -> float:
        columns = self.columns.memberships(column_value)
        weight = total = 0.0
        for row, centres in zip(self.rows.memberships(row_value), self._centres, strict=True):
            if row == 0.0:
                continue
            for column, centre in zip(columns, centres, strict=True):
                strength = min(row, column)
                weight += strength
                total += strength * centre
        return total / weight


def paper_speeds(slow_mps: float, medium_mps: float, fast_mps: float) -> None:
    """Raises `ValueError` where they are not what paper 1, section 4 calls so, with some room about its figures."""
    for key, value, low, high in (
        ("slow_mps", slow_mps, 0.03, 0.1),
        ("medium_mps", medium_mps, 0.15, 0.25),
        ("fast_mps", fast_mps, 0.25, 0.46),
    ):
        if not low <= value <= high:
            raise ValueError(f"{key} must be from {low:g} to {high:g}, not {value:g}")
