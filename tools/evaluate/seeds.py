"""Figures of several seeds: rows of a table, the means and the worst."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from shared.command_line import seed

Figures = Mapping[str, float | int | str | bool | None]

_MOST_SEEDS = 1000
_COLUMNS = (
    "pose_rmse_m", "map_rmse_m", "map_completeness", "collisions", "goal_error_m", "duration_s",
    "encoder_slip_net", "encoder_slip_mean_abs", "gyro_bias_dps",
)  # fmt: skip
_MORE_IS_BETTER = ("map_completeness", "refresh_hz")


def seed_list(text: str) -> tuple[int, ...]:
    """`1-15`, or `1,4,7-9`, in that order; each once."""
    found: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        low = seed(first)
        high = seed(last) if dash else low
        if not low <= high < low + _MOST_SEEDS:
            raise argparse.ArgumentTypeError(f"{part!r} is no range of seeds; write 1-15")
        found += range(low, high + 1)
    if len(set(found)) != len(found):
        raise argparse.ArgumentTypeError(f"{text!r} names a seed twice")
    return tuple(found)


def over_seeds(runs: Mapping[int, Figures]) -> dict[str, Any]:
    """`runs` by seed; of what is a number in each of them the mean and the worst."""
    mean, worst = {}, {}
    for key in next(iter(runs.values())):
        values = _numbers(runs, key)
        if values is not None:
            mean[key] = round(sum(values) / len(values), 5)
            worst[key] = min(values) if key in _MORE_IS_BETTER else max(values, key=abs)
    rows = [{"seed": number, **figures} for number, figures in runs.items()]
    finished = all(figures["finished"] for figures in runs.values())
    return {"seeds": list(runs), "finished": finished, "mean": mean, "worst": worst, "runs": rows}


def header() -> str:
    return f"{'seed':>5}" + "".join(f"{key:>{_width(key)}}" for key in _COLUMNS)


def row(name: str, figures: Figures) -> str:
    """One line under the header."""
    return f"{name:>5}" + "".join(f"{_shown(figures.get(key)):>{_width(key)}}" for key in _COLUMNS)


def _numbers(runs: Mapping[int, Figures], key: str) -> list[float] | None:
    values = [figures[key] for figures in runs.values()]
    numbers = [v for v in values if isinstance(v, (int, float)) and not isinstance(v, bool)]
    return numbers if len(numbers) == len(values) else None


def _shown(value: object) -> str:
    return f"{value:.4f}" if isinstance(value, float) else str(value)


def _width(key: str) -> int:
    return max(len(key), 8) + 2
