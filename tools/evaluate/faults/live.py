"""Faults that only a real process can have."""

from __future__ import annotations

from dataclasses import dataclass

LIVE_CASES: dict[str, str] = {}


@dataclass(frozen=True, slots=True)
class LiveOutcome:
    name: str
    text: str
    cut_s: float
    seen: str
    after: str
    failure: str


def try_live(name: str) -> LiveOutcome:
    raise KeyError(name)
